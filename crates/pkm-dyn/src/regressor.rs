//! Regressors: inverse dynamics written as a matrix times the inertial parameters.

use nalgebra::{Matrix3, Matrix3x6, Vector3};

use crate::data::Data;
use crate::kinematics::{forward_accelerations, forward_kinematics, forward_velocities};
use crate::model::Model;
use crate::parameters::N_INERTIAL;
use crate::spatial::{Force, Motion, skew};

/// Joint-torque regressor of the tree, nv × 10·bodies: `tau = Y·theta` without rotor inertia and friction.
///
/// Columns are grouped by body, inside a body in the order of [`crate::parameters::NAMES`].
#[doc(alias = "computeJointTorqueRegressor")]
pub fn joint_torque_regressor<'d>(model: &Model, data: &'d mut Data, q: &[f64], v: &[f64], a: &[f64]) -> &'d nalgebra::DMatrix<f64> {
    forward_kinematics(model, data, q);
    forward_velocities(model, data, v);
    forward_accelerations(model, data, a);
    fill(model, data);
    &data.joint_torque_regressor
}

/// Fills the regressor from kinematics already in `data`.
pub(crate) fn fill(model: &Model, data: &mut Data) {
    data.joint_torque_regressor.fill(0.0);
    for i in 0..model.nv() {
        let mut columns = body_regressor(&data.velocity[i], &data.acceleration[i]);
        let mut at = i;
        loop {
            let s = model.joints[at].motion();
            for (k, f) in columns.iter().enumerate() {
                data.joint_torque_regressor[(at, N_INERTIAL * i + k)] = s.dot(f);
            }
            let Some(p) = model.joints[at].parent else { break };
            let x = &data.pose_pb[at];
            for f in &mut columns {
                *f = x.force_to_parent(f);
            }
            at = p;
        }
    }
}

/// Wrench of one body per unit of each of its ten parameters, in its own frame.
fn body_regressor(v: &Motion, a: &Motion) -> [Force; N_INERTIAL] {
    let (w, alpha) = (v.angular, a.angular);
    // Classical acceleration of the origin; the terms of the first moment and of the inertia follow from it.
    let d = a.linear + w.cross(&v.linear);
    let sw = skew(&w);
    let first: Matrix3<f64> = skew(&alpha) + sw * sw;
    let second = inertia_columns(&alpha) + sw * inertia_columns(&w);
    let mut out = [Force::zero(); N_INERTIAL];
    out[0].linear = d;
    for k in 0..3 {
        out[1 + k].linear = first.column(k).into_owned();
        let mut e = Vector3::zeros();
        e[k] = 1.0;
        out[1 + k].angular = e.cross(&d);
    }
    for k in 0..6 {
        out[4 + k].angular = second.column(k).into_owned();
    }
    out
}

/// The matrix `L(w)` with `I·w = L(w)·[Ixx Ixy Iyy Ixz Iyz Izz]`.
fn inertia_columns(w: &Vector3<f64>) -> Matrix3x6<f64> {
    Matrix3x6::new(
        w.x, w.y, 0.0, w.z, 0.0, 0.0, //
        0.0, w.x, w.y, 0.0, w.z, 0.0, //
        0.0, 0.0, 0.0, w.x, w.y, w.z,
    )
}
