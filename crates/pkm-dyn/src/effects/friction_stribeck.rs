//! Extra resistance at creeping speed: a joint at rest needs a push to start, then runs easier.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};
use crate::math;

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "friction_stribeck",
    sentence: "friction is highest when starting and falls as the joint gains speed (Stribeck)",
    equation: "(coulomb + (stiction − coulomb)·exp(−(v/stribeck_velocity)²))·s",
    parameters: &[
        Parameter { name: "coulomb", unit: Unit::Effort, lower: 0.0, default: None },
        Parameter { name: "stiction", unit: Unit::Effort, lower: 0.0, default: None },
        Parameter { name: "stribeck_velocity", unit: Unit::Velocity, lower: 1e-9, default: None },
    ],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike {
            effect: "backlash",
            experiment: "reverse slowly at several amplitudes: play spikes follow position, the friction peak follows speed",
        },
        LookAlike { effect: "time_delay", experiment: "repeat at another speed: a delay spike grows with speed" },
        LookAlike {
            effect: "friction_presliding",
            experiment: "reverse with micrometre amplitudes: pre-sliding forms a loop over position",
        },
    ],
    compensation: "add the friction of v_ref to the feed-forward effort; keep the loop gain below the slope of the falling branch",
    energy: Energy::Dissipates,
    law: Law::JointEffort(effort),
};

fn effort(p: &[f64], s: &JointState) -> f64 {
    let ratio = s.v / p[2];
    (p[0] + (p[1] - p[0]) * math::exp(-ratio * ratio)) * s.sign
}
