//! A drive that is felt at another joint.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "transmission_coupling",
    sentence: "a part of the transmission turns with two joints, and both feel its inertia and friction",
    equation: "inertia·(a1 + a2) + coulomb·sign(v1 + v2) + viscous·(v1 + v2), at both joints",
    parameters: &[
        Parameter { name: "inertia", unit: Unit::Inertia, lower: 0.0, default: Some(0.0) },
        Parameter { name: "coulomb", unit: Unit::Effort, lower: 0.0, default: Some(0.0) },
        Parameter { name: "viscous", unit: Unit::EffortPerVelocity, lower: 0.0, default: Some(0.0) },
    ],
    place: PlaceKind::JointPair,
    look_alikes: &[
        LookAlike {
            effect: "inertia_error",
            experiment: "move one joint in several postures of the other: link inertia varies, coupling does not",
        },
        LookAlike {
            effect: "friction_coulomb",
            experiment: "move one joint while the other stands, then both against each other: coupled friction vanishes",
        },
        LookAlike { effect: "rotor_inertia", experiment: "accelerate one joint and watch the effort of the other" },
    ],
    compensation: "add the term of v1_ref + v2_ref and a1_ref + a2_ref to the feed-forward of both drives",
    energy: Energy::Passive,
    law: Law::PairEffort(effort),
};

fn effort(p: &[f64], s: &JointState) -> f64 {
    p[0] * s.a + p[1] * s.sign + p[2] * s.v
}
