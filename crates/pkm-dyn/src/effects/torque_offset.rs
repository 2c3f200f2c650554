//! A constant bias of the recorded effort.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "torque_offset",
    sentence: "the recorded effort is off by a constant",
    equation: "offset",
    parameters: &[Parameter { name: "offset", unit: Unit::Effort, lower: f64::NEG_INFINITY, default: None }],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike { effect: "inertia_error", experiment: "change posture: a weight error changes with posture, an offset does not" },
        LookAlike { effect: "friction_asymmetric", experiment: "run at two speeds: an offset does not depend on speed" },
        LookAlike { effect: "gravity_tilt", experiment: "record with the base level and tilted" },
    ],
    compensation: "add the offset to the command",
    energy: Energy::Neither,
    law: Law::JointEffort(effort),
};

fn effort(p: &[f64], _: &JointState) -> f64 {
    p[0]
}
