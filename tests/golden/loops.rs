//! Forward dynamics of closed-loop robots (`pinocchio/make_loops.py`, `pin.constraintDynamics`): efforts on every joint of the tree, some
//! freedoms without a drive.
//!
//! Not in here: closing the loops and the drives' efforts (`against_pinocchio.rs`).

use nalgebra::DMatrix;
use pkm_dyn::constrained::{forward_dynamics, reduced_mass_matrix};
use pkm_dyn::inverse_dynamics::{inverse_dynamics_at, loop_efforts};
use pkm_dyn::loops::{Choice, joint_wrenches, loop_wrench};
use pkm_dyn::spatial::Force;
use pkm_dyn::{Data, Model};
use pkm_tests::relative_error;
use serde::Deserialize;

use super::{Golden, indices, ours, robot, theirs};

/// Relative to the largest entry of the table compared: ten times the largest seen (multipliers of `three_loops`, 8e-14).
const USUAL: f64 = 1e-12;

#[derive(Deserialize)]
struct State {
    q: Vec<f64>,
    v: Vec<f64>,
    tau: Vec<f64>,
    a: Vec<f64>,
    /// `M·a + nle`.
    tree: Vec<f64>,
    /// One per constraint row, in the order of the rows.
    lambda: Vec<f64>,
    /// Of link a on link b, about b's origin in a's axes: one per loop.
    wrench: Vec<Vec<f64>>,
    /// Of each joint of the tree on its body, at the root's origin in the root's axes.
    reaction: Vec<Vec<f64>>,
    /// Tree velocities that keep the loops closed, one per column: an orthonormal basis.
    freedoms: Vec<Vec<f64>>,
    /// The mass matrix in that basis.
    mass: Vec<Vec<f64>>,
}

fn table(rows: &[Vec<f64>]) -> DMatrix<f64> {
    DMatrix::from_row_iterator(rows.len(), rows[0].len(), rows.iter().flatten().copied())
}

/// Largest differences of one robot, by name.
#[derive(Debug, Default)]
struct Worst {
    a: f64,
    tree: f64,
    lambda: f64,
    wrench: f64,
    reduction: f64,
    mass: f64,
    tree_of_motion: f64,
    lambda_of_motion: f64,
    reaction: f64,
}

impl Worst {
    fn all(&self) -> [f64; 9] {
        [self.a, self.tree, self.lambda, self.wrench, self.reduction, self.mass, self.tree_of_motion, self.lambda_of_motion, self.reaction]
    }
}

fn note(worst: &mut f64, got: &[f64], want: &[f64]) {
    let error = relative_error(got, want, 1e-9);
    // `max` would drop a NaN.
    *worst = if error <= *worst { *worst } else { error };
}

fn six(w: &Force) -> [f64; 6] {
    [w.linear.x, w.linear.y, w.linear.z, w.angular.x, w.angular.y, w.angular.z]
}

fn check_forces(model: &Model, data: &Data, state: &State, worst: &mut Worst) {
    note(&mut worst.lambda, &data.lambda, &state.lambda);
    let wrench: Vec<f64> = (0..model.loops.len()).flat_map(|l| six(&loop_wrench(model, data, l))).collect();
    note(&mut worst.wrench, &wrench, &state.wrench.concat());
}

/// The golden basis spans the same motions as our reduction; `G = N·N_ind⁻¹` is the one of them that moves one independent coordinate
/// at a time, whichever those are.
fn check_reduction(model: &Model, data: &mut Data, order: &[usize], state: &State, worst: &mut Worst) {
    let n = table(&state.freedoms);
    let at = |j: &usize| order.iter().position(|o| o == j).expect("every joint");
    let rows: Vec<usize> = data.independent.iter().map(at).collect();
    let to_basis = n.select_rows(&rows).try_inverse().expect("independent coordinates");
    let g = &n * &to_basis;
    let got = DMatrix::from_fn(order.len(), rows.len(), |i, k| data.reduction[(order[i], k)]);
    note(&mut worst.reduction, got.as_slice(), g.as_slice());
    let want = to_basis.transpose() * table(&state.mass) * &to_basis;
    note(&mut worst.mass, reduced_mass_matrix(model, data).as_slice(), want.as_slice());
}

fn check_state(model: &Model, [order, bodies]: [&[usize]; 2], state: &State, worst: &mut Worst) {
    let mut data = Data::with_choice(model, Choice::Freedoms);
    assert_eq!(data.n_ind(), state.mass.len(), "mobility");
    let [q, v, tau, a] = [&state.q, &state.v, &state.tau, &state.a].map(|x| ours(order, x));
    let closure = forward_dynamics(model, &mut data, &q, &v, &tau);
    assert!(closure.is_closed && closure.gap < 1e-12, "{closure:?}");
    note(&mut worst.a, &theirs(order, &data.a), &state.a);
    note(&mut worst.tree, &theirs(order, &data.tau), &state.tree);
    check_forces(model, &data, state, worst);
    check_reduction(model, &mut data, order, state, worst);
    // The other way round: from the accelerations to what the joints and loops carry.
    let _ = inverse_dynamics_at(model, &mut data, &q, &v, &a);
    note(&mut worst.tree_of_motion, &theirs(order, &data.tau), &state.tree);
    for j in model.passive() {
        data.tau[j] -= tau[j];
    }
    for (effort, &j) in data.tau_act.iter_mut().zip(&model.actuators) {
        *effort = tau[j];
    }
    note(&mut worst.lambda_of_motion, loop_efforts(model, &mut data), &state.lambda);
    let wrenches = joint_wrenches(model, &mut data);
    let reaction: Vec<f64> = bodies.iter().flat_map(|&body| six(&wrenches[body])).collect();
    note(&mut worst.reaction, &reaction, &state.reaction.concat());
}

fn check(text: &str) {
    let golden: Golden<State> = serde_json::from_str(text).expect("golden file");
    let (model, order) = robot(&golden);
    let bodies = indices(&model, &golden.bodies);
    assert!(!golden.states.is_empty());
    let mut worst = Worst::default();
    for state in &golden.states {
        check_state(&model, [&order, &bodies], state, &mut worst);
    }
    assert!(worst.all().iter().all(|&e| e <= USUAL), "{}: {worst:?} (limit {USUAL:.0e})", model.name);
}

#[test]
fn a_planar_four_bar_moves_as_pinocchio_says() {
    check(include_str!("pinocchio/four_bar_forward.json"));
}

#[test]
fn a_five_bar_with_redundant_rows_moves_as_pinocchio_says() {
    check(include_str!("pinocchio/five_bar_forward.json"));
}

#[test]
fn a_platform_on_three_legs_moves_as_pinocchio_says() {
    check(include_str!("pinocchio/spatial_loop_forward.json"));
}

#[test]
fn a_loop_closed_by_a_pin_moves_as_pinocchio_says() {
    check(include_str!("pinocchio/spatial_pin_forward.json"));
}

#[test]
fn three_loops_with_balls_and_undriven_freedoms_move_as_pinocchio_says() {
    check(include_str!("pinocchio/three_loops_forward.json"));
}

#[test]
fn a_flying_platform_and_a_sliding_table_in_loops_move_as_pinocchio_says() {
    check(include_str!("pinocchio/flying_forward.json"));
}

#[test]
fn a_welded_loop_moves_as_pinocchio_says() {
    check(include_str!("pinocchio/weld_forward.json"));
}

#[test]
fn a_loop_that_slides_and_turns_moves_as_pinocchio_says() {
    check(include_str!("pinocchio/cylinder_forward.json"));
}
