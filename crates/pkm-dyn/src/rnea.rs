//! Recursive Newton-Euler: inverse dynamics of the spanning tree.

use crate::data::Data;
use crate::kinematics::{forward_accelerations, forward_velocities, joint_poses};
use crate::model::Model;
use crate::spatial::Force;

/// Generalized efforts of the tree for a motion, `tau = M(q)·a + nle(q, v)` `[N | N·m]`, nv.
///
/// Rotor inertia ([`crate::model::Joint::armature`]) is included, friction is not. `q` `[m | rad]`, `v` `[m/s | rad/s]`,
/// `a` `[m/s² | rad/s²]`, nv each [Featherstone2008, table 5.1].
pub fn rnea<'d>(model: &Model, data: &'d mut Data, q: &[f64], v: &[f64], a: &[f64]) -> &'d [f64] {
    joint_poses(model, data, q);
    forward_velocities(model, data, v);
    forward_accelerations(model, data, a);
    backward(model, data, a);
    &data.tau
}

/// Coriolis, centrifugal and gravity efforts of the tree, `nle(q, v) = rnea(q, v, 0)` `[N | N·m]`, nv.
#[doc(alias = "nonLinearEffects")]
pub fn nle<'d>(model: &Model, data: &'d mut Data, q: &[f64], v: &[f64]) -> &'d [f64] {
    let mut zero = core::mem::take(&mut data.scratch);
    zero.fill(0.0);
    rnea(model, data, q, v, &zero);
    data.scratch = zero;
    &data.tau
}

/// Efforts that hold the tree against gravity, `rnea(q, 0, 0)` `[N | N·m]`, nv.
#[doc(alias = "computeGeneralizedGravity")]
pub fn generalized_gravity<'d>(model: &Model, data: &'d mut Data, q: &[f64]) -> &'d [f64] {
    let mut zero = core::mem::take(&mut data.scratch);
    zero.fill(0.0);
    rnea(model, data, q, &zero, &zero);
    data.scratch = zero;
    &data.tau
}

fn backward(model: &Model, data: &mut Data, a: &[f64]) {
    data.force.fill(Force::zero());
    for i in (0..model.nv()).rev() {
        let (joint, body) = (&model.joints[i], &model.bodies[i]);
        let mut force = data.force[i];
        if !body.is_massless() {
            let inertia = body.inertia();
            let velocity = &data.velocity[i];
            force += inertia.apply(&data.acceleration[i]) + velocity.cross_force(&inertia.apply(velocity));
        }
        data.force[i] = force;
        data.tau[i] = joint.motion().dot(&force) + joint.armature * a[i];
        if let Some(p) = joint.parent {
            data.force[p] += data.pose_pb[i].force_to_parent(&force);
        }
    }
}
