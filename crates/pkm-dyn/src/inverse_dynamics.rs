//! Inverse dynamics and regressors in actuated coordinates: what the drives must supply, loops included.

use nalgebra::DMatrix;

use crate::data::Data;
use crate::kinematics::{root_poses, world_accelerations, world_velocities};
use crate::loops::{Closure, choose_anew, distribute, factor_at, reduce, reduced, solve_accelerations, solve_positions, solve_velocities};
use crate::math;
use crate::model::Model;
use crate::parameters::{InertialParameters, N_INERTIAL};
use crate::regressor::wrench_columns;
use crate::spatial::{Force, Motion, Pose};

/// Tree motion for a motion of the drives: `data.q`, `data.v`, `data.a`, `data.reduction` and the bodies' motion at the root's origin.
///
/// Newton starts from the tree coordinates in `data.q` (the previous sample, or [`crate::loops::assemble`]).
pub fn closed_loop_motion(model: &Model, data: &mut Data, q_act: &[f64], v_act: &[f64], a_act: &[f64]) -> Closure {
    let mut closure = solve_positions(model, data, q_act);
    // An open tree with joints that no drive moves has no motion that the drives' would determine.
    closure.is_closed &= model.is_constrained() || data.dependent.is_empty();
    closure.is_closed &= v_act.iter().chain(a_act).all(|x| x.is_finite());
    solve_velocities(model, data, v_act);
    solve_accelerations(model, data, a_act);
    tree_accelerations(model, data);
    closure
}

/// The bodies' accelerations for the tree accelerations in `data.a`, the base accelerated by `-gravity`.
pub(crate) fn tree_accelerations(model: &Model, data: &mut Data) {
    let a = core::mem::take(&mut data.a);
    world_accelerations(model, data, &a, &-model.gravity);
    data.a = a;
}

/// Effort of the drives for a motion of the drives, `Bᵀ·tau_act = Gᵀ·rnea` `[N | N·m]`: rigid bodies and rotor inertia, no friction.
///
/// `data.tau_act`; of more drives than freedoms the smallest efforts ([`distribute`]).
#[doc(alias = "closed-loop inverse dynamics")]
pub fn inverse_dynamics(model: &Model, data: &mut Data, q_act: &[f64], v_act: &[f64], a_act: &[f64]) -> Closure {
    let closure = closed_loop_motion(model, data, q_act, v_act, a_act);
    rigid_effort(model, data);
    closure
}

/// As [`inverse_dynamics`], for a motion of the whole tree that is known: `q` `[m | rad]`, `v` `[m/s | rad/s]`, `a` `[m/s² | rad/s²]`, nv
/// each. It is taken to close the loops; the gap is in the result.
pub fn inverse_dynamics_at(model: &Model, data: &mut Data, q: &[f64], v: &[f64], a: &[f64]) -> Closure {
    root_poses(model, data, q);
    data.q.copy_from_slice(q);
    data.v.copy_from_slice(v);
    data.a.copy_from_slice(a);
    let closure = factor_at(model, data);
    reduce(model, data);
    choose_anew(model, data);
    world_velocities(model, data, v);
    tree_accelerations(model, data);
    rigid_effort(model, data);
    closure
}

/// `data.tau`, `data.tau_ind` and `data.tau_act` from the tree motion already in `data`.
pub fn rigid_effort(model: &Model, data: &mut Data) {
    tree_efforts(model, data);
    let mut tau_ind = core::mem::take(&mut data.tau_ind);
    reduced(data, &data.tau, &mut tau_ind);
    data.tau_ind = tau_ind;
    distribute(model, data);
}

/// Efforts of the tree, loops open, for the bodies' motion at the root's origin: `data.tau`, `data.force_w`.
pub(crate) fn tree_efforts(model: &Model, data: &mut Data) {
    for (i, body) in model.bodies.iter().enumerate() {
        data.force_w[i] = if body.is_massless() {
            Force::zero()
        } else {
            body_force(body, &data.pose_wb[i], &data.velocity_w[i], &data.acceleration_w[i])
        };
    }
    for (i, joint) in model.joints.iter().enumerate().rev() {
        let force = data.force_w[i];
        data.tau[i] = data.axis_w[i].dot(&force) + joint.armature * data.a[i];
        if let Some(p) = joint.parent {
            data.force_w[p] += force;
        }
    }
}

/// Wrench that gives a body its motion, all at the root's origin in the root's axes.
#[inline]
fn body_force(body: &InertialParameters, x: &Pose, v: &Motion, a: &Motion) -> Force {
    let (r, t) = (&x.rotation, &x.translation);
    let (w, alpha) = (&v.angular, &a.angular);
    // Acceleration of the body's origin as a point.
    let d = a.linear + alpha.cross(t) + w.cross(&(v.linear + w.cross(t)));
    let h = r * body.first_moment();
    let linear = d * body.mass + alpha.cross(&h) + w.cross(&w.cross(&h));
    // The inertia is constant in the body's own axes: cheaper to turn the motion there than the inertia here.
    let (w_b, alpha_b, inertia) = (r.tr_mul(w), r.tr_mul(alpha), body.rotational());
    let moment = r * (inertia * alpha_b + w_b.cross(&(inertia * w_b))) + h.cross(&d);
    Force { linear, angular: moment + t.cross(&linear) }
}

/// Efforts of the loops for the tree motion and the drives' efforts in `data` (after [`inverse_dynamics`] or [`rigid_effort`]), one per
/// constraint row `[N | N·m]`: `data.lambda`. Signs as in [`crate::loops::loop_wrench`].
///
/// For rigid bodies without friction in passive joints, whose efforts can be added to `data.tau` beforehand.
pub fn loop_efforts<'d>(model: &Model, data: &'d mut Data) -> &'d [f64] {
    if model.is_constrained() {
        let Data { tau, tau_act, lambda, dependent, elimination, .. } = data;
        let driven = |j: usize| model.actuators.iter().position(|&a| a == j).map_or(0.0, |k| tau_act[k]);
        elimination.solve_transposed(|d| tau[dependent[d]] - driven(dependent[d]), lambda);
    }
    &data.lambda
}

/// Regressor in the independent coordinates, independent × 10·bodies: `tau_ind = W·theta` without rotor inertia and friction; the
/// independent coordinates are the drives unless there are more drives than freedoms, where `tau_ind = Bᵀ·tau_act`.
///
/// Uses the tree motion already in `data` ([`closed_loop_motion`]); the result is `data.regressor`.
pub fn actuated_regressor<'d>(model: &Model, data: &'d mut Data) -> &'d DMatrix<f64> {
    partial_motions(model, data);
    let n = data.n_ind();
    for i in 0..model.nv() {
        let x = &data.pose_wb[i];
        let (v, a) = (data.velocity_w[i].at(&x.translation), data.acceleration_w[i].at(&x.translation));
        let d = a.linear + v.angular.cross(&v.linear);
        let columns = wrench_columns(&x.rotation.tr_mul(&d), &x.rotation.tr_mul(&v.angular), &x.rotation.tr_mul(&a.angular));
        for k in 0..n {
            let partial = data.partial_w[i * n + k].at(&x.translation);
            let (linear, angular) = (x.rotation.tr_mul(&partial.linear), x.rotation.tr_mul(&partial.angular));
            columns.project(&linear, &angular, |c, value| data.regressor[(k, N_INERTIAL * i + c)] = value);
        }
    }
    &data.regressor
}

/// Motion of each body per unit velocity of each independent coordinate: `data.partial_w`.
pub(crate) fn partial_motions(model: &Model, data: &mut Data) {
    let n = data.n_ind();
    for (i, joint) in model.joints.iter().enumerate() {
        for k in 0..n {
            let own = data.axis_w[i] * data.reduction[(i, k)];
            data.partial_w[i * n + k] = match joint.parent {
                Some(p) => data.partial_w[p * n + k] + own,
                None => own,
            };
        }
    }
}

/// Columns of rotor inertia, viscous friction and Coulomb friction of every joint, passive ones included, in the independent
/// coordinates, independent × 3·nv: `tau_ind = F·[armature | viscous | coulomb]`, each per joint of the tree.
///
/// Uses the tree motion already in `data` ([`closed_loop_motion`]). Friction of a passive joint reaches the drives through the loops,
/// `Gᵀ`, which is how it can be identified without a sensor there. The result is `data.friction_regressor`.
pub fn friction_regressor<'d>(model: &Model, data: &'d mut Data) -> &'d DMatrix<f64> {
    let Data { reduction, friction_regressor, v, a, .. } = data;
    let nv = model.nv();
    for k in 0..reduction.ncols() {
        for j in 0..nv {
            let g = reduction[(j, k)];
            friction_regressor[(k, j)] = g * a[j];
            friction_regressor[(k, nv + j)] = g * v[j];
            friction_regressor[(k, 2 * nv + j)] = g * math::sign(v[j]);
        }
    }
    &data.friction_regressor
}

/// Efforts at the independent coordinates of efforts at the joints of the tree, `Gᵀ·tau` `[N | N·m]`: how friction of passive joints and
/// other forces of the tree reach the drives. `tau` has nv entries; the result is `data.tau_ind`.
pub fn project_efforts<'d>(data: &'d mut Data, tau: &[f64]) -> &'d [f64] {
    let mut tau_ind = core::mem::take(&mut data.tau_ind);
    reduced(data, tau, &mut tau_ind);
    data.tau_ind = tau_ind;
    &data.tau_ind
}
