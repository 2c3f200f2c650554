//! A position error that repeats with position.

use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "encoder_eccentricity",
    sentence: "the position sensor sits off centre, so its error repeats with every turn",
    equation: "true q = reading + amplitude·sin(order·q + phase)",
    parameters: &[
        Parameter { name: "amplitude", unit: Unit::Position, lower: 0.0, default: None },
        Parameter { name: "order", unit: Unit::PerPosition, lower: 0.0, default: None },
        Parameter { name: "phase", unit: Unit::Rad, lower: f64::NEG_INFINITY, default: Some(0.0) },
    ],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike {
            effect: "torque_ripple",
            experiment: "repeat unloaded and loaded: an encoder error scales with the slope of the load, cogging does not",
        },
        LookAlike { effect: "encoder_offset", experiment: "compare with a second sensor at several positions" },
        LookAlike { effect: "geometry_error", experiment: "compare with a platform pose sensor over a whole turn" },
    ],
    compensation: "correct readings by amplitude·sin(order·q + phase)",
    energy: Energy::Neither,
    law: Law::PositionPeriodic,
};
