//! Effort periodic in position: sine and cosine of several orders over the travel.

use core::f64::consts::TAU;

use pkm_dyn::math;

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, View, local};
use crate::motion::Motion;

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("torque_ripple")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Position
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        (0..ctx.model.n_act())
            .map(|k| {
                let shape = |order: f64| {
                    let wave = |f: fn(f64) -> f64| local(k, move |m: &Motion, k| m.segment.q[k].iter().map(|q| f(order * q)).collect());
                    Shape::free(vec![wave(math::sin), wave(math::cos)]).with(vec![order])
                };
                Proposal::at_drive(ctx, k, orders(ctx, k).into_iter().map(shape).collect())
            })
            .collect()
    }

    fn read(&self, view: &View) -> Reading {
        let (s, c) = (view.own[0], view.own[1]);
        Ok(vec![("amplitude", math::hypot(s, c)), ("order", view.shape[0]), ("phase", math::atan2(c, s))])
    }
}

/// Orders `[1/m | 1/rad]` with three to sixty periods over the travel, as far as rows at top speed still resolve them.
///
/// Fewer than three periods cannot be told from a smooth force. Neighbours are half a period apart over the travel, so that some order
/// matches any true one.
fn orders(ctx: &Context, drive: usize) -> Vec<f64> {
    let (travel, finest) = (ctx.travel[drive], 4.0 * ctx.resolution[drive]);
    if travel <= 0.0 {
        return Vec::new();
    }
    (6..=120).map(|half| 0.5 * f64::from(half) * TAU / travel).take_while(|order| TAU / order > finest).collect()
}
