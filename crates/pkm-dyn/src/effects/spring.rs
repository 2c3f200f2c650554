//! A spring or counterbalance at a joint.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "spring",
    sentence: "a spring pulls the joint towards a rest position",
    equation: "stiffness·(q − rest)",
    parameters: &[
        Parameter { name: "stiffness", unit: Unit::EffortPerPosition, lower: f64::NEG_INFINITY, default: None },
        Parameter { name: "rest", unit: Unit::Position, lower: f64::NEG_INFINITY, default: Some(0.0) },
    ],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike { effect: "gravity_tilt", experiment: "repeat with the arm in another posture: gravity changes, a spring does not" },
        LookAlike { effect: "encoder_offset", experiment: "compare with a second sensor or the platform pose" },
        LookAlike { effect: "cable_force", experiment: "move over the whole stroke: a cable is not a straight line in q" },
    ],
    compensation: "add stiffness·(q_ref − rest) to the feed-forward effort",
    energy: Energy::Stores,
    law: Law::JointEffort(effort),
};

fn effort(p: &[f64], s: &JointState) -> f64 {
    p[0] * (s.q - p[1])
}
