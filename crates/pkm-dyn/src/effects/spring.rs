//! A spring or counterbalance at a joint.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};
use crate::math;

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "spring",
    sentence: "a spring pulls the joint towards a rest position",
    equation: "stiffness·(q − rest); bent by a curvature, stiffness·sin(curvature·(q − rest))/curvature on a lever, with sinh where it is below zero",
    parameters: &[
        Parameter { name: "stiffness", unit: Unit::EffortPerPosition, lower: f64::NEG_INFINITY, default: None },
        Parameter { name: "rest", unit: Unit::Position, lower: f64::NEG_INFINITY, default: Some(0.0) },
        Parameter { name: "curvature", unit: Unit::PerPosition, lower: f64::NEG_INFINITY, default: Some(0.0) },
    ],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike { effect: "gravity_tilt", experiment: "repeat with the arm in another posture: gravity changes, a spring does not" },
        LookAlike { effect: "encoder_offset", experiment: "compare with a second sensor or the platform pose" },
        LookAlike { effect: "cable_force", experiment: "move over the whole stroke: a cable is not a straight line in q" },
    ],
    compensation: "add the spring at q_ref to the feed-forward effort",
    energy: Energy::Stores,
    law: Law::JointEffort(effort),
};

fn effort(p: &[f64], s: &JointState) -> f64 {
    p[0] * bent_away(s.q - p[1], p[2])
}

/// How far a spring is pulled, as its effort has it, when its end is `away` from rest `[m | rad]`, with a `curvature` `[1/m | 1/rad]`.
///
/// A spring that pulls on a crank goes with the sine of the angle: the one of a counterbalance, with `curvature` 1 at a revolute joint. One that
/// hardens the farther it is pulled has a `curvature` below zero and goes with the hyperbolic sine: it is twice as stiff as at rest where
/// `curvature·away` is 1.3.
#[must_use]
pub fn bent_away(away: f64, curvature: f64) -> f64 {
    if curvature > 0.0 {
        math::sin(curvature * away) / curvature
    } else if curvature < 0.0 {
        math::sinh(curvature * away) / curvature
    } else {
        away
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spring_on_a_lever_is_linear_near_its_rest_and_lets_go_past_the_top() {
        let at = |q: f64, curvature: f64| effort(&[40.0, 0.3, curvature], &JointState { q, ..JointState::default() });
        assert!((at(0.301, 1.0) - at(0.301, 0.0)).abs() < 1e-8, "a sine of a thousandth differs in the third power");
        assert!((at(0.3 + core::f64::consts::FRAC_PI_2, 1.0) - 40.0).abs() < 1e-12);
        assert!(at(0.3 + core::f64::consts::PI, 1.0).abs() < 1e-12, "dead centre");
    }

    #[test]
    fn a_spring_that_hardens_is_linear_near_its_rest_and_pulls_alike_both_ways() {
        assert!((bent_away(1e-3, -2.0) - 1e-3).abs() < 1e-8);
        // sinh(1)/1 = (e − 1/e)/2; its slope is cosh, 2 at acosh(2) = ln(2 + √3).
        assert!((bent_away(0.5, -2.0) - 0.5 * 0.5 * (core::f64::consts::E - 1.0 / core::f64::consts::E)).abs() < 1e-15);
        assert!((bent_away(-0.5, -2.0) + bent_away(0.5, -2.0)).abs() < 1e-15);
        let at = math::ln(2.0 + math::sqrt(3.0)) / 2.0;
        assert!((bent_away(at + 1e-6, -2.0) - bent_away(at - 1e-6, -2.0) - 2.0 * 2e-6).abs() < 1e-12);
    }
}
