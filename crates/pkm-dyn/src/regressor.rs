//! Regressors: inverse dynamics and energies written as a matrix times the inertial parameters.

use nalgebra::{DMatrix, Matrix3, Matrix3x6, Vector3};

use crate::data::Data;
use crate::kinematics::{forward_accelerations, forward_kinematics, forward_velocities, joint_poses};
use crate::model::Model;
use crate::parameters::N_INERTIAL;
use crate::spatial::skew;

/// Joint-torque regressor of the tree, nv × 10·bodies: `tau = Y·theta` without rotor inertia and friction.
///
/// Columns are grouped by body, inside a body in the order of [`crate::parameters::NAMES`].
#[doc(alias = "computeJointTorqueRegressor")]
pub fn joint_torque_regressor<'d>(model: &Model, data: &'d mut Data, q: &[f64], v: &[f64], a: &[f64]) -> &'d DMatrix<f64> {
    forward_kinematics(model, data, q);
    forward_velocities(model, data, v);
    forward_accelerations(model, data, a);
    fill(model, data);
    &data.joint_torque_regressor
}

/// Fills the regressor from the bodies' motion in their own frames. Entries of joints that do not carry a body are zero from the start.
fn fill(model: &Model, data: &mut Data) {
    let nv = model.nv();
    for i in 0..nv {
        let (v, a, x) = (&data.velocity[i], &data.acceleration[i], &data.pose_wb[i]);
        let columns = wrench_columns(&(a.linear + v.angular.cross(&v.linear)), &v.angular, &a.angular);
        let y = &mut data.joint_torque_regressor.as_mut_slice()[N_INERTIAL * nv * i..N_INERTIAL * nv * (i + 1)];
        let mut at = Some(i);
        while let Some(j) = at {
            // The joint's unit motion at the body's origin in its axes: one motion travels, not ten wrenches.
            let s = data.axis_w[j].at(&x.translation);
            columns.project(&x.rotation.tr_mul(&s.linear), &x.rotation.tr_mul(&s.angular), |c, value| y[c * nv + j] = value);
            at = model.joints[j].parent;
        }
    }
}

/// Wrench of one body per unit of each of its ten parameters, about its origin in its own axes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WrenchColumns {
    /// Acceleration of the origin as a point `[m/s²]`, less gravity: the force per mass.
    d: Vector3<f64>,
    /// Force per first moment; the moment is `e × d`.
    first: Matrix3<f64>,
    /// Moment per inertia.
    second: Matrix3x6<f64>,
}

/// From the acceleration `d` of the body's origin less gravity `[m/s²]`, its angular velocity `[rad/s]` and acceleration `[rad/s²]`, all
/// in the body's axes.
#[inline]
pub(crate) fn wrench_columns(d: &Vector3<f64>, w: &Vector3<f64>, alpha: &Vector3<f64>) -> WrenchColumns {
    let sw = skew(w);
    WrenchColumns { d: *d, first: skew(alpha) + sw * sw, second: inertia_columns(alpha) + sw * inertia_columns(w) }
}

impl WrenchColumns {
    /// Power of each column on the motion of the body's origin (`linear`) and about it (`angular`), handed to `put` with its index.
    #[inline]
    pub(crate) fn project(&self, linear: &Vector3<f64>, angular: &Vector3<f64>, mut put: impl FnMut(usize, f64)) {
        put(0, self.d.dot(linear));
        // angular · (e_k × d) = e_k · (d × angular)
        let first = self.first.tr_mul(linear) + self.d.cross(angular);
        for k in 0..3 {
            put(1 + k, first[k]);
        }
        let second = self.second.tr_mul(angular);
        for k in 0..6 {
            put(4 + k, second[k]);
        }
    }
}

/// The matrix `L(w)` with `I·w = L(w)·[Ixx Ixy Iyy Ixz Iyz Izz]`.
#[inline]
fn inertia_columns(w: &Vector3<f64>) -> Matrix3x6<f64> {
    Matrix3x6::new(
        w.x, w.y, 0.0, w.z, 0.0, 0.0, //
        0.0, w.x, w.y, 0.0, w.z, 0.0, //
        0.0, 0.0, 0.0, w.x, w.y, w.z,
    )
}

/// Kinetic energy per inertial parameter, 10 per body `[J per unit]`, written to `out`: `kinetic_energy = out·theta` without rotors.
///
/// # Panics
/// When `out` is not of length 10·bodies.
#[doc(alias = "computeKineticEnergyRegressor")]
pub fn kinetic_energy_regressor(model: &Model, data: &mut Data, q: &[f64], v: &[f64], out: &mut [f64]) {
    assert_eq!(out.len(), N_INERTIAL * model.nv(), "ten entries per body");
    joint_poses(model, data, q);
    forward_velocities(model, data, v);
    for (velocity, out) in data.velocity.iter().zip(out.chunks_exact_mut(N_INERTIAL)) {
        let (u, w) = (&velocity.linear, &velocity.angular);
        out[0] = 0.5 * u.dot(u);
        out[1..4].copy_from_slice(u.cross(w).as_slice());
        out[4..].copy_from_slice(&[0.5 * w.x * w.x, w.x * w.y, 0.5 * w.y * w.y, w.x * w.z, w.y * w.z, 0.5 * w.z * w.z]);
    }
}

/// Potential energy per inertial parameter, 10 per body `[J per unit]`, written to `out`: `potential_energy = out·theta`.
///
/// # Panics
/// When `out` is not of length 10·bodies.
#[doc(alias = "computePotentialEnergyRegressor")]
pub fn potential_energy_regressor(model: &Model, data: &mut Data, q: &[f64], out: &mut [f64]) {
    assert_eq!(out.len(), N_INERTIAL * model.nv(), "ten entries per body");
    forward_kinematics(model, data, q);
    for (x, out) in data.pose_wb.iter().zip(out.chunks_exact_mut(N_INERTIAL)) {
        out.fill(0.0);
        out[0] = -model.gravity.dot(&x.translation);
        out[1..4].copy_from_slice((x.rotation.tr_mul(&-model.gravity)).as_slice());
    }
}
