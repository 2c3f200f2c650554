//! A transport delay between effort and motion.

use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "time_delay",
    sentence: "motion answers the recorded effort late by a fixed time",
    equation: "acting(t + delay) = recorded(t)",
    parameters: &[Parameter { name: "delay", unit: Unit::Second, lower: f64::NEG_INFINITY, default: None }],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike { effect: "actuator_lag", experiment: "sweep the frequency over a decade: a lag loses amplitude, a delay only phase" },
        LookAlike { effect: "friction_viscous", experiment: "repeat at a fifth of the speed" },
        LookAlike { effect: "backlash", experiment: "reverse at several speeds: play follows position, a delay follows time" },
    ],
    compensation: "predict the reference by the delay, or shorten the sampling period",
    energy: Energy::Neither,
    law: Law::EffortDelay,
};
