//! Small efforts that do nothing: half the width in the direction of the effort, of the model's, never of the measured one.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, local};
use crate::explain::number;
use crate::shift::side;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("dead_zone")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Load
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        // An effort that never changes its sign would make a constant of it.
        let changes_sign = |k: &usize| {
            let efforts = || ctx.motions.iter().flat_map(|m| &m.nominal[0][*k]);
            efforts().any(|t| *t > 0.0) && efforts().any(|t| *t < 0.0)
        };
        let shape = |k| Shape::free(vec![local(k, |m, k| side(&m.nominal[0][k]).iter().map(|s| 0.5 * s).collect())]);
        (0..ctx.model.n_act()).filter(changes_sign).map(|k| Proposal::at_drive(ctx, k, vec![shape(k)])).collect()
    }

    fn read(&self, view: &View) -> Reading {
        let width = view.own[0];
        if width <= 0.0 {
            Err(format!("the dead zone would have a negative width ({})", number(width)))
        } else {
            Ok(vec![("width", width)])
        }
    }
}
