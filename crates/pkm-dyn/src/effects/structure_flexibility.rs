//! A base or frame that gives way to reactions.

use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "structure_flexibility",
    sentence: "the base or frame gives way to the robot's reactions",
    equation: "the link is carried by stiffness·u + damping·du/dt in all three directions, u = its displacement",
    parameters: &[
        Parameter { name: "stiffness", unit: Unit::EffortPerPosition, lower: 1e-9, default: None },
        Parameter { name: "damping", unit: Unit::EffortPerVelocity, lower: 0.0, default: Some(0.0) },
    ],
    place: PlaceKind::Link,
    look_alikes: &[
        LookAlike { effect: "joint_elasticity", experiment: "accelerate another joint: a soft base moves all of them" },
        LookAlike { effect: "gravity_tilt", experiment: "hold still in two postures and compare an inclinometer on the base" },
        LookAlike { effect: "inertia_error", experiment: "put an accelerometer on the base" },
    ],
    compensation: "stiffen the base, or keep reference accelerations below its resonance",
    energy: Energy::Passive,
    law: Law::Structure,
};
