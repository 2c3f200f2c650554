//! Small efforts that have no effect.

use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "dead_zone",
    sentence: "small commands do nothing, larger ones lose a constant",
    equation: "acting = 0 within ± width/2, recorded ∓ width/2 beyond",
    parameters: &[Parameter { name: "width", unit: Unit::Effort, lower: 0.0, default: None }],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike {
            effect: "friction_coulomb",
            experiment: "hold a weight and move both ways: a dead zone follows the sign of the effort, friction that of the motion",
        },
        LookAlike { effect: "saturation", experiment: "repeat at half the effort: a dead zone matters more, clipping less" },
        LookAlike { effect: "torque_constant", experiment: "repeat at half the effort: a wrong scale stays the same share" },
    ],
    compensation: "add half the width in the direction of the command",
    energy: Energy::Neither,
    law: Law::EffortDeadZone,
};
