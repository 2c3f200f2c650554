//! The drive follows its command with a first-order lag.

use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "actuator_lag",
    sentence: "the drive answers with a lag: its bandwidth is finite",
    equation: "time_constant·d(acting)/dt + acting = recorded",
    parameters: &[Parameter { name: "time_constant", unit: Unit::Second, lower: 0.0, default: None }],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike { effect: "time_delay", experiment: "sweep the frequency over a decade: a lag loses amplitude, a delay only phase" },
        LookAlike { effect: "friction_viscous", experiment: "repeat at a fifth of the speed" },
        LookAlike { effect: "joint_elasticity", experiment: "sweep the frequency: elasticity resonates" },
    ],
    compensation: "lead the command by time_constant·d(tau_ref)/dt",
    energy: Energy::Neither,
    law: Law::EffortLag,
};
