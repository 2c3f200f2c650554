//! Dry friction that varies along the stroke.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "friction_position",
    sentence: "dry friction differs along the stroke (a bent screw, a tight or worn spot)",
    equation: "(coulomb + coulomb_slope·x + coulomb_quadratic·x² + coulomb_cubic·x³)·s, x = q − q0; with the joint's nominal Coulomb friction never below 0",
    parameters: &[
        Parameter { name: "coulomb_slope", unit: Unit::EffortPerPosition, lower: f64::NEG_INFINITY, default: None },
        Parameter { name: "q0", unit: Unit::Position, lower: f64::NEG_INFINITY, default: Some(0.0) },
        Parameter { name: "coulomb", unit: Unit::Effort, lower: f64::NEG_INFINITY, default: Some(0.0) },
        Parameter { name: "coulomb_quadratic", unit: Unit::EffortPerPositionSquared, lower: f64::NEG_INFINITY, default: Some(0.0) },
        Parameter { name: "coulomb_cubic", unit: Unit::EffortPerPositionCubed, lower: f64::NEG_INFINITY, default: Some(0.0) },
    ],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike { effect: "friction_load", experiment: "repeat with a known extra mass: friction along the stroke stays" },
        LookAlike { effect: "torque_ripple", experiment: "move both ways: friction changes its sign, cogging keeps it" },
        LookAlike { effect: "friction_coulomb", experiment: "move in a short stroke at several places" },
    ],
    compensation: "add the friction at q_ref times sign(v_ref) to the feed-forward effort",
    energy: Energy::Dissipates,
    law: Law::JointEffort(effort),
};

/// A falling line takes away no more than the friction that is there.
fn effort(p: &[f64], s: &JointState) -> f64 {
    let x = s.q - p[1];
    let level = p[2] + x * (p[0] + x * (p[3] + x * p[4]));
    level.max(-s.coulomb) * s.sign
}
