//! A spring at a drive: a straight line in its position, or at a revolute joint the sine of its angle, as a spring on a lever pulls.

use pkm_dyn::math;
use pkm_dyn::model::JointKind;

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, Source, View, local};
use crate::motion::Motion;

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
        (0..ctx.model.n_act()).map(|k| Proposal::at_drive(ctx, k, shapes(k))).collect()
    }

    fn read(&self, view: &View) -> Reading {
        let (a, b) = (view.own[0], view.own[1]);
        if view.shape[0] > 0.0 {
            // stiffness·sin(q − rest) = a·sin q + b·cos q; of the two rests half a turn apart, one has a positive stiffness.
            return Ok(vec![("stiffness", math::hypot(a, b)), ("rest", math::atan2(-b, a)), ("curvature", 1.0)]);
        }
        if a <= 0.0 {
            return Err(format!("stiffness would be negative ({a:.3e})"));
        }
        Ok(vec![("stiffness", a), ("rest", -b / a)])
    }
}
