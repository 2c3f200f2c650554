//! A recorded command that the stated controller has not computed.

use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "controller_mismatch",
    sentence: "the recorded command is not what the stated controller computes",
    equation: "recorded command = (1 − share)·the controller's",
    parameters: &[Parameter { name: "share", unit: Unit::Share, lower: -1.0, default: None }],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike {
            effect: "torque_constant",
            experiment: "replay the controller on the recorded signals: plant physics leave its command alone",
        },
        LookAlike { effect: "saturation", experiment: "replay the controller on the recorded signals at half the effort" },
    ],
    compensation: "correct controller.toml: the gains or filters that run are others",
    energy: Energy::Neither,
    law: Law::CommandShare,
};
