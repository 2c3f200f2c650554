//! Friction that differs with the direction of motion.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "friction_asymmetric",
    sentence: "friction differs between the two directions of motion",
    equation: "coulomb_pos·s + viscous_pos·v for v > 0, coulomb_neg·s + viscous_neg·v for v < 0",
    parameters: &[
        Parameter { name: "coulomb_pos", unit: Unit::Effort, lower: 0.0, default: None },
        Parameter { name: "coulomb_neg", unit: Unit::Effort, lower: 0.0, default: None },
        Parameter { name: "viscous_pos", unit: Unit::EffortPerVelocity, lower: 0.0, default: Some(0.0) },
        Parameter { name: "viscous_neg", unit: Unit::EffortPerVelocity, lower: 0.0, default: Some(0.0) },
    ],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike {
            effect: "torque_offset",
            experiment: "mirror the motion: an offset keeps its sign at every speed, asymmetric damping grows with speed",
        },
        LookAlike {
            effect: "inertia_error",
            experiment: "repeat in another posture: a gravity error changes with posture, friction does not",
        },
        LookAlike { effect: "spring", experiment: "repeat about another centre position: a spring follows position" },
    ],
    compensation: "add the friction of the reference direction to the feed-forward effort",
    energy: Energy::Dissipates,
    law: Law::JointEffort(effort),
};

fn effort(p: &[f64], s: &JointState) -> f64 {
    let (coulomb, viscous) = if s.v >= 0.0 { (p[0], p[2]) } else { (p[1], p[3]) };
    coulomb * s.sign + viscous * s.v
}
