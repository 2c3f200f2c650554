//! Friction and all other efforts of joints for an engine that knows none: dry friction smoothed, and a slope that keeps it stable.

use pkm_dyn::effects::{JointState, Robot};
use pkm_dyn::math::tanh;

/// Friction is taken implicitly below this many smoothing speeds, and less and less above: there the explicit effort is of second order.
const IMPLICIT_BELOW: f64 = 10.0;

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
pub(super) fn resistance(robot: &Robot, j: usize, at: At, width: f64) -> Resistance {
    let ratio = at.v / width;
    let sign = tanh(ratio);
    let effort = |v: f64, sign: f64| robot.joint_effort(j, &JointState { q: at.q, v, a: 0.0, sign, load: at.load });
    let step = QUOTIENT * width;
    let viscous = (effort(at.v + step, sign) - effort(at.v - step, sign)) / (2.0 * step);
    let dry = 0.5 * (effort(at.v, 1.0) - effort(at.v, -1.0));
    // The chord through standstill: it stops a joint but never turns it round, as a tangent would.
    let chord = if ratio.abs() > QUOTIENT { dry * sign / at.v } else { dry / width };
    let far = ratio / IMPLICIT_BELOW;
    // Half of what is viscous: the mean of the velocities before and after.
    let slope = 0.5 * viscous + chord / (1.0 + far * far);
    Resistance { effort: effort(at.v, sign), slope: slope.max(0.0) }
}

/// Inertia among the effects of joint `j` `[kg | kg·m²]`.
pub(super) fn inertia_of_effects(robot: &Robot, j: usize) -> f64 {
    let effort = |a: f64| robot.joint_effort(j, &JointState { a, ..JointState::default() });
    effort(1.0) - effort(0.0)
}
