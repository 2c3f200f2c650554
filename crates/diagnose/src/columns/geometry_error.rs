//! A length or an anchor that is not where the model has it: the change of the rigid effort along each of the three directions.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, global};
use crate::sensitivity::lengths;
use crate::shift;

/// The three parameters.
const NAMES: [&str; 3] = ["dx", "dy", "dz"];

/// Errors beyond this are another robot, not a wrong length `[m]`.
const MOST: f64 = 0.1;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("geometry_error")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Column
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let at = |(p, (site, place, name)): (usize, crate::sensitivity::Length)| {
            // Directions that hardly show come out at any length: what is believed of all of them keeps those where they are.
            let sources = (0..3).map(|axis| global(move |m| shift::of_length(m, 3 * p + axis))).collect();
            let shape = Shape { prior: vec![0.5 * MOST; 3], ..Shape::free(sources) };
            Proposal { place, site, other: None, name, scope: ctx.everywhere(), shapes: vec![shape] }
        };
        lengths(ctx.model).into_iter().enumerate().map(at).collect()
    }

    fn read(&self, view: &View) -> Reading {
        if let Some(d) = view.own.iter().find(|d| d.abs() > MOST) {
            return Err(format!("a length would be wrong by {d:.2} m"));
        }
        Ok(NAMES.into_iter().zip(view.own.iter().copied()).collect())
    }
}
