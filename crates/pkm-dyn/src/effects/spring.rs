//! A spring or counterbalance at a joint.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};
use crate::math;

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "spring",
    sentence: "a spring pulls the joint towards a rest position",
    equation: "stiffness·(q − rest), on a lever stiffness·sin(curvature·(q − rest))/curvature",
    parameters: &[
        Parameter { name: "stiffness", unit: Unit::EffortPerPosition, lower: f64::NEG_INFINITY, default: None },
        Parameter { name: "rest", unit: Unit::Position, lower: f64::NEG_INFINITY, default: Some(0.0) },
        Parameter { name: "curvature", unit: Unit::PerPosition, lower: 0.0, default: Some(0.0) },
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

/// A spring that pulls on a crank goes with the sine of the angle: the one of a counterbalance, with `curvature` 1 at a revolute joint.
fn effort(p: &[f64], s: &JointState) -> f64 {
    let away = s.q - p[1];
    if p[2] > 0.0 { p[0] * math::sin(p[2] * away) / p[2] } else { p[0] * away }
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
}
