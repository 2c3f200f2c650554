//! Stiffness and damping of a limb or environment on a link.

use super::{Energy, Entry, Law, LinkState, LookAlike, Parameter, PlaceKind, Unit};

const fn not_negative(name: &'static str, unit: Unit) -> Parameter {
    Parameter { name, unit, lower: 0.0, default: Some(0.0) }
}

const fn rest(name: &'static str, unit: Unit) -> Parameter {
    Parameter { name, unit, lower: f64::NEG_INFINITY, default: Some(0.0) }
}

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "limb_impedance",
    sentence: "a limb or the environment holds the link like a spring with a damper",
    equation: "at the link's origin K·(u − rest) + D·du/dt, u = displacement since the start (m, rotation vector in rad), root frame; \
               K = stiffness in x y z plus the single ones, D likewise",
    parameters: &[
        Parameter { name: "stiffness", unit: Unit::EffortPerPosition, lower: 0.0, default: None },
        not_negative("damping", Unit::EffortPerVelocity),
        not_negative("stiffness_x", Unit::EffortPerPosition),
        not_negative("stiffness_y", Unit::EffortPerPosition),
        not_negative("stiffness_z", Unit::EffortPerPosition),
        not_negative("stiffness_rx", Unit::MomentPerAngle),
        not_negative("stiffness_ry", Unit::MomentPerAngle),
        not_negative("stiffness_rz", Unit::MomentPerAngle),
        not_negative("damping_x", Unit::EffortPerVelocity),
        not_negative("damping_y", Unit::EffortPerVelocity),
        not_negative("damping_z", Unit::EffortPerVelocity),
        not_negative("damping_rx", Unit::MomentPerAngularVelocity),
        not_negative("damping_ry", Unit::MomentPerAngularVelocity),
        not_negative("damping_rz", Unit::MomentPerAngularVelocity),
        rest("rest_x", Unit::Length),
        rest("rest_y", Unit::Length),
        rest("rest_z", Unit::Length),
        rest("rest_rx", Unit::Rad),
        rest("rest_ry", Unit::Rad),
        rest("rest_rz", Unit::Rad),
    ],
    place: PlaceKind::Link,
    look_alikes: &[
        LookAlike { effect: "spring", experiment: "repeat in another posture: a limb is fixed in space, a spring in the joint" },
        LookAlike { effect: "payload", experiment: "hold still at several places: a weight is the same everywhere" },
        LookAlike { effect: "active_limb", experiment: "repeat the same motion: what a limb does by itself does not come back" },
    ],
    compensation: "add Jᵀ of the spring and damper at the reference pose to the feed-forward effort",
    energy: Energy::Passive,
    law: Law::Wrench(wrench),
};

fn wrench(p: &[f64], s: &LinkState) -> [f64; 6] {
    core::array::from_fn(|i| {
        let (k, d) = if i < 3 { (p[0], p[1]) } else { (0.0, 0.0) };
        (k + p[2 + i]) * (s.displacement[i] - p[14 + i]) + (d + p[8 + i]) * s.velocity[i]
    })
}
