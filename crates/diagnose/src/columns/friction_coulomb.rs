//! Dry friction: a parameter every model has, reported when it moved.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, Source, View};
use crate::explain::number;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("friction_coulomb")
    }

    fn family(&self) -> Family {
        Family::Standard
    }

    fn axis(&self) -> Axis {
        Axis::Velocity
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let shapes = |k| (0..ctx.widths.len()).map(|w| Shape::free(vec![Source::Coulomb(k, w)]).at(w)).collect();
        (0..ctx.model.n_act()).map(|k| Proposal::at_drive(ctx, k, shapes(k))).collect()
    }

    fn read(&self, view: &View) -> Reading {
        let total = view.model.joints[view.place].coulomb + view.own[0];
        if total < 0.0 { Err(format!("dry friction would be negative ({})", number(total))) } else { Ok(vec![("coulomb", total)]) }
    }
}
