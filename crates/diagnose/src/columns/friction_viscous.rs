//! Damping: a parameter every model has, reported when it moved.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, Source, View};
use crate::explain::number;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("friction_viscous")
    }

    fn family(&self) -> Family {
        Family::Standard
    }

    fn axis(&self) -> Axis {
        Axis::Velocity
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        (0..ctx.model.n_act()).map(|k| Proposal::at_drive(ctx, k, vec![Shape::free(vec![Source::Viscous(k)])])).collect()
    }

    fn read(&self, view: &View) -> Reading {
        let total = view.model.joints[view.place].viscous + view.own[0];
        if total < 0.0 { Err(format!("damping would be negative ({})", number(total))) } else { Ok(vec![("viscous", total)]) }
    }
}
