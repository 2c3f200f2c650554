//! The zero of a position sensor is wrong.

use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "encoder_offset",
    sentence: "the zero of the position sensor is off",
    equation: "true q = reading + offset",
    parameters: &[Parameter { name: "offset", unit: Unit::Position, lower: f64::NEG_INFINITY, default: None }],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike { effect: "gravity_tilt", experiment: "put an inclinometer on the base, or record in a second base orientation" },
        LookAlike { effect: "spring", experiment: "repeat with the arm in another posture" },
        LookAlike { effect: "geometry_error", experiment: "compare with a platform pose sensor" },
    ],
    compensation: "correct the zero of the sensor",
    energy: Energy::Neither,
    law: Law::PositionOffset,
};
