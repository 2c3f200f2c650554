//! Play: the load rests on the end of the gap that passes the effort, so it is half a gap to one side or the other of the motor.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, global};
use crate::explain::number;
use crate::shift::{self, FrictionOf};

/// Share of the samples in which the effort must pass each way: without a change of sign, play is a constant offset of the position.
const EACH_WAY: f64 = 0.05;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("backlash")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Load
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let changes_sign = |k: usize, side: FrictionOf| {
            let efforts: Vec<f64> = ctx.motions.iter().flat_map(|m| shift::passing(m, k, side)).collect();
            let share = efforts.iter().filter(|t| **t > 0.0).count() as f64 / efforts.len().max(1) as f64;
            share > EACH_WAY && share < 1.0 - EACH_WAY
        };
        let shape = |k, side| Shape::free(vec![global(move |m| shift::of_play(m, k, side))]);
        let shapes =
            |k| -> Vec<Shape> { shift::EITHER_SIDE.into_iter().filter(|&side| changes_sign(k, side)).map(|side| shape(k, side)).collect() };
        let all = (0..ctx.model.n_act()).map(|k| (k, shapes(k))).filter(|(_, shapes)| !shapes.is_empty());
        all.map(|(k, shapes)| Proposal::of_all(ctx, k, shapes)).collect()
    }

    fn read(&self, view: &View) -> Reading {
        if view.own[0] <= 0.0 {
            Err(format!("the gap would be negative ({})", number(view.own[0])))
        } else {
            Ok(vec![("gap", view.own[0])])
        }
    }
}
