//! Drag that grows faster, or slower, than speed.

use super::JointState;
use super::{Energy, Entry, Law, LookAlike, Parameter, PlaceKind, Unit};
use crate::math;

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "friction_quadratic",
    sentence: "drag grows with a power of speed that is not one (churning oil or air; concave below one)",
    equation: "drag·abs(v)^exponent·s",
    parameters: &[
        Parameter { name: "drag", unit: Unit::Drag, lower: 0.0, default: None },
        Parameter { name: "exponent", unit: Unit::One, lower: 0.0, default: Some(2.0) },
    ],
    place: PlaceKind::Joint,
    look_alikes: &[
        LookAlike { effect: "friction_viscous", experiment: "run at three constant speeds: a straight line through zero is viscous" },
        LookAlike { effect: "friction_stribeck", experiment: "creep below a tenth of the working speed: a concave drag has no peak there" },
        LookAlike { effect: "friction_thermal", experiment: "sweep the speeds at one temperature, up and down again" },
    ],
    compensation: "add drag·abs(v_ref)^exponent·sign(v_ref) to the feed-forward effort",
    energy: Energy::Dissipates,
    law: Law::JointEffort(effort),
};

fn effort(p: &[f64], s: &JointState) -> f64 {
    p[0] * math::powf(s.v.abs(), p[1]) * s.sign
}
