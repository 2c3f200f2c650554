//! A wrong effort scale.

use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "torque_constant",
    sentence: "the recorded effort is scaled wrongly (torque constant, gear ratio or amplifier gain)",
    equation: "true effort = scale·recorded",
    parameters: &[Parameter { name: "scale", unit: Unit::One, lower: 1e-6, default: None }],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike { effect: "inertia_error", experiment: "add a known mass: its effect must come out at its true size" },
        LookAlike { effect: "payload", experiment: "add a known mass: its effect must come out at its true size" },
        LookAlike { effect: "friction_viscous", experiment: "coast with the drive off" },
    ],
    compensation: "divide the commanded effort by the scale",
    energy: Energy::Neither,
    law: Law::EffortScale,
};
