//! Stiffness and damping of a limb or environment on a link.

use nalgebra::{Matrix3, Vector3};

use super::{Energy, Entry, Law, LinkState, LookAlike, Parameter, PlaceKind, Unit};
use crate::spatial::Pose;

const fn not_negative(name: &'static str, unit: Unit) -> Parameter {
    Parameter { name, unit, lower: 0.0, default: Some(0.0) }
}

const fn any(name: &'static str, unit: Unit) -> Parameter {
    Parameter { name, unit, lower: f64::NEG_INFINITY, default: Some(0.0) }
}

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "limb_impedance",
    sentence: "a limb or the environment holds the link like a spring with a damper",
    equation: "at x y z on the link K·(u − rest) + D·du/dt, u = displacement since the start (m, rotation vector in rad), root frame; \
               K = stiffness in x y z plus the single ones, D likewise; with in_space 1, u and rest in x y z are places in the root frame",
    parameters: &[
        not_negative("stiffness", Unit::EffortPerPosition),
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
        any("rest_x", Unit::Length),
        any("rest_y", Unit::Length),
        any("rest_z", Unit::Length),
        any("rest_rx", Unit::Rad),
        any("rest_ry", Unit::Rad),
        any("rest_rz", Unit::Rad),
        Parameter { name: "in_space", unit: Unit::Share, lower: 0.0, default: Some(0.0) },
        any("x", Unit::Length),
        any("y", Unit::Length),
        any("z", Unit::Length),
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
    let (point, axes) = (Vector3::new(p[21], p[22], p[23]), Matrix3::from(s.axes));
    // From the link's origin to where it is held, now and when the motion began.
    let arm = axes * point;
    let turn = Vector3::new(s.displacement[3], s.displacement[4], s.displacement[5]);
    let before = Pose::from_rotation_vector(&-turn).rotation * arm;
    let by_turning = Vector3::new(s.velocity[3], s.velocity[4], s.velocity[5]).cross(&arm);
    let force = Vector3::from_fn(|i, _| {
        let u = if p[20] > 0.5 { s.position[i] + arm[i] } else { s.displacement[i] + (arm[i] - before[i]) };
        (p[0] + p[2 + i]) * (u - p[14 + i]) + (p[1] + p[8 + i]) * (s.velocity[i] + by_turning[i])
    });
    let moment = arm.cross(&force);
    core::array::from_fn(|i| match i.checked_sub(3) {
        Some(k) => p[2 + i] * (s.displacement[i] - p[14 + i]) + p[8 + i] * s.velocity[i] + moment[k],
        None => force[i],
    })
}
