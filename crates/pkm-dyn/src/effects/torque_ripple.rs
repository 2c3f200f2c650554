//! Effort periodic in position: cogging, commutation, gear mesh.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};
use crate::math;

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "torque_ripple",
    sentence: "the drive pushes and pulls periodically along the stroke (cogging or gear mesh)",
    equation: "amplitude·sin(order·q + phase)",
    parameters: &[
        Parameter { name: "amplitude", unit: Unit::Effort, lower: 0.0, default: None },
        Parameter { name: "order", unit: Unit::PerPosition, lower: 0.0, default: None },
        Parameter { name: "phase", unit: Unit::Rad, lower: f64::NEG_INFINITY, default: Some(0.0) },
    ],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike {
            effect: "encoder_eccentricity",
            experiment: "repeat unloaded and loaded: an encoder error scales with load gradient, cogging does not",
        },
        LookAlike { effect: "friction_position", experiment: "move both ways: cogging keeps its sign, friction changes it" },
    ],
    compensation: "add the ripple at q_ref to the feed-forward effort",
    energy: Energy::Stores,
    law: Law::JointEffort(effort),
};

fn effort(p: &[f64], s: &JointState) -> f64 {
    p[0] * math::sin(p[1] * s.q + p[2])
}
