//! Smooth force of hoses and cables along the stroke.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "cable_force",
    sentence: "hoses or cables pull smoothly along the stroke",
    equation: "c0 + c1·q + c2·q² + c3·q³ + c4·q⁴",
    parameters: &[
        Parameter { name: "c0", unit: Unit::Effort, lower: f64::NEG_INFINITY, default: Some(0.0) },
        Parameter { name: "c1", unit: Unit::EffortPerPosition, lower: f64::NEG_INFINITY, default: Some(0.0) },
        Parameter { name: "c2", unit: Unit::EffortPerPositionSquared, lower: f64::NEG_INFINITY, default: Some(0.0) },
        Parameter { name: "c3", unit: Unit::EffortPerPositionCubed, lower: f64::NEG_INFINITY, default: Some(0.0) },
        Parameter { name: "c4", unit: Unit::EffortPerPositionFourth, lower: f64::NEG_INFINITY, default: Some(0.0) },
    ],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike { effect: "spring", experiment: "move over the whole stroke: a cable is not a straight line in q" },
        LookAlike { effect: "torque_ripple", experiment: "move over the whole stroke: a cable is long-waved and not periodic" },
        LookAlike { effect: "gravity_tilt", experiment: "route the cables anew: their force changes, gravity does not" },
    ],
    compensation: "add the polynomial at q_ref to the feed-forward effort",
    energy: Energy::Stores,
    law: Law::JointEffort(effort),
};

fn effort(p: &[f64], s: &JointState) -> f64 {
    p.iter().rev().fold(0.0, |sum, c| sum * s.q + c)
}
