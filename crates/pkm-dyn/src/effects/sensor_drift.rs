//! A reading that drifts with time.

use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "sensor_drift",
    sentence: "a reading drifts away from the truth as time goes on",
    equation: "reading = true value + rate·t; of a joint its position, of a sensor every component",
    parameters: &[Parameter { name: "rate", unit: Unit::ReadingPerSecond, lower: f64::NEG_INFINITY, default: None }],
    place: PlaceKind::JointOrSensor,
    look_alikes: &[
        LookAlike { effect: "friction_thermal", experiment: "stand still for a minute: a drift goes on, damping needs motion" },
        LookAlike { effect: "encoder_offset", experiment: "repeat the first period at the end: an offset has not changed" },
    ],
    compensation: "zero the sensor again before each recording",
    energy: Energy::Neither,
    law: Law::Drift,
};
