//! Forward kinematics of the spanning tree.

use crate::data::Data;
use crate::model::Model;
use crate::spatial::Motion;

/// Poses of all bodies in the root frame from tree coordinates `q` `[m | rad]`: `data.pose_wb`.
#[doc(alias = "forwardKinematics")]
pub fn forward_kinematics(model: &Model, data: &mut Data, q: &[f64]) {
    for (i, joint) in model.joints.iter().enumerate() {
        let x = joint.pose(q[i]);
        data.pose_pb[i] = x;
        data.pose_wb[i] = match joint.parent {
            Some(p) => data.pose_wb[p].compose(&x),
            None => x,
        };
    }
}

/// Velocities of all bodies from tree velocities `v` `[m/s | rad/s]`, and their accelerations at zero joint acceleration and no
/// gravity: `data.velocity`, `data.bias`. Call [`forward_kinematics`] first.
pub fn forward_velocities(model: &Model, data: &mut Data, v: &[f64]) {
    for (i, joint) in model.joints.iter().enumerate() {
        let s = joint.motion() * v[i];
        let (v_parent, b_parent) = match joint.parent {
            Some(p) => (data.velocity[p], data.bias[p]),
            None => (Motion::zero(), Motion::zero()),
        };
        let x = &data.pose_pb[i];
        let velocity = x.motion_to_local(&v_parent) + s;
        data.coriolis[i] = velocity.cross(&s);
        data.bias[i] = x.motion_to_local(&b_parent) + data.coriolis[i];
        data.velocity[i] = velocity;
    }
}

/// Accelerations of all bodies from tree accelerations `a` `[m/s² | rad/s²]`, with the base accelerated by `-gravity` so that weight
/// needs no further term: `data.acceleration`. Call [`forward_velocities`] first.
pub fn forward_accelerations(model: &Model, data: &mut Data, a: &[f64]) {
    let base = Motion { linear: -model.gravity, angular: nalgebra::Vector3::zeros() };
    for (i, joint) in model.joints.iter().enumerate() {
        let parent = joint.parent.map_or(base, |p| data.acceleration[p]);
        data.acceleration[i] = data.pose_pb[i].motion_to_local(&parent) + joint.motion() * a[i] + data.coriolis[i];
    }
}
