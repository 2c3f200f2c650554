//! A first-order lag of the drive: the rate of the fitted model.

use super::{Axis, Columns, Context, Family, Proposal, Reading, View};
use crate::explain::number;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("actuator_lag")
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
        let total = view.chain.lag + view.own[0];
        if total <= 0.0 {
            Err(format!("the time constant would be negative ({} s)", number(total)))
        } else {
            Ok(vec![("time_constant", total)])
        }
    }
}
