//! Something in the way: a spring that begins at a position and is nothing before it.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, local, on_held, stroke};
use crate::explain::number;
use crate::held::{Held, Spot, ends};
use crate::motion::Motion;

/// How deep it reaches into the range that the motion covers, to try, as shares of that range: less than half, or it is in the way
/// everywhere.
const DEPTHS: [f64; 8] = [0.04, 0.07, 0.1, 0.14, 0.18, 0.24, 0.32, 0.42];

/// The same on links, where every depth is tried along three axes.
const DEPTHS_OF_LINKS: [f64; 4] = [0.06, 0.12, 0.2, 0.34];

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("contact")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Column
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let at_drive = |k: usize| {
            let shape = |[position, side]: [f64; 2]| {
                let source = local(k, move |m, k| m.segment.q[k].iter().map(|q| push(*q, position, side)).collect());
                Shape::free(vec![source]).with(vec![position, side])
            };
            let [middle, half] = stroke(ctx, k);
            Proposal::at_drive(ctx, k, walls([middle - half, middle + half], &DEPTHS).into_iter().map(shape).collect())
        };
        let drives = super::that_travel(ctx).map(at_drive);
        // A part of the workspace is closed by one link at a time: the one that carries no other meets it first.
        drives.chain(ends(ctx.model).into_iter().map(|link| Proposal::on_link(ctx, link, at_link(ctx.motions, link)))).collect()
    }

    fn read(&self, view: &View) -> Reading {
        let (stiffness, position, side) = (view.own[0], view.shape[0], view.shape[1]);
        if stiffness <= 0.0 {
            return Err(format!("the obstacle would pull (stiffness = {})", number(stiffness)));
        }
        let along = view.shape.get(2..).filter(|n| n.len() == 3).map_or([1.0, 0.0, 0.0], |n| [n[0], n[1], n[2]]);
        let [nx, ny, nz] = along;
        Ok(vec![("stiffness", stiffness), ("position", position), ("side", side), ("nx", nx), ("ny", ny), ("nz", nz)])
    }
}

/// Positions and sides of walls that reach into a range.
fn walls([low, high]: [f64; 2], depths: &[f64]) -> Vec<[f64; 2]> {
    let range = high - low;
    depths.iter().flat_map(|d| [[high - d * range, 1.0], [low + d * range, -1.0]]).collect()
}

/// What the robot pushes with per unit of stiffness.
fn push(x: f64, position: f64, side: f64) -> f64 {
    side * (side * (x - position)).max(0.0)
}

fn at_link(motions: &[Motion], link: usize) -> Vec<Shape> {
    let held = |m: &Motion| Held::find(&m.held, link, Spot::Origin).map(|h| h.position.clone());
    let mut out = Vec::new();
    for axis in 0..3 {
        let all = || motions.iter().filter_map(held).flat_map(|p| p[axis].clone());
        let (low, high) = (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
        // A link that does not move along an axis meets nothing there.
        if high - low < 1e-6 * (1.0 + high.abs() + low.abs()) {
            continue;
        }
        let n: [f64; 3] = core::array::from_fn(|c| if c == axis { 1.0 } else { 0.0 });
        for [position, side] in walls([low, high], &DEPTHS_OF_LINKS) {
            let source = on_held((link, Spot::Origin), axis..axis + 1, move |h, c, i| push(h.position[c][i], position, side));
            out.push(Shape::free(vec![source]).with([vec![position, side], n.to_vec()].concat()));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Bench, all_series, series, view};

    #[test]
    fn columns_are_the_law_at_unit_stiffness() {
        let bench = Bench::sine(0.2, 1.0);
        for shape in bench.shapes(&Effect, 0) {
            let reading = Effect.read(&view(&bench.model, &[1.0], &shape.values)).expect("an obstacle pushes");
            let values = bench.values("contact", &reading);
            let column = series(&shape.sources[0], &bench.motion);
            assert!(column.iter().enumerate().all(|(i, x)| (x - bench.push_at_joint("contact", &values, i)).abs() < 1e-12));
            assert!(column.iter().any(|x| x.abs() > 0.0) && column.iter().any(|x| x.abs() <= 0.0), "nothing on one side");
        }
    }

    #[test]
    fn on_a_slider_the_link_meets_what_the_joint_meets() {
        let bench = Bench::sine(0.2, 1.0);
        for shape in bench.shapes(&Effect, 1) {
            let [position, side] = [shape.values[0], shape.values[1]];
            let column = all_series(&shape.sources[0], &bench.motion).swap_remove(0).1;
            let q = &bench.motion.segment.q[0];
            assert!(column.iter().zip(q).all(|(x, q)| (x - push(*q, position, side)).abs() < 1e-9));
        }
    }
}
