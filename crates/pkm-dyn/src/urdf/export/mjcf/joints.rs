//! Joints as MuJoCo has them, and their coordinates in the closed assembly.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::super::joints::{JointPhysics, physics};
use super::super::numbers;
use super::bodies::{Body, JointInBody, compound};
use crate::configuration::quaternion;
use crate::effects::Robot;
use crate::model::{Compound, Joint, JointKind, Model};

/// What a coordinate of the model becomes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shape {
    Hinge,
    Slide,
    /// Three turns at once, from this coordinate on: a velocity in the body's own frame, as in the model.
    Ball,
    /// All six at once: MuJoCo has it for bodies on the world alone.
    Free,
    /// A coordinate of a ball or free joint that is written already.
    Within,
}

fn shape(model: &Model, j: usize) -> Shape {
    let is_turn = model.joints[j].kind == JointKind::Revolute;
    match compound(model, j) {
        Some((first, Compound::Free)) if model.joints[first].parent.is_none() => {
            if j == first {
                Shape::Free
            } else {
                Shape::Within
            }
        }
        Some((first, c)) if is_turn && c != Compound::Planar => {
            if j == first + c.n() - 3 {
                Shape::Ball
            } else {
                Shape::Within
            }
        }
        _ if is_turn => Shape::Hinge,
        _ => Shape::Slide,
    }
}

/// Attributes of the joints of a body, in order.
pub(super) fn attributes(robot: &Robot, body: &Body) -> Vec<Vec<(&'static str, String)>> {
    let model = &robot.model;
    let write = |j: &JointInBody| {
        let joint = &model.joints[j.joint];
        let (kind, has_axis) = match shape(model, j.joint) {
            Shape::Hinge => ("hinge", true),
            Shape::Slide => ("slide", true),
            Shape::Ball => ("ball", false),
            Shape::Free => ("free", false),
            Shape::Within => return None,
        };
        let several = joint.name.rsplit_once('.').map_or(joint.name.as_str(), |(name, _)| name);
        let name = if has_axis { joint.name.as_str() } else { several };
        let mut out = vec![("name", name.to_string()), ("type", kind.to_string())];
        if kind != "free" && j.pos != Vector3::zeros() {
            out.push(("pos", numbers(j.pos.as_slice())));
        }
        if has_axis {
            out.push(("axis", numbers(j.axis.as_slice())));
        }
        out.extend(range(joint));
        out.extend(resistance(&physics(robot, j.joint)));
        Some(out)
    };
    body.joints.iter().filter_map(write).collect()
}

/// MuJoCo's coordinates of a body's joints for the model's `[m | rad]`.
pub(super) fn coordinates(model: &Model, body: &Body, q: &[f64]) -> Vec<f64> {
    let of = |j: &JointInBody| match shape(model, j.joint) {
        Shape::Hinge | Shape::Slide => vec![q[j.joint]],
        Shape::Ball => {
            let [x, y, z, w] = quaternion([q[j.joint], q[j.joint + 1], q[j.joint + 2]]);
            vec![w, x, y, z]
        }
        Shape::Free => {
            let pose = model.joints[j.joint].placement.compose(&Compound::Free.pose(&q[j.joint..]));
            [pose.translation.as_slice(), &turned(&pose.rotation)].concat()
        }
        Shape::Within => Vec::new(),
    };
    body.joints.iter().flat_map(of).collect()
}

/// A rotation as MuJoCo's quaternion w x y z.
pub(super) fn turned(rotation: &Matrix3<f64>) -> [f64; 4] {
    let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*rotation));
    [q.w, q.i, q.j, q.k]
}

/// A joint whose stated travel has no length: MuJoCo refuses it.
pub(super) fn is_stuck(joint: &Joint) -> bool {
    joint.limits.lower.is_finite() && joint.limits.upper <= joint.limits.lower
}

fn range(joint: &Joint) -> Option<(&'static str, String)> {
    let l = joint.limits;
    let is_limited = l.lower.is_finite() && l.upper.is_finite() && !is_stuck(joint);
    is_limited.then(|| ("range", numbers(&[l.lower, l.upper])))
}

fn resistance(p: &JointPhysics) -> Vec<(&'static str, String)> {
    let stated = [("armature", p.armature), ("damping", p.viscous), ("frictionloss", p.coulomb), ("stiffness", p.stiffness)];
    let mut out: Vec<(&str, String)> = stated.into_iter().filter(|(_, x)| x.abs() > 0.0).map(|(key, x)| (key, numbers(&[x]))).collect();
    if p.stiffness.abs() > 0.0 {
        out.push(("springref", numbers(&[p.rest()])));
    }
    out
}
