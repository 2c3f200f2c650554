//! Dry friction that grows with the load the joint transmits.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "friction_load",
    sentence: "friction grows with the load that the joint carries",
    equation: "mu·abs(load)·s, load = effort the rigid model transmits at the joint",
    parameters: &[Parameter { name: "mu", unit: Unit::One, lower: 0.0, default: None }],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike { effect: "friction_coulomb", experiment: "repeat with a known extra mass or in a posture with another gravity load" },
        LookAlike {
            effect: "torque_constant",
            experiment: "move both ways under load: friction changes sign with direction, a wrong scale does not",
        },
        LookAlike { effect: "directional_efficiency", experiment: "visit driving and back-driven quadrants at the same load" },
    ],
    compensation: "add mu·abs(tau_model)·sign(v_ref) to the feed-forward effort",
    energy: Energy::Dissipates,
    law: Law::JointEffort(effort),
};

fn effort(p: &[f64], s: &JointState) -> f64 {
    p[0] * s.load.abs() * s.sign
}
