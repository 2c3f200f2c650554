//! Damping that changes as the joint warms up.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "friction_thermal",
    sentence: "damping changes as the joint warms up or runs in",
    equation: "viscous·rate·warmth·v, viscous = the joint's nominal damping, warmth = T − T0 or running time; damping never below 0",
    parameters: &[Parameter { name: "rate", unit: Unit::PerWarmth, lower: f64::NEG_INFINITY, default: None }],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike { effect: "friction_viscous", experiment: "repeat the first period at the end: damping alone has not changed" },
        LookAlike { effect: "sensor_drift", experiment: "stand still for a minute: a drift goes on, damping needs motion" },
        LookAlike { effect: "friction_quadratic", experiment: "sweep the speeds cold and again warm" },
    ],
    compensation: "warm the joint up before work, or schedule viscous with temperature",
    energy: Energy::Dissipates,
    law: Law::JointEffort(effort),
};

/// What the effect adds to the nominal damping; it cannot take away more than all of it.
fn effort(p: &[f64], s: &JointState) -> f64 {
    s.viscous * (p[0] * s.warmth).max(-1.0) * s.v
}
