//! A transport delay: the fitted model, moved in time.

use super::{Axis, Columns, Context, Family, Proposal, Reading, View};

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("time_delay")
    }

    fn family(&self) -> Family {
        Family::Chain
    }

    fn axis(&self) -> Axis {
        Axis::Column
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        (0..ctx.model.n_act()).map(|k| Proposal::at_drive(ctx, k, Vec::new())).collect()
    }

    fn read(&self, view: &View) -> Reading {
        Ok(vec![("delay", view.chain.delay + view.own[0])])
    }
}
