//! Friction and all other efforts of joints for an engine that knows none: dry friction smoothed, and a slope that keeps it stable.

use pkm_dyn::effects::{JointState, Robot};
use pkm_dyn::math::tanh;

/// Step of the difference quotient in smoothing speeds.
const QUOTIENT: f64 = 1e-3;

/// A joint, as the laws need it.
#[derive(Debug, Clone, Copy)]
pub(super) struct At {
    /// Position `[m | rad]`.
    pub(super) q: f64,
    /// Velocity `[m/s | rad/s]`.
    pub(super) v: f64,
    /// Effort the rigid model transmits `[N | N·m]`.
    pub(super) load: f64,
    /// Since the start `[s]`: what warms up does so with it.
    pub(super) time: f64,
}

impl At {
    /// The joint as the laws see it, were it to move at `v` in direction `sign`.
    fn seen(&self, v: f64, sign: f64) -> JointState {
        JointState { q: self.q, v, sign, load: self.load, warmth: self.time, time: self.time, ..JointState::default() }
    }
}

/// Effort against the motion, `effort + slope·(v_end − v)`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Resistance {
    /// At the velocity now `[N | N·m]`.
    pub(super) effort: f64,
    /// Never negative `[N·s/m | N·m·s/rad]`.
    pub(super) slope: f64,
}

/// What joint `j` opposes to its motion; the direction of motion is `tanh(v/width)`, `width` `[m/s | rad/s]`.
///
/// `bearable` is the steepest resistance `[N·s/m | N·m·s/rad]` that a substep can take at the velocity of its beginning; of anything steeper
/// the rest is the slope, for the velocity at its end. Where nothing is left the effort is of second order, and the engine's sweeps have a
/// known push to solve for.
pub(super) fn resistance(robot: &Robot, j: usize, at: At, width: f64, bearable: f64) -> Resistance {
    let ratio = at.v / width;
    let sign = tanh(ratio);
    let effort = |v: f64, sign: f64| robot.joint_effort(j, &at.seen(v, sign));
    let step = QUOTIENT * width;
    let viscous = (effort(at.v + step, sign) - effort(at.v - step, sign)) / (2.0 * step);
    let dry = 0.5 * (effort(at.v, 1.0) - effort(at.v, -1.0));
    // The chord through standstill: it stops a joint but never turns it round, as a tangent would.
    let chord = if ratio.abs() > QUOTIENT { dry * sign / at.v } else { dry / width };
    Resistance { effort: effort(at.v, sign), slope: (viscous + chord - bearable).max(0.0) }
}

/// Inertia among the effects of joint `j` `[kg | kg·m²]`.
pub(super) fn inertia_of_effects(robot: &Robot, j: usize) -> f64 {
    let effort = |a: f64| robot.joint_effort(j, &JointState { a, ..JointState::default() });
    effort(1.0) - effort(0.0)
}
