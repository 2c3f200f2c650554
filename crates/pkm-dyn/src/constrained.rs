//! Closed-loop dynamics: mass matrix and bias in independent coordinates, and accelerations of the whole tree for given efforts.
//!
//! The loops are met by reduction: with `v = G·v_ind` and `J·G = 0`, `Gᵀ·M·G · a_ind = Gᵀ·(tau − nle − M·a_0)`, where `a_0` is what the
//! velocities alone make of the dependent coordinates. That is the solution of the system of equations with multipliers (KKT), of its
//! size only the freedoms, and it takes redundant constraints as they are.

use nalgebra::DMatrix;

use crate::crba::composites;
use crate::data::Data;
use crate::inverse_dynamics::{tree_accelerations, tree_efforts};
use crate::kinematics::{root_poses, world_velocities};
use crate::loops::{Closure, add_drift, choose_anew, close_at, expand, factor_at, loop_drift, reduce, reduced};
use crate::model::Model;
use crate::small;

/// How gaps of a simulated robot are brought back: `J·a + drift + 2·rate·J·v + rate²·gap = 0`.
///
/// Two equal poles at `-rate` `[1/s]`; zero leaves gaps to the integrator, or to [`project`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[doc(alias = "Baumgarte")]
pub struct Stabilisation {
    /// Rate `[1/s]`.
    pub rate: f64,
}

/// Mass matrix in the independent coordinates at the pose in `data`, `Gᵀ·M·G`, rotors included: `data.reduced_mass_matrix`.
///
/// Call [`crate::loops::solve_positions`] (or anything that closes the loops) first.
pub fn reduced_mass_matrix<'d>(model: &Model, data: &'d mut Data) -> &'d DMatrix<f64> {
    composites(model, data);
    let (n, nv) = (data.n_ind(), model.nv());
    let Data { reduced_mass_matrix, mass_matrix, mass_reduction, reduction, .. } = data;
    let (m, g) = (mass_matrix.as_slice(), reduction.as_slice());
    mass_reduction.fill(0.0);
    for (i, joint) in model.joints.iter().enumerate() {
        for k in 0..n {
            mass_reduction[i * n + k] += m[i * nv + i] * g[k * nv + i];
        }
        // Only joints on one branch share inertia.
        let mut at = joint.parent;
        while let Some(j) = at {
            let shared = m[i * nv + j];
            for k in 0..n {
                mass_reduction[i * n + k] += shared * g[k * nv + j];
                mass_reduction[j * n + k] += shared * g[k * nv + i];
            }
            at = model.joints[j].parent;
        }
    }
    for k in 0..n {
        for l in 0..=k {
            let value: f64 = (0..nv).map(|i| g[l * nv + i] * mass_reduction[i * n + k]).sum();
            reduced_mass_matrix[(k, l)] = value;
            reduced_mass_matrix[(l, k)] = value;
        }
    }
    &data.reduced_mass_matrix
}

/// Accelerations of the whole tree for efforts of the tree, loops closed: `data.a` `[m/s² | rad/s²]`, and the loops' efforts
/// `data.lambda`, with `M·a + nle = tau + Jᵀ·lambda` and `J·a + drift = 0`.
///
/// `q` `[m | rad]`, `v` `[m/s | rad/s]`, `tau` `[N | N·m]`: nv each; passive joints have effort zero, or their friction. `q` and `v` are
/// taken to close the loops; the gap is in the result. Not closed also means that the independent coordinates do not determine the
/// others ([`crate::loops::Choice`]) or that a freedom has no inertia. `data.tau` is `M·a + nle`; wrenches in joints take
/// [`crate::inverse_dynamics::inverse_dynamics_at`] with these accelerations.
#[doc(alias = "constraintDynamics")]
pub fn forward_dynamics(model: &Model, data: &mut Data, q: &[f64], v: &[f64], tau: &[f64]) -> Closure {
    stabilised_forward_dynamics(model, data, q, v, tau, Stabilisation::default())
}

/// As [`forward_dynamics`], with accelerations that close gaps at the rate given.
pub fn stabilised_forward_dynamics(
    model: &Model,
    data: &mut Data,
    q: &[f64],
    v: &[f64],
    tau: &[f64],
    stabilisation: Stabilisation,
) -> Closure {
    let mut closure = bias_motion(model, data, q, v, stabilisation);
    closure.is_closed &= complete_motion(model, data, tau);
    closure
}

/// The first half of [`stabilised_forward_dynamics`], before efforts are known: kinematics, reduction, and what the velocities alone cause,
/// `data.tau = M·a_0 + nle` `[N | N·m]`.
///
/// Efforts that depend on where links are and how they move (`data.pose_wb`, `data.velocity_w`) are computed after it and given to
/// [`complete_motion`], so that nothing is evaluated twice.
pub fn bias_motion(model: &Model, data: &mut Data, q: &[f64], v: &[f64], stabilisation: Stabilisation) -> Closure {
    let closure = at_state(model, data, q, v, stabilisation);
    // Efforts of the motion that the velocities alone cause, then what is left for the freedoms.
    tree_accelerations(model, data);
    tree_efforts(model, data);
    closure
}

/// The second half of [`stabilised_forward_dynamics`]: accelerations for efforts `tau` `[N | N·m]` of the tree, nv; whether every freedom
/// has inertia. `data.a`, `data.tau = M·a + nle`, `data.lambda`.
pub fn complete_motion(model: &Model, data: &mut Data, tau: &[f64]) -> bool {
    let mut a_ind = core::mem::take(&mut data.tau_ind);
    for (left, (tau, bias)) in data.scratch.iter_mut().zip(tau.iter().zip(&data.tau)) {
        *left = tau - bias;
    }
    reduced(data, &data.scratch, &mut a_ind);
    reduced_mass_matrix(model, data);
    let Data { gram, reduced_mass_matrix, .. } = &mut *data;
    gram.copy_from(reduced_mass_matrix);
    let is_sound = small::cholesky(gram) && has_inertia(data);
    small::solve(&data.gram, &mut a_ind);
    accelerate(data, &a_ind);
    data.tau_ind = a_ind;
    if model.is_constrained() {
        let Data { tau: needed, lambda, dependent, elimination, .. } = data;
        elimination.solve_transposed(|d| needed[dependent[d]] - tau[dependent[d]], lambda);
    }
    is_sound
}

/// A freedom counts as without inertia below this share of the largest inertia in the tree: what is left of it is the square of rounding,
/// while a spindle of a gram square millimetre beside a tonne is still far above.
const NO_INERTIA: f64 = 1e-18;

fn has_inertia(data: &Data) -> bool {
    let largest = (0..data.mass_matrix.nrows()).fold(0.0_f64, |top, i| top.max(data.mass_matrix[(i, i)]));
    (0..data.n_ind()).all(|k| data.reduced_mass_matrix[(k, k)] > NO_INERTIA * largest)
}

/// Kinematics, reduction and the accelerations that the velocities alone cause, at a given state.
fn at_state(model: &Model, data: &mut Data, q: &[f64], v: &[f64], stabilisation: Stabilisation) -> Closure {
    root_poses(model, data, q);
    data.q.copy_from_slice(q);
    data.v.copy_from_slice(v);
    let closure = factor_at(model, data);
    reduce(model, data);
    choose_anew(model, data);
    world_velocities(model, data, v);
    data.a.fill(0.0);
    if model.is_constrained() {
        loop_drift(model, data);
        let Data { loop_drift, loop_gap, loop_jacobian, .. } = &mut *data;
        let rate = stabilisation.rate;
        if rate > 0.0 {
            for (i, drift) in loop_drift.iter_mut().enumerate() {
                let gap_rate: f64 = loop_jacobian.row(i).iter().zip(v).map(|(j, v)| j * v).sum();
                *drift += 2.0 * rate * gap_rate + rate * rate * loop_gap[i];
            }
        }
        let mut a = core::mem::take(&mut data.a);
        add_drift(data, &mut a);
        data.a = a;
    }
    closure
}

/// Adds the freedoms' accelerations to `data.a` and what they need to `data.tau`.
fn accelerate(data: &mut Data, a_ind: &[f64]) {
    let n = a_ind.len();
    if n == 0 {
        return;
    }
    for (tau, row) in data.tau.iter_mut().zip(data.mass_reduction.chunks_exact(n)) {
        *tau += row.iter().zip(a_ind).map(|(m, a)| m * a).sum::<f64>();
    }
    for (column, x) in data.reduction.column_iter().zip(a_ind) {
        for (a, g) in data.a.iter_mut().zip(column.iter()) {
            *a += g * x;
        }
    }
}

/// Brings a state back onto closed loops: dependent coordinates and velocities are solved for, independent ones kept.
///
/// `q` `[m | rad]` and `v` `[m/s | rad/s]`, nv each, changed in place; what an integrator let drift is undone.
pub fn project(model: &Model, data: &mut Data, q: &mut [f64], v: &mut [f64]) -> Closure {
    data.q.copy_from_slice(q);
    let closure = close_at(model, data);
    q.copy_from_slice(&data.q);
    if model.is_constrained() {
        let mut v_ind = core::mem::take(&mut data.scratch);
        for (x, &j) in v_ind.iter_mut().zip(&data.independent) {
            *x = v[j];
        }
        expand(data, &v_ind[..data.n_ind()], v);
        data.scratch = v_ind;
    }
    closure
}
