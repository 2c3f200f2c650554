//! Effort clipped below what was commanded.

use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "saturation",
    sentence: "the drive gives no more than a limit, whatever was commanded",
    equation: "acting = recorded, clipped at ± limit",
    parameters: &[Parameter { name: "limit", unit: Unit::Effort, lower: 0.0, default: None }],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike { effect: "torque_constant", experiment: "repeat at half the effort: clipping vanishes, a wrong scale stays" },
        LookAlike { effect: "dead_zone", experiment: "repeat at half the effort: a dead zone matters more, clipping less" },
        LookAlike { effect: "contact", experiment: "reach the same effort at another place" },
    ],
    compensation: "slow the reference until its effort stays below the limit, and stop integrators there",
    energy: Energy::Neither,
    law: Law::EffortLimit,
};
