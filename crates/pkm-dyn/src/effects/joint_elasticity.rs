//! A transmission or link that gives way under load.

use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Transmission, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "joint_elasticity",
    sentence: "the transmission gives way like a spring, so motor and load part company under load",
    equation: "motor and load joined by stiffness·(q_motor − q) + damping·(v_motor − v); the motor's side carries motor_inertia (0: the rotor's)",
    parameters: &[
        Parameter { name: "stiffness", unit: Unit::EffortPerPosition, lower: 1e-9, default: None },
        Parameter { name: "damping", unit: Unit::EffortPerVelocity, lower: 0.0, default: Some(0.0) },
        Parameter { name: "motor_inertia", unit: Unit::Inertia, lower: 0.0, default: Some(0.0) },
    ],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike { effect: "backlash", experiment: "load the joint with ever more weight: elasticity gives on, play ends at the gap" },
        LookAlike { effect: "actuator_lag", experiment: "sweep the frequency: elasticity resonates, a lag does not" },
        LookAlike { effect: "structure_flexibility", experiment: "accelerate another joint: a soft base moves all of them" },
    ],
    compensation: "shift the motor's reference by tau_ref/stiffness, and keep the loop's bandwidth below the resonance",
    energy: Energy::Passive,
    law: Law::Transmission(Transmission::Spring),
};
