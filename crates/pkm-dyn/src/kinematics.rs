//! Forward kinematics of the spanning tree.
//!
//! Two descriptions of motion, each where it is cheaper. In the body's own frame ([`forward_velocities`], [`forward_accelerations`]):
//! inverse dynamics and regressors of the tree. At the root's origin in the root's axes ([`world_velocities`]): Jacobians and everything
//! about loops, where motions of different bodies are compared and so must share one frame.

use nalgebra::Vector3;

use crate::data::Data;
use crate::model::{FrameOnBody, Model, Part};
use crate::spatial::{Motion, Pose};

/// Poses of all bodies in their parents: `data.pose_pb`. What the tree's inverse dynamics needs, and less work than the root's frame.
pub(crate) fn joint_poses(model: &Model, data: &mut Data, q: &[f64]) {
    for (i, (joint, pose)) in model.joints.iter().zip(&mut data.pose_pb).enumerate() {
        *pose = joint.pose(&q[i..]);
    }
}

/// Poses of all bodies in the root frame and the joints' axes there, from tree coordinates `q` `[m | rad]`: `data.pose_pb`,
/// `data.pose_wb`, `data.axis_w`.
#[doc(alias = "forwardKinematics")]
pub fn forward_kinematics(model: &Model, data: &mut Data, q: &[f64]) {
    walk(model, data, q, |data, i, x| data.pose_pb[i] = *x);
}

/// As [`forward_kinematics`], without the poses in parents: what everything in the root's frame needs.
pub(crate) fn root_poses(model: &Model, data: &mut Data, q: &[f64]) {
    walk(model, data, q, |_, _, _| ());
}

#[inline(always)]
fn walk(model: &Model, data: &mut Data, q: &[f64], keep: impl Fn(&mut Data, usize, &Pose)) {
    for (i, joint) in model.joints.iter().enumerate() {
        let x = joint.pose(&q[i..]);
        keep(data, i, &x);
        let in_root = match joint.parent {
            Some(p) => data.pose_wb[p].compose(&x),
            None => x,
        };
        data.pose_wb[i] = in_root;
        let axis = joint.axis_in(&in_root.rotation);
        data.axis_w[i] = match joint.kind {
            crate::model::JointKind::Revolute => Motion { linear: in_root.translation.cross(&axis), angular: axis },
            crate::model::JointKind::Prismatic => Motion { linear: axis, angular: Vector3::zeros() },
        };
    }
}

/// Velocities of all bodies in their own frames from tree velocities `v` `[m/s | rad/s]`: `data.velocity`, and the velocity terms of
/// their accelerations. Call [`forward_kinematics`] first.
pub fn forward_velocities(model: &Model, data: &mut Data, v: &[f64]) {
    let mut whole = Motion::zero();
    for (i, joint) in model.joints.iter().enumerate() {
        let s = joint.motion() * v[i];
        let velocity = match joint.parent {
            Some(p) => data.pose_pb[i].motion_to_local(&data.velocity[p]) + s,
            None => s,
        };
        data.coriolis[i] = velocity_term(joint.part, &velocity, s, &mut whole);
        data.velocity[i] = velocity;
    }
}

/// What a joint's velocity `s` adds to its body's acceleration. A joint of several coordinates adds it all at its last: the bodies
/// before it are massless and their own motion is nobody's business.
#[inline]
fn velocity_term(part: Part, velocity: &Motion, s: Motion, whole: &mut Motion) -> Motion {
    match part {
        Part::Whole => velocity.cross(&s),
        Part::First(_) => {
            *whole = s;
            Motion::zero()
        }
        Part::Inner => {
            *whole += s;
            Motion::zero()
        }
        Part::Last => velocity.cross(&(*whole + s)),
    }
}

/// Accelerations of all bodies in their own frames from tree accelerations `a` `[m/s² | rad/s²]`, with the base accelerated by
/// `-gravity` so that weight needs no further term: `data.acceleration`. Call [`forward_velocities`] first.
pub fn forward_accelerations(model: &Model, data: &mut Data, a: &[f64]) {
    let base = Motion { linear: -model.gravity, angular: Vector3::zeros() };
    for (i, joint) in model.joints.iter().enumerate() {
        let parent = joint.parent.map_or(base, |p| data.acceleration[p]);
        data.acceleration[i] = data.pose_pb[i].motion_to_local(&parent) + joint.motion() * a[i] + data.coriolis[i];
    }
}

/// Velocities of all bodies at the root's origin, and the velocity terms each joint adds there: `data.velocity_w`, `data.coriolis_w`.
/// `v` `[m/s | rad/s]`, nv. Call [`forward_kinematics`] first.
pub fn world_velocities(model: &Model, data: &mut Data, v: &[f64]) {
    let mut whole = Motion::zero();
    for (i, joint) in model.joints.iter().enumerate() {
        let s = data.axis_w[i] * v[i];
        let velocity = match joint.parent {
            Some(p) => data.velocity_w[p] + s,
            None => s,
        };
        data.coriolis_w[i] = velocity_term(joint.part, &velocity, s, &mut whole);
        data.velocity_w[i] = velocity;
    }
}

/// Accelerations of all bodies at the root's origin, the base accelerated by `base` `[m/s²]`: `data.acceleration_w`. `a`
/// `[m/s² | rad/s²]`, nv. Call [`world_velocities`] first.
pub fn world_accelerations(model: &Model, data: &mut Data, a: &[f64], base: &Vector3<f64>) {
    let base = Motion { linear: *base, angular: Vector3::zeros() };
    for (i, joint) in model.joints.iter().enumerate() {
        let parent = joint.parent.map_or(base, |p| data.acceleration_w[p]);
        data.acceleration_w[i] = parent + data.axis_w[i] * a[i] + data.coriolis_w[i];
    }
}

/// Pose of a frame in the root frame. Call [`forward_kinematics`] first.
#[must_use]
#[doc(alias = "updateFramePlacement")]
pub fn frame_pose(data: &Data, frame: &FrameOnBody) -> Pose {
    frame.body.map_or(frame.pose, |b| data.pose_wb[b].compose(&frame.pose))
}

/// Origin of a frame in the root frame `[m]`. Call [`forward_kinematics`] first.
#[must_use]
#[inline]
pub fn frame_point(data: &Data, frame: &FrameOnBody) -> Vector3<f64> {
    frame.body.map_or(frame.pose.translation, |b| data.pose_wb[b].transform_point(&frame.pose.translation))
}

/// Velocity of a frame's origin in the root's axes `[m/s]`, `[rad/s]` (Pinocchio's `LOCAL_WORLD_ALIGNED`). Call [`world_velocities`] first.
#[must_use]
#[doc(alias = "getFrameVelocity")]
pub fn frame_velocity(data: &Data, frame: &FrameOnBody) -> Motion {
    frame.body.map_or_else(Motion::zero, |b| data.velocity_w[b].at(&frame_point(data, frame)))
}

/// Acceleration of a frame's origin in the root's axes `[m/s²]`, `[rad/s²]`: the second derivative of its position. Call
/// [`world_accelerations`] first, with base at rest: `Vector3::zeros()`.
#[must_use]
#[doc(alias = "getFrameClassicalAcceleration")]
pub fn frame_acceleration(data: &Data, frame: &FrameOnBody) -> Motion {
    let Some(b) = frame.body else { return Motion::zero() };
    let p = frame_point(data, frame);
    let (v, a) = (data.velocity_w[b].at(&p), data.acceleration_w[b].at(&p));
    Motion { linear: a.linear + v.angular.cross(&v.linear), angular: a.angular }
}
