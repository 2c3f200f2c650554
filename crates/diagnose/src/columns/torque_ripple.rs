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

/// Orders `[1/m | 1/rad]` with three to sixty periods over the travel, as far as the slower half of the motion has them in the band, and samples
/// at top speed resolve them.
///
/// Fewer than three periods cannot be told from a smooth force. Neighbours are half a period apart over the travel, so that some order
/// matches any true one.
fn orders(ctx: &Context, drive: usize) -> Vec<f64> {
    let travel = ctx.travel[drive];
    if travel <= 0.0 {
        return Vec::new();
    }
    let shortest = f64::max(usual_speed(ctx.motions, drive) / ctx.band, SAMPLES * ctx.top_speed[drive] * longest_period(ctx.motions));
    (6..=120).map(|half| 0.5 * f64::from(half) * TAU / travel).take_while(|order| TAU / order > shortest).collect()
}

/// Samples that a wave has at least.
const SAMPLES: f64 = 4.0;

/// Median speed of a drive over everything recorded `[m/s | rad/s]`.
fn usual_speed(motions: &[Motion], drive: usize) -> f64 {
    let mut speeds: Vec<f64> = motions.iter().flat_map(|m| m.segment.v[drive].iter().map(|v| v.abs())).collect();
    let middle = speeds.len() / 2;
    if speeds.is_empty() { 0.0 } else { *speeds.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// Sampling period of the recording that has the longest `[s]`.
fn longest_period(motions: &[Motion]) -> f64 {
    motions.iter().map(|m| m.segment.dt).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Bench;

    #[test]
    fn orders_reach_as_far_as_the_usual_speed_has_them_in_the_band() {
        // A·sin(ωt) has the median speed A·ω/√2 and travels 2A: in a band B lie up to 2·B/(ω/√2) periods over the travel, 0.6 Hz: 3.75.
        for (hz, most) in [(0.6, 3.75), (0.25, 9.0)] {
            let shapes = Bench::sine(0.2, hz).shapes(&Effect, 0);
            let periods: Vec<f64> = shapes.iter().map(|s| s.values[0] * 0.4 / TAU).collect();
            let last = periods.last().copied().unwrap_or(0.0);
            assert!((periods[0] - 3.0).abs() < 1e-2 && last < 1.02 * most && last > 0.98 * most - 0.5, "{hz} Hz: {periods:?}");
        }
        assert!(Bench::sine(0.2, 2.0).shapes(&Effect, 0).is_empty(), "no ripple of three periods is in the band of a fast motion");
    }
}
