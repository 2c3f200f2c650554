//! Dry friction: a constant effort against the motion.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "friction_coulomb",
    sentence: "a constant dry friction opposes the motion",
    equation: "coulomb·s",
    parameters: &[Parameter { name: "coulomb", unit: Unit::Effort, lower: 0.0, default: None }],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike { effect: "torque_offset", experiment: "move in both directions: friction changes sign, an offset does not" },
        LookAlike { effect: "friction_load", experiment: "repeat with a known extra mass: dry friction stays, load friction grows" },
        LookAlike { effect: "friction_stribeck", experiment: "creep at constant speeds below a tenth of the working speed" },
    ],
    compensation: "add coulomb·sign(v_ref) to the feed-forward effort, smoothed near standstill",
    energy: Energy::Dissipates,
    law: Law::JointEffort(effort),
};

fn effort(p: &[f64], s: &JointState) -> f64 {
    p[0] * s.sign
}
