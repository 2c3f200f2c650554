//! A spring and damper on a link, fixed in space: its force through the link's Jacobian, the same coefficients in every recording.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, Source, View, on_held};
use crate::explain::number;
use crate::held::{Held, ends};

/// The same stiffness and damping in all directions.
const SAME: f64 = 0.0;
/// The same with a place of rest of its own.
const WITH_REST: f64 = 1.0;
/// A stiffness and damping for each direction.
const EACH: f64 = 2.0;
/// The same in all directions, and for each turn.
const WITH_TURNS: f64 = 3.0;

const STIFFNESS: [&str; 6] = ["stiffness_x", "stiffness_y", "stiffness_z", "stiffness_rx", "stiffness_ry", "stiffness_rz"];
const DAMPING: [&str; 6] = ["damping_x", "damping_y", "damping_z", "damping_rx", "damping_ry", "damping_rz"];
const REST: [&str; 3] = ["rest_x", "rest_y", "rest_z"];

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("limb_impedance")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Column
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        ends(ctx.model).into_iter().map(|link| Proposal::on_link(ctx, link, shapes(link))).collect()
    }

    fn read(&self, view: &View) -> Reading {
        let own = view.own;
        let is = |kind: f64| (view.shape[0] - kind).abs() < 0.5;
        // Springs and dampers first, constants last; see `shapes`.
        let n = if is(WITH_REST) { 2 } else { own.len() };
        if let Some(x) = own[..n].iter().find(|x| **x < 0.0) {
            return Err(format!("a stiffness or damping would be negative ({})", number(*x)));
        }
        let mut out = if is(EACH) { vec![("stiffness", 0.0)] } else { vec![("stiffness", own[0]), ("damping", own[1])] };
        if is(EACH) {
            out.extend(STIFFNESS[..3].iter().copied().zip(own[..3].iter().copied()));
            out.extend(DAMPING[..3].iter().copied().zip(own[3..].iter().copied()));
        } else if is(WITH_TURNS) {
            out.extend(STIFFNESS[3..].iter().copied().zip(own[2..5].iter().copied()));
            out.extend(DAMPING[3..].iter().copied().zip(own[5..].iter().copied()));
        } else if is(WITH_REST) {
            if own[0] <= 0.0 {
                return Err("without stiffness there is no place of rest".to_string());
            }
            out.extend(REST.iter().copied().zip(own[2..].iter().map(|c| -c / own[0])));
        }
        Ok(out)
    }
}

fn shapes(link: usize) -> Vec<Shape> {
    let spring = |axes: core::ops::Range<usize>| on_held(link, axes, |h: &Held, c, i| h.displacement[c][i]);
    let damper = |axes: core::ops::Range<usize>| on_held(link, axes, |h: &Held, c, i| h.velocity[c][i]);
    let constant = |axis: usize| on_held(link, axis..axis + 1, |_, _, _| 1.0);
    let (same, axes) = (|| vec![Source::Again(0), Source::Again(1)], |range: core::ops::Range<usize>| range.map(|c| c..c + 1));
    let with = |mut first: Vec<Source>, more: Vec<Source>| {
        first.extend(more);
        first
    };
    let each = |range: core::ops::Range<usize>| with(axes(range.clone()).map(&spring).collect(), axes(range).map(&damper).collect());
    vec![
        Shape::free(vec![spring(0..3), damper(0..3)]).with(vec![SAME]),
        Shape::free(with(same(), (0..3).map(constant).collect())).with(vec![WITH_REST]),
        Shape::free(each(0..3)).with(vec![EACH]),
        Shape::free(with(same(), each(3..6))).with(vec![WITH_TURNS]),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Bench, all_series, view};

    #[test]
    fn on_a_slider_it_is_a_spring_and_a_damper_at_the_drive() {
        let bench = Bench::sine(0.2, 1.0);
        let shape = bench.shapes(&Effect, 0).swap_remove(0);
        let s = &bench.motion.segment;
        let [spring, damper] = [0, 1].map(|i| all_series(&shape.sources[i], &bench.motion).swap_remove(0).1);
        for i in 0..spring.len() {
            assert!((spring[i] - (s.q[0][i] - s.q[0][0])).abs() < 1e-9 && (damper[i] - s.v[0][i]).abs() < 1e-9);
        }
    }

    #[test]
    fn a_limb_neither_pushes_away_nor_feeds() {
        let bench = Bench::sine(0.2, 1.0);
        assert!(Effect.read(&view(&bench.model, &[1.0, -1.0], &[SAME])).is_err());
        let rest = Effect.read(&view(&bench.model, &[2.0, 0.0, 1.0, 0.0, -3.0], &[WITH_REST])).expect("a limb");
        assert_eq!(rest[2..], [("rest_x", -0.5), ("rest_y", 0.0), ("rest_z", 1.5)]);
    }
}
