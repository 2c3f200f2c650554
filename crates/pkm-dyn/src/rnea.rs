//! Recursive Newton-Euler: inverse dynamics of the spanning tree.

use crate::data::Data;
use crate::kinematics::{forward_accelerations, forward_kinematics, forward_velocities};
use crate::model::Model;

/// Generalized efforts of the tree for a motion, `tau = M(q)·a + nle(q, v)` `[N | N·m]`, nv.
///
/// Rotor inertia ([`crate::model::Joint::armature`]) is included, friction is not. `q` `[m | rad]`, `v` `[m/s | rad/s]`,
/// `a` `[m/s² | rad/s²]`, nv each. `rnea(q, v, 0)` is `nle`, `rnea(q, 0, 0)` is gravity [Featherstone2008, table 5.1].
pub fn rnea<'d>(model: &Model, data: &'d mut Data, q: &[f64], v: &[f64], a: &[f64]) -> &'d [f64] {
    forward_kinematics(model, data, q);
    forward_velocities(model, data, v);
    forward_accelerations(model, data, a);
    rnea_backward(model, data, a);
    &data.tau
}

/// The backward pass alone, on kinematics already in `data`.
pub(crate) fn rnea_backward(model: &Model, data: &mut Data, a: &[f64]) {
    for (i, body) in model.bodies.iter().enumerate() {
        let inertia = body.inertia();
        let momentum = inertia.apply(&data.velocity[i]);
        data.force[i] = inertia.apply(&data.acceleration[i]) + data.velocity[i].cross_force(&momentum);
    }
    for i in (0..model.nv()).rev() {
        let joint = &model.joints[i];
        data.tau[i] = joint.motion().dot(&data.force[i]) + joint.armature * a[i];
        if let Some(p) = joint.parent {
            let carried = data.pose_pb[i].force_to_parent(&data.force[i]);
            data.force[p] += carried;
        }
    }
}
