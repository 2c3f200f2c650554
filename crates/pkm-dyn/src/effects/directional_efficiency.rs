//! Gear losses that differ between driving and being driven back.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "directional_efficiency",
    sentence: "the gear loses a share of the load, another when it drives than when it is driven back",
    equation: "load·(1/efficiency_drive − 1) where load·v > 0, load·(efficiency_back − 1) where load·v < 0",
    parameters: &[
        Parameter { name: "efficiency_drive", unit: Unit::Share, lower: 1e-3, default: None },
        // Below zero the gear locks itself: the drive must push to let a load down.
        Parameter { name: "efficiency_back", unit: Unit::Share, lower: f64::NEG_INFINITY, default: None },
    ],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike { effect: "friction_load", experiment: "lift and lower the same weight: load friction is the same both ways" },
        LookAlike { effect: "torque_constant", experiment: "lower a weight: a wrong scale keeps its sign, a loss changes it" },
        LookAlike { effect: "friction_asymmetric", experiment: "turn the arm over, so that the other direction lifts" },
    ],
    compensation: "divide the feed-forward effort by efficiency_drive where it drives, multiply it by efficiency_back where it brakes",
    energy: Energy::Dissipates,
    law: Law::JointEffort(effort),
};

/// Both losses are against the motion: written with its direction, they have a state of rest like dry friction.
fn effort(p: &[f64], s: &JointState) -> f64 {
    let loss = if s.load * s.sign >= 0.0 { 1.0 / p[0] - 1.0 } else { 1.0 - p[1] };
    s.load.abs() * loss * s.sign
}
