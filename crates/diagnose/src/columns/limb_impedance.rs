//! A spring and damper on a link, fixed in space: its force through the link's Jacobian, the same coefficients in every recording.

use core::ops::Range;

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, Source, View, on_held};
use crate::explain::number;
use crate::held::{Held, Spot, ends};

/// The same stiffness and damping in all directions.
const SAME: f64 = 0.0;
/// The same with a place of rest of its own.
const WITH_REST: f64 = 1.0;
/// A stiffness and damping for each direction.
const EACH: f64 = 2.0;
/// The same in all directions, and for each turn.
const WITH_TURNS: f64 = 3.0;
/// The same in all directions, at rest at one place in space wherever a recording began.
const IN_SPACE: f64 = 4.0;
/// Damping alone: of a slow motion masses and weights may imitate all that a stiffness does.
const DAMPER: f64 = 5.0;

const STIFFNESS: [&str; 6] = ["stiffness_x", "stiffness_y", "stiffness_z", "stiffness_rx", "stiffness_ry", "stiffness_rz"];
const DAMPING: [&str; 6] = ["damping_x", "damping_y", "damping_z", "damping_rx", "damping_ry", "damping_rz"];
const REST: [&str; 3] = ["rest_x", "rest_y", "rest_z"];
const POINT: [&str; 3] = ["x", "y", "z"];

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
        let centre = |link: usize| ctx.motions.first().and_then(|m| Held::find(&m.held, link, Spot::Centre)).map(|h| h.at);
        ends(ctx.model).into_iter().map(|link| Proposal::on_link(ctx, link, shapes(link, centre(link)))).collect()
    }

    fn read(&self, view: &View) -> Reading {
        let own = view.own;
        let is = |kind: f64| (view.shape[0] - kind).abs() < 0.5;
        // Springs and dampers first, constants last; see `shapes`.
        let has_rest = is(WITH_REST) || is(IN_SPACE);
        let n = if has_rest { 2 } else { own.len() };
        if let Some(x) = own[..n].iter().find(|x| **x < 0.0) {
            return Err(format!("a stiffness or damping would be negative ({})", number(*x)));
        }
        let mut out: Vec<(&str, f64)> = POINT.into_iter().zip(view.shape[1..].iter().copied()).collect();
        if is(DAMPER) {
            out.insert(0, ("damping", own[0]));
            return Ok(out);
        }
        let both = if is(EACH) { vec![("stiffness", 0.0)] } else { vec![("stiffness", own[0]), ("damping", own[1])] };
        out.splice(0..0, both);
        if is(EACH) {
            out.extend(STIFFNESS[..3].iter().copied().zip(own[..3].iter().copied()));
            out.extend(DAMPING[..3].iter().copied().zip(own[3..].iter().copied()));
        } else if is(WITH_TURNS) {
            out.extend(STIFFNESS[3..].iter().copied().zip(own[2..5].iter().copied()));
            out.extend(DAMPING[3..].iter().copied().zip(own[5..].iter().copied()));
        } else if has_rest {
            if own[0] <= 0.0 {
                return Err("without stiffness there is no place of rest".to_string());
            }
            out.extend(REST.iter().copied().zip(own[2..].iter().map(|c| -c / own[0])));
            out.extend(is(IN_SPACE).then_some(("in_space", 1.0)));
        }
        Ok(out)
    }
}

/// Shapes at a link's origin, and at its centre of mass where that is another spot.
fn shapes(link: usize, centre: Option<[f64; 3]>) -> Vec<Shape> {
    let mut out = at_origin(link);
    let first = made(&out);
    out.extend(centre.into_iter().flat_map(|at| at_centre(link, at, first)));
    out
}

/// New columns of these shapes.
fn made(shapes: &[Shape]) -> usize {
    shapes.iter().flat_map(|s| &s.sources).filter(|s| matches!(s, Source::New(_))).count()
}

fn spring(spot: (usize, Spot), axes: Range<usize>) -> Source {
    on_held(spot, axes, |h: &Held, c, i| h.displacement[c][i])
}

fn damper(spot: (usize, Spot), axes: Range<usize>) -> Source {
    on_held(spot, axes, |h: &Held, c, i| h.velocity[c][i])
}

/// A spring to a place in space, but for what the place is.
fn to_place(spot: (usize, Spot)) -> Source {
    on_held(spot, 0..3, |h: &Held, c, i| h.position[c][i])
}

fn constants(spot: (usize, Spot)) -> Vec<Source> {
    (0..3).map(|axis| on_held(spot, axis..axis + 1, |_, _, _| 1.0)).collect()
}

fn at_origin(link: usize) -> Vec<Shape> {
    let spot = (link, Spot::Origin);
    let (same, axes) = (|| vec![Source::Again(0), Source::Again(1)], |range: Range<usize>| range.map(|c| c..c + 1));
    let each = |range: Range<usize>| {
        let springs = axes(range.clone()).map(|c| spring(spot, c));
        springs.chain(axes(range).map(|c| damper(spot, c))).collect::<Vec<Source>>()
    };
    let with = |mut first: Vec<Source>, more: Vec<Source>| {
        first.extend(more);
        first
    };
    vec![
        Shape::free(vec![spring(spot, 0..3), damper(spot, 0..3)]).with(vec![SAME]),
        Shape::free(with(same(), constants(spot))).with(vec![WITH_REST]),
        Shape::free(each(0..3)).with(vec![EACH]),
        Shape::free(with(same(), each(3..6))).with(vec![WITH_TURNS]),
        // The damper and the constants once more.
        Shape::free(with(vec![to_place(spot), Source::Again(1)], (2..5).map(Source::Again).collect())).with(vec![IN_SPACE]),
        Shape::free(vec![Source::Again(1)]).with(vec![DAMPER]),
    ]
}

/// The commonest of them once more, after `first` columns of others.
fn at_centre(link: usize, at: [f64; 3], first: usize) -> Vec<Shape> {
    let spot = (link, Spot::Centre);
    let of = |kind: f64| [vec![kind], at.to_vec()].concat();
    let damper_again = || Source::Again(first + 1);
    let in_space = vec![to_place(spot), damper_again()].into_iter().chain(constants(spot));
    vec![
        Shape::free(vec![spring(spot, 0..3), damper(spot, 0..3)]).with(of(SAME)),
        Shape::free(in_space.collect()).with(of(IN_SPACE)),
        Shape::free(vec![damper_again()]).with(of(DAMPER)),
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
        let elsewhere = Effect.read(&view(&bench.model, &[2.0, 0.5], &[SAME, 0.1, 0.0, -0.3])).expect("a limb");
        assert_eq!(elsewhere, [("stiffness", 2.0), ("damping", 0.5), ("x", 0.1), ("y", 0.0), ("z", -0.3)]);
        assert!(Effect.read(&view(&bench.model, &[-1.0], &[DAMPER])).is_err());
        assert_eq!(Effect.read(&view(&bench.model, &[3.0], &[DAMPER])), Ok(vec![("damping", 3.0)]));
    }

    #[test]
    fn what_pulls_to_a_place_in_space_is_the_law_at_its_reading() {
        let bench = Bench::pair();
        let link = bench.model.link_index("link1").expect("a link");
        let shape = shapes(link, None).into_iter().find(|s| s.values == [IN_SPACE]).expect("a shape at rest in space");
        let own = [200.0, 5.0, -60.0, 12.0, 4.0];
        let reading = Effect.read(&view(&bench.model, &own, &shape.values)).expect("a limb");
        let values = bench.values("limb_impedance", &reading);
        let held = Held::find(&bench.motion.held, link, Spot::Origin).expect("a link that may be held");
        let Some(pkm_dyn::effects::Law::Wrench(law)) = pkm_dyn::effects::find("limb_impedance").map(|e| e.law) else { panic!("a wrench") };
        for i in [0, 40, 137] {
            let want = law(&values, &held.state(i, 0.0));
            for c in 0..3 {
                let sum = own[0] * held.position[c][i] + own[1] * held.velocity[c][i] + own[2 + c];
                assert!((sum - want[c]).abs() < 1e-9, "component {c} at {i}: {sum} instead of {}", want[c]);
            }
        }
    }
}
