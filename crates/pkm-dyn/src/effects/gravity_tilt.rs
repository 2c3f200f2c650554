//! The base does not stand level.

use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};
use crate::model::Model;
use crate::spatial::Pose;

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "gravity_tilt",
    sentence: "the base is not level, so gravity pulls sideways",
    equation: "base turned by Ry(pitch)·Rx(roll), so gravity in the root frame by its transpose",
    parameters: &[
        Parameter { name: "roll", unit: Unit::Rad, lower: f64::NEG_INFINITY, default: Some(0.0) },
        Parameter { name: "pitch", unit: Unit::Rad, lower: f64::NEG_INFINITY, default: Some(0.0) },
    ],
    place: PlaceKind::RootLink,
    look_alikes: &[
        LookAlike { effect: "encoder_offset", experiment: "put an inclinometer on the base, or record in a second base orientation" },
        LookAlike { effect: "spring", experiment: "repeat with the arm in another posture" },
        LookAlike { effect: "payload", experiment: "tilt the base on purpose by a known angle" },
    ],
    compensation: "load the refined robot file: its gravity vector is turned",
    energy: Energy::Stores,
    law: Law::Gravity(apply),
};

fn apply(model: &mut Model, _link: usize, p: &[f64]) {
    // A base turned by +roll, +pitch sees gravity turned the other way.
    let base = Pose::from_xyz_rpy([0.0; 3], [p[0], p[1], 0.0]);
    model.gravity = base.rotation.transpose() * model.gravity;
}
