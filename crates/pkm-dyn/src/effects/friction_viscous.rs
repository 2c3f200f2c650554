//! Damping: effort in proportion to speed.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "friction_viscous",
    sentence: "the joint drags in proportion to its speed",
    equation: "viscous·v",
    parameters: &[Parameter { name: "viscous", unit: Unit::EffortPerVelocity, lower: 0.0, default: None }],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike {
            effect: "time_delay",
            experiment: "repeat the motion at a fifth of the speed: damping shrinks with speed, a delay with frequency",
        },
        LookAlike { effect: "friction_coulomb", experiment: "run at two speeds five times apart: dry friction stays, damping scales" },
        LookAlike { effect: "torque_constant", experiment: "coast with the drive off: damping brakes, a wrong scale does not" },
    ],
    compensation: "add viscous·v_ref to the feed-forward effort",
    energy: Energy::Dissipates,
    law: Law::JointEffort(effort),
};

fn effort(p: &[f64], s: &JointState) -> f64 {
    p[0] * s.v
}
