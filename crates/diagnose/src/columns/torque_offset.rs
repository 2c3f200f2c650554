//! A constant at a drive: a parameter every model has, reported when it is not zero.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, Source, View};

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("torque_offset")
    }

    fn family(&self) -> Family {
        Family::Standard
    }

    fn axis(&self) -> Axis {
        Axis::Position
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        (0..ctx.model.n_act()).map(|k| Proposal::at_drive(ctx, k, vec![Shape::free(vec![Source::Offset(k)])])).collect()
    }

    fn read(&self, view: &View) -> Reading {
        Ok(vec![("offset", view.own[0])])
    }
}
