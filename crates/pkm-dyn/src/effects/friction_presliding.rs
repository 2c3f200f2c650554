//! Friction that gives like a spring before it slides: a loop over position at every reversal.

use super::{Energy, Entry, Law, LookAlike, Memory, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "friction_presliding",
    sentence: "before it slides the joint yields elastically, and where it stops it holds what it was pushed with (pre-sliding)",
    equation: "stiffness·z, dz/dt = v − stiffness·z·abs(v)/coulomb (Dahl)",
    parameters: &[
        Parameter { name: "stiffness", unit: Unit::EffortPerPosition, lower: 0.0, default: None },
        Parameter { name: "coulomb", unit: Unit::Effort, lower: 1e-9, default: None },
    ],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike {
            effect: "friction_coulomb",
            experiment: "reverse with amplitudes below coulomb/stiffness: dry friction sticks, pre-sliding gives way",
        },
        LookAlike {
            effect: "backlash",
            experiment: "reverse by ever smaller amplitudes: the loop of pre-sliding shrinks with them, play does not move at all",
        },
        LookAlike {
            effect: "joint_elasticity",
            experiment: "hold at several loads: elasticity follows the load, pre-sliding the way there",
        },
    ],
    compensation: "add stiffness·z of the reference motion to the feed-forward effort; no sign function is needed",
    energy: Energy::Passive,
    law: Law::Memory(Memory { rate, effort }),
};

/// \[Dahl1968\] with exponent 1: over any motion abs(stiffness·z) stays below coulomb, and at rest z stays.
fn rate(p: &[f64], z: f64, v: f64) -> f64 {
    v - p[0] * z * v.abs() / p[1]
}

fn effort(p: &[f64], z: f64, _v: f64) -> f64 {
    p[0] * z
}
