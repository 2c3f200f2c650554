//! Closed-loop dynamics: mass matrix and bias in independent coordinates, and accelerations of the whole tree for given efforts.
//!
//! The loops are met by reduction: with `v = G·v_ind` and `J·G = 0`, `Gᵀ·M·G · a_ind = Gᵀ·(tau − nle − M·a_0)`, where `a_0` is what the
//! velocities alone make of the dependent coordinates. That is the solution of the system of equations with multipliers (KKT), of its
//! size only the freedoms, and it takes redundant constraints as they are.

use nalgebra::DMatrix;

use crate::crba::inertias;
use crate::data::Data;
use crate::inverse_dynamics::{partial_motions, tree_accelerations, tree_efforts};
use crate::kinematics::{forward_kinematics, world_velocities};
use crate::loops::{Closure, add_drift, close_at, expand, factor_at, loop_drift, reduced, reduction};
use crate::model::Model;
use crate::small;
use crate::spatial::Force;

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
    inertias(model, data);
    partial_motions(model, data);
    let n = data.n_ind();
    let Data { reduced_mass_matrix, momentum_w, partial_w, inertia_w, reduction, .. } = data;
    reduced_mass_matrix.fill(0.0);
    for (i, joint) in model.joints.iter().enumerate() {
        let (partial, momentum) = (&partial_w[i * n..(i + 1) * n], &mut momentum_w[i * n..(i + 1) * n]);
        let is_massless = model.bodies[i].is_massless();
        for k in 0..n {
            momentum[k] = if is_massless { Force::zero() } else { inertia_w[i].apply(&partial[k]) };
        }
        if is_massless && joint.armature == 0.0 {
            continue;
        }
        for k in 0..n {
            for l in 0..=k {
                let rotor = joint.armature * reduction[(i, k)] * reduction[(i, l)];
                let value = partial[l].dot(&momentum[k]) + rotor;
                reduced_mass_matrix[(k, l)] += value;
                if l < k {
                    reduced_mass_matrix[(l, k)] += value;
                }
            }
        }
    }
    &data.reduced_mass_matrix
}

/// Accelerations of the whole tree for efforts of the tree, loops closed: `data.a` `[m/s² | rad/s²]`, and the loops' efforts
/// `data.lambda`, with `M·a + nle = tau + Jᵀ·lambda` and `J·a + drift = 0`.
///
/// `q` `[m | rad]`, `v` `[m/s | rad/s]`, `tau` `[N | N·m]`: nv each; passive joints have effort zero, or their friction. `q` and `v` are
/// taken to close the loops; the gap is in the result. Not closed also means that the independent coordinates do not determine the
/// others ([`crate::loops::Choice`]) or that a freedom has no inertia.
#[doc(alias = "constraintDynamics")]
pub fn forward_dynamics(model: &Model, data: &mut Data, q: &[f64], v: &[f64], tau: &[f64]) -> Closure {
    stabilised_forward_dynamics(model, data, q, v, tau, Stabilisation::default())
}

/// As [`forward_dynamics`], with accelerations that close gaps at the rate given.
#[must_use]
pub fn stabilised_forward_dynamics(
    model: &Model,
    data: &mut Data,
    q: &[f64],
    v: &[f64],
    tau: &[f64],
    stabilisation: Stabilisation,
) -> Closure {
    let mut closure = at_state(model, data, q, v, stabilisation);
    // Efforts of the motion that the velocities alone cause, then what is left for the freedoms.
    tree_accelerations(model, data);
    tree_efforts(model, data);
    let mut a_ind = core::mem::take(&mut data.tau_ind);
    for (left, (tau, bias)) in data.scratch.iter_mut().zip(tau.iter().zip(&data.tau)) {
        *left = tau - bias;
    }
    reduced(data, &data.scratch, &mut a_ind);
    reduced_mass_matrix(model, data);
    let Data { gram, reduced_mass_matrix, .. } = &mut *data;
    gram.copy_from(reduced_mass_matrix);
    closure.is_closed &= small::cholesky(gram);
    small::solve(&data.gram, &mut a_ind);
    accelerate(model, data, &a_ind);
    data.tau_ind = a_ind;
    if model.is_constrained() {
        let Data { tau: needed, lambda, dependent, elimination, .. } = data;
        elimination.solve_transposed(|d| needed[dependent[d]] - tau[dependent[d]], lambda);
    }
    closure
}

/// Kinematics, reduction and the accelerations that the velocities alone cause, at a given state.
fn at_state(model: &Model, data: &mut Data, q: &[f64], v: &[f64], stabilisation: Stabilisation) -> Closure {
    forward_kinematics(model, data, q);
    data.q.copy_from_slice(q);
    data.v.copy_from_slice(v);
    let closure = factor_at(model, data);
    reduction(model, data);
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

/// Adds the freedoms' accelerations to `data.a` and what they need to `data.tau`, `data.force_w`.
fn accelerate(model: &Model, data: &mut Data, a_ind: &[f64]) {
    let n = data.n_ind();
    if n == 0 {
        return;
    }
    let mut step = core::mem::take(&mut data.scratch);
    expand(data, a_ind, &mut step[..model.nv()]);
    // Momenta per freedom are there already: no second pass over the bodies' motion.
    for i in (0..model.nv()).rev() {
        let own = data.momentum_w[i * n..(i + 1) * n].iter().zip(a_ind).fold(Force::zero(), |sum, (m, a)| sum + *m * *a);
        data.momentum_w[i * n] = own;
    }
    for (i, joint) in model.joints.iter().enumerate().rev() {
        let force = data.momentum_w[i * n];
        data.tau[i] += data.axis_w[i].dot(&force) + joint.armature * step[i];
        data.force_w[i] += force;
        data.a[i] += step[i];
        if let Some(p) = joint.parent {
            data.momentum_w[p * n] += force;
        }
    }
    data.scratch = step;
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
