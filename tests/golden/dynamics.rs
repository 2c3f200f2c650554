//! Dynamics of trees (`pinocchio/make_dynamics.py`), with joints of every kind.
//!
//! Not in here: loops.

use nalgebra::{Matrix3xX, Vector3};
use pkm_dyn::aba::aba;
use pkm_dyn::configuration::{difference, integrate};
use pkm_dyn::crba::crba;
use pkm_dyn::energy::{center_of_mass, kinetic_energy, potential_energy};
use pkm_dyn::jacobian::{Reference, frame_jacobian, frame_jacobian_time_variation, jacobian_center_of_mass, joint_jacobians, motion_of};
use pkm_dyn::kinematics::{forward_kinematics, frame_acceleration, frame_velocity, world_accelerations};
use pkm_dyn::regressor::{joint_torque_regressor, kinetic_energy_regressor, potential_energy_regressor};
use pkm_dyn::rnea::{generalized_gravity, nle, rnea};
use pkm_dyn::spatial::{Motion, Pose};
use pkm_dyn::{Data, Model};
use pkm_tests::relative_error;
use serde::Deserialize;

use super::{Golden, indices, ours, robot, theirs};

/// Relative to the largest entry of the table compared: ten times the largest seen (5e-15), and more.
const USUAL: f64 = 1e-13;
/// Accelerations for given efforts are divided by the smallest inertia of a joint: the digits that costs. The largest seen is 3e-14.
const ACCELERATIONS: f64 = 1e-12;

#[derive(Deserialize)]
struct State {
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    effort: Vec<f64>,
    to: Vec<f64>,
    step: Vec<f64>,
    tau: Vec<f64>,
    mass: Vec<Vec<f64>>,
    ddq: Vec<f64>,
    nle: Vec<f64>,
    gravity: Vec<f64>,
    kinetic: [f64; 1],
    potential: [f64; 1],
    centre: Vec<f64>,
    centre_jacobian: Vec<Vec<f64>>,
    torque_regressor: Vec<Vec<f64>>,
    kinetic_regressor: Vec<f64>,
    potential_regressor: Vec<f64>,
    joint_jacobians: Vec<Vec<f64>>,
    jacobian_world: Vec<Vec<f64>>,
    jacobian_local: Vec<Vec<f64>>,
    jacobian_aligned: Vec<Vec<f64>>,
    variation_world: Vec<Vec<f64>>,
    variation_local: Vec<Vec<f64>>,
    variation_aligned: Vec<Vec<f64>>,
    velocity: Vec<f64>,
    acceleration: Vec<f64>,
    difference: Vec<f64>,
    moved: Vec<Vec<f64>>,
}

/// A robot of a golden file with the order of Pinocchio's joints and bodies.
struct Tree {
    model: Model,
    order: Vec<usize>,
    bodies: Vec<usize>,
    last_link: String,
}

impl Tree {
    /// A table row by row, its columns in Pinocchio's order.
    fn rows(&self, rows: usize, entry: impl Fn(usize, usize) -> f64) -> Vec<f64> {
        (0..rows).flat_map(|i| self.order.iter().map(move |&j| (i, j))).map(|(i, j)| entry(i, j)).collect()
    }

    /// Ten entries of each of Pinocchio's bodies. Bodies between the coordinates of one joint are ours alone, and massless.
    fn by_body(&self, entry: impl Fn(usize) -> f64) -> Vec<f64> {
        self.bodies.iter().flat_map(|&body| 10 * body..10 * body + 10).map(entry).collect()
    }
}

fn assert_within(limit: f64, what: &str, got: &[f64], want: &[f64]) {
    let error = relative_error(got, want, 1e-9);
    assert!(error <= limit, "{what}: relative difference {error:.1e} (limit {limit:.0e})");
}

fn assert_close(what: &str, got: &[f64], want: &[f64]) {
    assert_within(USUAL, what, got, want);
}

fn check_dynamics(tree: &Tree, data: &mut Data, state: &State) {
    let Tree { model, order, .. } = tree;
    let [q, v, a, effort] = [&state.q, &state.v, &state.a, &state.effort].map(|x| ours(order, x));
    assert_close("rnea", &theirs(order, rnea(model, data, &q, &v, &a)), &state.tau);
    assert_close("nle", &theirs(order, nle(model, data, &q, &v)), &state.nle);
    assert_close("gravity", &theirs(order, generalized_gravity(model, data, &q)), &state.gravity);
    assert_within(ACCELERATIONS, "aba", &theirs(order, aba(model, data, &q, &v, &effort)), &state.ddq);
    let m = crba(model, data, &q);
    assert_close("mass matrix", &tree.rows(order.len(), |i, j| m[(order[i], j)]), &state.mass.concat());
    let y = joint_torque_regressor(model, data, &q, &v, &a);
    for (row, want) in order.iter().zip(&state.torque_regressor) {
        assert_close("torque regressor", &tree.by_body(|c| y[(*row, c)]), want);
    }
}

fn check_energies(tree: &Tree, data: &mut Data, state: &State) {
    let Tree { model, order, .. } = tree;
    let (q, v) = (ours(order, &state.q), ours(order, &state.v));
    // Pinocchio's energy leaves out some rotors (`make_dynamics.py`), its mass matrix none.
    let kinetic = kinetic_energy(model, data, &q, &v);
    let rotors: f64 = model.joints.iter().zip(&v).map(|(joint, v)| 0.5 * joint.armature * v * v).sum();
    assert_close("kinetic energy of the bodies", &[kinetic - rotors], &state.kinetic);
    let momentum = state.mass.iter().map(|row| row.iter().zip(&state.v).map(|(m, v)| m * v).sum::<f64>());
    assert_close("kinetic energy", &[kinetic], &[0.5 * momentum.zip(&state.v).map(|(p, v)| p * v).sum::<f64>()]);
    assert_close("potential energy", &[potential_energy(model, data, &q)], &state.potential);
    let mut row = vec![f64::NAN; 10 * model.nv()];
    kinetic_energy_regressor(model, data, &q, &v, &mut row);
    assert_close("kinetic energy regressor", &tree.by_body(|c| row[c]), &state.kinetic_regressor);
    potential_energy_regressor(model, data, &q, &mut row);
    assert_close("potential energy regressor", &tree.by_body(|c| row[c]), &state.potential_regressor);
    assert_close("centre of mass", center_of_mass(model, data, &q).as_slice(), &state.centre);
    let mut jacobian = Matrix3xX::zeros(model.nv());
    let (centre, _) = jacobian_center_of_mass(model, data, &q, &mut jacobian);
    assert_close("centre of mass with its Jacobian", centre.as_slice(), &state.centre);
    assert_close("Jacobian of the centre of mass", &tree.rows(3, |i, j| jacobian[(i, j)]), &state.centre_jacobian.concat());
}

fn check_jacobians(tree: &Tree, data: &mut Data, state: &State) {
    let Tree { model, order, .. } = tree;
    let (q, v) = (ours(order, &state.q), ours(order, &state.v));
    let j = joint_jacobians(model, data, &q);
    assert_close("joint Jacobians", &tree.rows(6, |i, k| j[(i, k)]), &state.joint_jacobians.concat());
    let frame = model.frame_on("test", &tree.last_link, Pose::identity()).expect("link by name");
    motion_of(model, data, &q, &v);
    let references = [
        (Reference::World, &state.jacobian_world, &state.variation_world),
        (Reference::Local, &state.jacobian_local, &state.variation_local),
        (Reference::LocalWorldAligned, &state.jacobian_aligned, &state.variation_aligned),
    ];
    for (reference, jacobian, variation) in references {
        let j = frame_jacobian(model, data, &frame, reference);
        assert_close(&format!("Jacobian {reference:?}"), &tree.rows(6, |i, k| j[(i, k)]), &jacobian.concat());
        let j = frame_jacobian_time_variation(model, data, &frame, reference);
        assert_close(&format!("time variation {reference:?}"), &tree.rows(6, |i, k| j[(i, k)]), &variation.concat());
    }
    let six = |m: Motion| [m.linear.x, m.linear.y, m.linear.z, m.angular.x, m.angular.y, m.angular.z];
    assert_close("velocity of a frame", &six(frame_velocity(data, &frame)), &state.velocity);
    world_accelerations(model, data, &ours(order, &state.a), &Vector3::zeros());
    assert_close("acceleration of a frame", &six(frame_acceleration(data, &frame)), &state.acceleration);
}

fn check_configuration(tree: &Tree, data: &mut Data, state: &State) {
    let Tree { model, order, .. } = tree;
    let [mut q, to, step] = [&state.q, &state.to, &state.step].map(|x| ours(order, x));
    let mut way = vec![f64::NAN; q.len()];
    difference(model, &q, &to, &mut way);
    assert_close("difference", &theirs(order, &way), &state.difference);
    integrate(model, &mut q, &step);
    forward_kinematics(model, data, &q);
    for (&body, want) in tree.bodies.iter().zip(&state.moved) {
        let pose = &data.pose_wb[body];
        assert_close("orientation after a step", pose.rotation.transpose().as_slice(), &want[..9]);
        assert_close("position after a step", pose.translation.as_slice(), &want[9..]);
    }
}

fn check(text: &str) {
    let golden: Golden<State> = serde_json::from_str(text).expect("golden file");
    let (model, order) = robot(&golden);
    let bodies = indices(&model, &golden.bodies);
    let mut data = Data::new(&model);
    let tree = Tree { model, order, bodies, last_link: golden.last_link };
    assert!(!golden.states.is_empty());
    for state in &golden.states {
        check_dynamics(&tree, &mut data, state);
        check_energies(&tree, &mut data, state);
        check_jacobians(&tree, &mut data, state);
        check_configuration(&tree, &mut data, state);
    }
}

#[test]
fn a_seven_joint_arm_with_rotors_agrees() {
    check(include_str!("pinocchio/arm7_dynamics.json"));
}

#[test]
fn a_branched_tree_with_rotors_agrees() {
    check(include_str!("pinocchio/branched_dynamics.json"));
}

#[test]
fn balls_planes_flying_bodies_and_universal_joints_agree() {
    check(include_str!("pinocchio/mixed_dynamics.json"));
}
