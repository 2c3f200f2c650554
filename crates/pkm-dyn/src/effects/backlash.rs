//! Play between motor and load.

use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Transmission, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "backlash",
    sentence: "the transmission has play: the load stays behind until the gap is taken up",
    equation: "abs(q_motor − q) ≤ gap/2; effort passes at both ends only",
    parameters: &[Parameter { name: "gap", unit: Unit::Position, lower: 0.0, default: None }],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike {
            effect: "joint_elasticity",
            experiment: "load the joint with ever more weight: elasticity gives on, play ends at the gap",
        },
        LookAlike {
            effect: "friction_stribeck",
            experiment: "reverse slowly at several amplitudes: play spikes follow position, the friction peak follows speed",
        },
        LookAlike { effect: "time_delay", experiment: "reverse at several speeds: play follows position, a delay follows time" },
    ],
    compensation: "preload the joint, or cross the gap with a short step of the motor at reversals",
    energy: Energy::Passive,
    law: Law::Transmission(Transmission::Play),
};
