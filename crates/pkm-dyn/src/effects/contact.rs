//! Something in the way in part of the workspace.

use super::{Energy, Entry, Law, LinkState, LookAlike, Parameter, PlaceKind, Unit};
use crate::math;

/// Catalogue entry.
pub(super) const ENTRY: Entry = Entry {
    name: "contact",
    sentence: "something is in the way in part of the workspace and is pushed there",
    equation: "max(0, stiffness·depth + damping·d(depth)/dt) where depth > 0, depth = side·(x − position); x = q of a joint, n·p of a link's \
               origin in the root frame",
    parameters: &[
        Parameter { name: "stiffness", unit: Unit::EffortPerPosition, lower: 0.0, default: None },
        Parameter { name: "position", unit: Unit::Position, lower: f64::NEG_INFINITY, default: None },
        Parameter { name: "damping", unit: Unit::EffortPerVelocity, lower: 0.0, default: Some(0.0) },
        // +1: beyond the position, −1: below it.
        Parameter { name: "side", unit: Unit::Share, lower: -1.0, default: Some(1.0) },
        Parameter { name: "nx", unit: Unit::Share, lower: -1.0, default: Some(0.0) },
        Parameter { name: "ny", unit: Unit::Share, lower: -1.0, default: Some(0.0) },
        Parameter { name: "nz", unit: Unit::Share, lower: -1.0, default: Some(1.0) },
    ],
    place: PlaceKind::LinkOrJoint,
    look_alikes: &[
        LookAlike { effect: "saturation", experiment: "reach the same effort at another place" },
        LookAlike { effect: "spring", experiment: "cross the position both ways: a contact is nothing on one side" },
        LookAlike { effect: "limb_impedance", experiment: "move away: a contact lets go, a limb pulls" },
    ],
    compensation: "keep references on the free side, or limit the effort towards the contact",
    energy: Energy::Passive,
    law: Law::Wrench(wrench),
};

/// The robot pushes its environment along the direction, away from the free side; it never pulls.
fn wrench(p: &[f64], s: &LinkState) -> [f64; 6] {
    let n = [p[4], p[5], p[6]];
    let length = math::sqrt(n.iter().map(|x| x * x).sum());
    let side = math::sign(p[3]);
    if length <= 0.0 {
        return [0.0; 6];
    }
    let along = |x: &[f64]| n.iter().zip(x).map(|(n, x)| n * x).sum::<f64>() / length;
    let depth = side * (along(&s.position) - p[1]);
    if depth <= 0.0 {
        return [0.0; 6];
    }
    let push = side * (p[0] * depth + p[2] * side * along(&s.velocity[..3])).max(0.0) / length;
    [n[0] * push, n[1] * push, n[2] * push, 0.0, 0.0, 0.0]
}
