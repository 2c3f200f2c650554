//! Inverse dynamics and regressor in actuated coordinates: what the drives must supply, loops included.

use crate::data::Data;
use crate::kinematics::forward_accelerations;
use crate::loops::{Closure, reduction, solve_accelerations, solve_positions, solve_velocities};
use crate::model::Model;
use crate::{regressor, rnea};

/// Tree motion for a motion of the drives: `data.q`, `data.v`, `data.a`, `data.reduction` and the bodies' motion.
///
/// Newton starts from the tree coordinates in `data.q` (the previous sample, or [`crate::loops::assemble`]).
pub fn closed_loop_motion(model: &Model, data: &mut Data, q_act: &[f64], v_act: &[f64], a_act: &[f64]) -> Closure {
    let closure = solve_positions(model, data, q_act);
    if !model.is_constrained() {
        let q = core::mem::take(&mut data.q);
        crate::kinematics::forward_kinematics(model, data, &q);
        data.q = q;
    }
    solve_velocities(model, data, v_act);
    solve_accelerations(model, data, a_act);
    let a = core::mem::take(&mut data.a);
    forward_accelerations(model, data, &a);
    data.a = a;
    reduction(model, data);
    closure
}

/// Effort of the drives for a motion of the drives, `tau_act = Gᵀ·rnea` `[N | N·m]`: rigid bodies and rotor inertia, no friction.
pub fn inverse_dynamics(model: &Model, data: &mut Data, q_act: &[f64], v_act: &[f64], a_act: &[f64]) -> Closure {
    let closure = closed_loop_motion(model, data, q_act, v_act, a_act);
    rigid_effort(model, data);
    closure
}

/// `data.tau_act` from the tree motion already in `data`.
pub fn rigid_effort(model: &Model, data: &mut Data) {
    let a = core::mem::take(&mut data.a);
    rnea::rnea_backward(model, data, &a);
    data.a = a;
    project(data);
}

/// `tau_act = Gᵀ·tau`, without an operator: an operator would allocate.
fn project(data: &mut Data) {
    let Data { reduction, tau, tau_act, .. } = data;
    for (k, out) in tau_act.iter_mut().enumerate() {
        *out = reduction.column(k).iter().zip(tau.iter()).map(|(g, t)| g * t).sum();
    }
}

/// Regressor in actuated coordinates, drives × 10·bodies: `tau_act = W·theta` without rotor inertia and friction.
///
/// Uses the tree motion already in `data` ([`closed_loop_motion`]); the result is `data.regressor`.
pub fn actuated_regressor<'d>(model: &Model, data: &'d mut Data) -> &'d nalgebra::DMatrix<f64> {
    regressor::fill(model, data);
    let Data { reduction, joint_torque_regressor, regressor, .. } = data;
    regressor.gemm_tr(1.0, reduction, joint_torque_regressor, 0.0);
    &data.regressor
}
