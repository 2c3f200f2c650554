//! Articulated bodies: forward dynamics of the spanning tree.

use nalgebra::{Matrix6, Vector3, Vector6};

use crate::crba::inertias;
use crate::data::Data;
use crate::kinematics::{root_poses, world_velocities};
use crate::model::Model;
use crate::spatial::{Force, Motion, skew};

/// A body with everything it carries, as felt through its joint; all at the root's origin.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Articulated {
    /// Inertia, then what the joint lets through of it.
    inertia: Matrix6<f64>,
    /// Bias force.
    bias: Vector6<f64>,
    /// Inertia times the joint's axis.
    felt: Vector6<f64>,
    /// Inertia along the axis, inverted.
    inverse: f64,
    /// Effort that is left to accelerate the joint.
    effort: f64,
}

/// Accelerations of the tree for efforts `tau` `[N | N·m]`: `data.a` `[m/s² | rad/s²]`, nv. The inverse of [`crate::rnea::rnea`].
///
/// `q` `[m | rad]`, `v` `[m/s | rad/s]`, nv each. Loops are open; a joint that moves no inertia at all gets no finite acceleration
/// [Featherstone2008, table 7.1].
pub fn aba<'d>(model: &Model, data: &'d mut Data, q: &[f64], v: &[f64], tau: &[f64]) -> &'d [f64] {
    root_poses(model, data, q);
    world_velocities(model, data, v);
    inertias(model, data);
    for i in 0..model.nv() {
        let (inertia, velocity) = (&data.inertia_w[i], &data.velocity_w[i]);
        let bias = velocity.cross_force(&inertia.apply(velocity));
        data.articulated[i] = Articulated { inertia: matrix(inertia), bias: force6(&bias), ..Articulated::default() };
    }
    for i in (0..model.nv()).rev() {
        let joint = &model.joints[i];
        let (axis, c) = (motion6(&data.axis_w[i]), motion6(&data.coriolis_w[i]));
        let body = &mut data.articulated[i];
        body.felt = body.inertia * axis;
        body.inverse = 1.0 / (axis.dot(&body.felt) + joint.armature);
        body.effort = tau[i] - axis.dot(&body.bias);
        if let Some(p) = joint.parent {
            let inertia = body.inertia - body.felt * (body.felt.transpose() * body.inverse);
            let bias = body.bias + inertia * c + body.felt * (body.effort * body.inverse);
            data.articulated[p].inertia += inertia;
            data.articulated[p].bias += bias;
        }
    }
    let base = Motion { linear: -model.gravity, angular: Vector3::zeros() };
    for (i, joint) in model.joints.iter().enumerate() {
        let parent = joint.parent.map_or(base, |p| data.acceleration_w[p]) + data.coriolis_w[i];
        let body = &data.articulated[i];
        let a = (body.effort - body.felt.dot(&motion6(&parent))) * body.inverse;
        data.a[i] = a;
        data.acceleration_w[i] = parent + data.axis_w[i] * a;
    }
    &data.a
}

fn matrix(inertia: &crate::spatial::Inertia) -> Matrix6<f64> {
    let h = skew(&inertia.first_moment);
    let mut m = Matrix6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(inertia.mass);
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(&-h);
    m.fixed_view_mut::<3, 3>(3, 0).copy_from(&h);
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(&inertia.rotational);
    m
}

fn motion6(m: &Motion) -> Vector6<f64> {
    Vector6::new(m.linear.x, m.linear.y, m.linear.z, m.angular.x, m.angular.y, m.angular.z)
}

fn force6(f: &Force) -> Vector6<f64> {
    Vector6::new(f.linear.x, f.linear.y, f.linear.z, f.angular.x, f.angular.y, f.angular.z)
}
