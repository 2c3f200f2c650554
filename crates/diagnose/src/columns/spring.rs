//! A spring at a drive: a straight line in its position; at a revolute joint the sine of its angle, as a spring on a lever pulls; or the
//! hyperbolic sine of the way from its rest, as one does that hardens. A cable that only pulls harder along the stroke looks like that one.

use pkm_dyn::math;
use pkm_dyn::model::JointKind;

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, Source, View, local, stroke};
use crate::explain::number;
use crate::motion::Motion;

/// How much a spring may harden, to try: its curvature over half the stroke. At the last it is three times as stiff at one end as in the middle.
const HARDENING: [f64; 3] = [0.8, 1.2, 1.8];

/// Strokes, in halves, from the middle within which a spring that hardens must have its rest: only near it is it any other curve than an exponential.
const NEAR: f64 = 3.0;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("spring")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Position
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let of = |k: usize, f: fn(f64) -> f64| local(k, move |m: &Motion, k| m.segment.q[k].iter().map(|q| f(*q)).collect());
        let shapes = |k: usize| {
            let mut out = vec![Shape::free(vec![of(k, |q| q), Source::Offset(k)]).with(vec![0.0])];
            if ctx.model.joints[ctx.model.actuators[k]].kind == JointKind::Revolute {
                out.push(Shape::free(vec![of(k, math::sin), of(k, math::cos)]).with(vec![1.0]));
            }
            out
        };
        let hardening = |k: usize, share: f64| {
            let [middle, half] = stroke(ctx, k);
            let curvature = share / half;
            let bent =
                |f: fn(f64) -> f64| local(k, move |m: &Motion, k| m.segment.q[k].iter().map(|q| f(curvature * (q - middle))).collect());
            Shape::free(vec![bent(math::sinh), bent(math::cosh)]).with(vec![-curvature, middle, half])
        };
        let all = |k: usize| {
            let bent = HARDENING.iter().filter(|_| ctx.travel[k] > 0.0).map(|&share| hardening(k, share));
            shapes(k).into_iter().chain(bent).collect()
        };
        (0..ctx.model.n_act()).map(|k| Proposal::at_drive(ctx, k, all(k))).collect()
    }

    fn read(&self, view: &View) -> Reading {
        let (a, b) = (view.own[0], view.own[1]);
        if view.shape[0] > 0.0 {
            // stiffness·sin(q − rest) = a·sin q + b·cos q; of the two rests half a turn apart, one has a positive stiffness.
            return Ok(vec![("stiffness", math::hypot(a, b)), ("rest", math::atan2(-b, a)), ("curvature", 1.0)]);
        }
        if a <= 0.0 {
            return Err(format!("stiffness would be negative ({})", number(a)));
        }
        if let [curvature, middle, half] = *view.shape {
            // stiffness/c·sinh(c·(q − rest)) = a·sinh(c·(q − middle)) + b·cosh(c·(q − middle)).
            if a <= b.abs() {
                return Err("it would pull one way wherever the joint is".to_string());
            }
            let away = 0.5 * math::ln((a + b) / (a - b)) / -curvature;
            if away.abs() > NEAR * half {
                return Err(format!("it would rest {:.1} strokes away", 0.5 * away.abs() / half));
            }
            return Ok(vec![("stiffness", -curvature * math::sqrt(a * a - b * b)), ("rest", middle - away), ("curvature", curvature)]);
        }
        Ok(vec![("stiffness", a), ("rest", -b / a)])
    }
}

#[cfg(test)]
mod tests {
    use pkm_dyn::effects::bent_away;

    use super::*;
    use crate::testing::{Bench, all_series, view};

    #[test]
    fn what_is_fitted_to_a_spring_that_hardens_reads_as_that_spring() {
        let bench = Bench::sine(0.2, 1.0);
        let shapes = bench.shapes(&Effect, 0);
        let shape = &shapes[shapes.len() - 2];
        let [curvature, middle, half] = shape.values[..] else { panic!("{:?}", shape.values) };
        assert!((curvature * half + 1.2).abs() < 1e-9, "{curvature} over {half}");
        let (stiffness, rest) = (50.0, middle + 0.3 * half);
        // sinh(c·(q − rest)) about the middle, by the addition theorem.
        let away = curvature.abs() * (middle - rest);
        let size = stiffness / curvature.abs();
        let own = [size * math::cosh(away), size * math::sinh(away)];
        let columns: Vec<Vec<f64>> = shape.sources.iter().map(|s| all_series(s, &bench.motion).swap_remove(0).1).collect();
        for (i, q) in bench.motion.segment.q[0].iter().enumerate() {
            let fitted = own[0] * columns[0][i] + own[1] * columns[1][i];
            assert!((fitted - stiffness * bent_away(q - rest, curvature)).abs() < 1e-9, "{fitted} at {q}");
        }
        let read = Effect.read(&view(&bench.model, &own, &shape.values)).unwrap_or_default();
        let value = |name: &str| read.iter().find(|(n, _)| *n == name).map_or(f64::NAN, |(_, v)| *v);
        assert!((value("stiffness") - stiffness).abs() < 1e-9 && (value("rest") - rest).abs() < 1e-9, "{read:?}");
        // A pull to one side only, and one that would push outwards, are no springs.
        assert!(Effect.read(&view(&bench.model, &[1.0, -1.5], &shape.values)).is_err());
        assert!(Effect.read(&view(&bench.model, &[-1.0, 0.0], &shape.values)).is_err());
    }
}
