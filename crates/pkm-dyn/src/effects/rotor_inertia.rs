//! Inertia of motor and gearing, seen at the joint.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "rotor_inertia",
    sentence: "motor and gearing resist acceleration with an inertia of their own",
    equation: "inertia·a",
    parameters: &[Parameter { name: "inertia", unit: Unit::Inertia, lower: 0.0, default: None }],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike { effect: "inertia_error", experiment: "change posture: the link share of the inertia varies, the rotor share does not" },
        LookAlike { effect: "payload", experiment: "hold still in two postures: a payload has weight, a rotor has none" },
        LookAlike { effect: "joint_elasticity", experiment: "sweep the frequency: elasticity resonates, a rotor does not" },
    ],
    compensation: "add inertia·a_ref to the feed-forward effort",
    energy: Energy::Stores,
    law: Law::JointEffort(effort),
};

fn effort(p: &[f64], s: &JointState) -> f64 {
    p[0] * s.a
}
