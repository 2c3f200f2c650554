//! A soft transmission: the load stays behind the motor in proportion to the effort that passes.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, global};
use crate::shift::{self, EITHER_SIDE};

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("joint_elasticity")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Load
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let soft = |k: usize, side| Shape::free(vec![global(move |m| shift::of_compliance(m, k, side))]);
        let shapes = |k| EITHER_SIDE.map(|side| soft(k, side)).into_iter().collect();
        (0..ctx.model.n_act()).map(|k| Proposal::of_all(ctx, k, shapes(k))).collect()
    }

    fn read(&self, view: &View) -> Reading {
        super::stiffness(view.own[0])
    }

    fn smallest(&self, size: f64) -> Option<f64> {
        Some(1.0 / size)
    }
}
