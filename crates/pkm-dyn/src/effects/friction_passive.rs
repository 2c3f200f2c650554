//! Friction in a joint of a closed chain that no drive moves directly.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "friction_passive",
    sentence: "an unactuated joint of the closed chain rubs, and the drives feel it through the loops",
    equation: "coulomb·s + viscous·v at the passive joint, reaching the drives through Gᵀ",
    parameters: &[
        Parameter { name: "coulomb", unit: Unit::Effort, lower: 0.0, default: Some(0.0) },
        Parameter { name: "viscous", unit: Unit::EffortPerVelocity, lower: 0.0, default: Some(0.0) },
    ],
    place: PlaceKind::PassiveJoint,
    look_alikes: &[
        LookAlike { effect: "friction_coulomb", experiment: "move the same drive in postures where the passive joint turns differently" },
        LookAlike { effect: "friction_load", experiment: "repeat with a known extra mass" },
    ],
    compensation: "add Gᵀ·f(v_passive_ref) to the feed-forward effort",
    energy: Energy::Dissipates,
    law: Law::JointEffort(effort),
};

fn effort(p: &[f64], s: &JointState) -> f64 {
    p[0] * s.sign + p[1] * s.v
}
