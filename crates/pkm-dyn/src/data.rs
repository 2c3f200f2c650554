//! All results and scratch of the algorithms: allocated once, by [`Data::new`].

use alloc::vec;
use alloc::vec::Vec;

use nalgebra::DMatrix;

use crate::elimination::Elimination;
use crate::model::Model;
use crate::parameters::N_INERTIAL;
use crate::spatial::{Force, Motion, Pose};

/// Results and scratch for one [`Model`]; every algorithm writes its result here and returns a reference to it.
#[derive(Debug, Clone)]
pub struct Data {
    /// Pose of each body in its parent body.
    pub pose_pb: Vec<Pose>,
    /// Pose of each body in the root frame.
    pub pose_wb: Vec<Pose>,
    /// Velocity of each body, in its own frame.
    pub velocity: Vec<Motion>,
    /// Acceleration of each body in its own frame, with the base accelerated by `-gravity`.
    pub acceleration: Vec<Motion>,
    /// Acceleration of each body with the joints not accelerating and no gravity: what the loops' drift needs.
    pub bias: Vec<Motion>,
    /// Velocity term each joint adds to its body's acceleration.
    pub coriolis: Vec<Motion>,
    /// Wrench each joint transmits to its body, in the body's frame.
    pub force: Vec<Force>,
    /// Tree coordinates `[m | rad]`, nv.
    pub q: Vec<f64>,
    /// Tree velocities `[m/s | rad/s]`, nv.
    pub v: Vec<f64>,
    /// Tree accelerations `[m/s² | rad/s²]`, nv.
    pub a: Vec<f64>,
    /// Generalized efforts of the tree `[N | N·m]`, nv.
    pub tau: Vec<f64>,
    /// Efforts at the drives `[N | N·m]`, one per drive.
    pub tau_act: Vec<f64>,
    /// Joint-torque regressor of the tree, nv × 10·bodies.
    pub joint_torque_regressor: DMatrix<f64>,
    /// Regressor in actuated coordinates, drives × 10·bodies.
    pub regressor: DMatrix<f64>,
    /// Closure error of every constraint row `[m | rad]`.
    pub loop_gap: Vec<f64>,
    /// Jacobian of the closure error, rows × nv.
    pub loop_jacobian: DMatrix<f64>,
    /// Second time derivative of the closure error at zero joint acceleration `[m/s² | rad/s²]`.
    pub loop_drift: Vec<f64>,
    /// Reduction to the drives: `v_tree = reduction · v_act`, nv × drives.
    pub reduction: DMatrix<f64>,
    /// Joints solved for by loop closure.
    pub passive: Vec<usize>,
    pub(crate) elimination: Elimination,
    pub(crate) step: Vec<f64>,
}

impl Data {
    /// Room for every algorithm on `model`.
    #[must_use]
    pub fn new(model: &Model) -> Self {
        let (nv, rows, n_act) = (model.nv(), model.n_constraints(), model.n_act());
        let passive = model.passive();
        Self {
            pose_pb: vec![Pose::identity(); nv],
            pose_wb: vec![Pose::identity(); nv],
            velocity: vec![Motion::zero(); nv],
            acceleration: vec![Motion::zero(); nv],
            bias: vec![Motion::zero(); nv],
            coriolis: vec![Motion::zero(); nv],
            force: vec![Force::zero(); nv],
            q: model.assembly.clone(),
            v: vec![0.0; nv],
            a: vec![0.0; nv],
            tau: vec![0.0; nv],
            tau_act: vec![0.0; n_act],
            joint_torque_regressor: DMatrix::zeros(nv, N_INERTIAL * nv),
            regressor: DMatrix::zeros(n_act, N_INERTIAL * nv),
            loop_gap: vec![0.0; rows],
            loop_jacobian: DMatrix::zeros(rows, nv),
            loop_drift: vec![0.0; rows],
            reduction: DMatrix::zeros(nv, n_act),
            elimination: Elimination::new(rows, passive.len()),
            step: vec![0.0; passive.len()],
            passive,
        }
    }
}
