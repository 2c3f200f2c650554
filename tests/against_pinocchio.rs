//! Numbers of Pinocchio (golden/pinocchio, made by `make_golden.py` and its neighbours there), element by element.
//!
//! Not in here: robots of the papers, recorded data.

use pkm_dyn::inverse_dynamics::{actuated_regressor, closed_loop_motion, inverse_dynamics};
use pkm_dyn::model::Model;
use pkm_dyn::regressor::joint_torque_regressor;
use pkm_dyn::rnea::rnea;
use pkm_dyn::{Data, kinematics};
use pkm_tests::relative_error;
use serde::Deserialize;

use golden::{Golden, ours, robot, theirs};

mod golden;

/// Relative to the largest entry of the table compared: some ten digits above what two correct programs differ by.
const TOLERANCE: f64 = 1e-10;
/// What this machine reaches is kept in sight: ten times the largest difference seen on the tree robots.
const USUAL: f64 = 1e-13;

#[derive(Deserialize)]
struct TreeState {
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    tau: Vec<f64>,
    gravity: Vec<f64>,
    mass: Vec<Vec<f64>>,
    regressor: Vec<Vec<f64>>,
    rotation: Vec<Vec<f64>>,
    translation: Vec<f64>,
}

#[derive(Deserialize)]
struct LoopState {
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    tau: Vec<f64>,
}

fn assert_close(what: &str, got: &[f64], want: &[f64]) {
    let error = relative_error(got, want, 1e-9);
    assert!(error <= USUAL, "{what}: relative difference {error:.1e} (usual {USUAL:.0e}, limit {TOLERANCE:.0e})");
}

fn check_tree_state(model: &Model, order: &[usize], last_link: &str, state: &TreeState) {
    let mut data = Data::new(model);
    let n = model.nv();
    let (q, v, a) = (ours(order, &state.q), ours(order, &state.v), ours(order, &state.a));
    let zero = vec![0.0; n];
    assert_close("rnea", &theirs(order, rnea(model, &mut data, &q, &v, &a)), &state.tau);
    let gravity = theirs(order, rnea(model, &mut data, &q, &zero, &zero));
    assert_close("gravity", &gravity, &state.gravity);
    for (k, &j) in order.iter().enumerate() {
        let mut unit = zero.clone();
        unit[j] = 1.0;
        let with_weight = theirs(order, rnea(model, &mut data, &q, &zero, &unit));
        let column: Vec<f64> = with_weight.iter().zip(&gravity).map(|(x, g)| x - g).collect();
        let want: Vec<f64> = state.mass.iter().map(|row| row[k]).collect();
        // The difference loses digits to the weight: compare on its scale.
        assert!(relative_error(&column, &want, 10.0) <= USUAL * 10.0, "mass matrix column {k}");
    }
    let y = joint_torque_regressor(model, &mut data, &q, &v, &a);
    for (row, want) in order.iter().zip(&state.regressor) {
        let got: Vec<f64> = order.iter().flat_map(|&body| (0..10).map(move |p| 10 * body + p)).map(|c| y[(*row, c)]).collect();
        assert_close("regressor row", &got, want);
    }
    kinematics::forward_kinematics(model, &mut data, &q);
    let link = &model.links[model.link_index(last_link).expect("link by name")];
    let pose = data.pose_wb[link.body.expect("a moving link")].compose(&link.pose);
    assert_close("translation", pose.translation.as_slice(), &state.translation);
    let rows: Vec<f64> = pose.rotation.transpose().as_slice().to_vec();
    assert_close("rotation", &rows, &state.rotation.concat());
}

fn check_tree(text: &str) {
    let golden: Golden<TreeState> = serde_json::from_str(text).expect("golden file");
    let (model, order) = robot(&golden);
    for state in &golden.states {
        check_tree_state(&model, &order, &golden.last_link, state);
    }
}

#[test]
fn a_seven_joint_arm_agrees() {
    check_tree(include_str!("golden/pinocchio/arm7.json"));
}

#[test]
fn a_branched_tree_with_prismatic_joints_agrees() {
    check_tree(include_str!("golden/pinocchio/branched.json"));
}

/// Closes the loops from the stated assembly and compares the whole tree motion and the drives' efforts.
fn check_loops(text: &str) {
    let golden: Golden<LoopState> = serde_json::from_str(text).expect("golden file");
    let (model, order) = robot(&golden);
    let mut data = Data::new(&model);
    let mut worst = [0.0_f64; 5];
    for state in &golden.states {
        let pick = |x: &[f64]| -> Vec<f64> { model.actuators.iter().map(|&j| ours(&order, x)[j]).collect() };
        let (q, v, a) = (pick(&state.q), pick(&state.v), pick(&state.a));
        assert!(pkm_dyn::loops::assemble(&model, &mut data).is_closed);
        let closure = inverse_dynamics(&model, &mut data, &q, &v, &a);
        assert!(closure.is_closed, "{closure:?}");
        let tables = [(&data.q, &state.q), (&data.v, &state.v), (&data.a, &state.a)];
        for (k, (got, want)) in tables.into_iter().enumerate() {
            worst[k] = worst[k].max(relative_error(&theirs(&order, got), want, 1e-9));
        }
        worst[3] = worst[3].max(relative_error(&data.tau_act, &state.tau, 1e-9));
        assert!(closed_loop_motion(&model, &mut data, &q, &v, &a).is_closed);
        let w = actuated_regressor(&model, &mut data);
        let linear: Vec<f64> = (0..model.n_act()).map(|k| regressor_row_times_parameters(&model, w, k, a[k])).collect();
        worst[4] = worst[4].max(relative_error(&linear, &state.tau, 1e-9));
    }
    assert!(worst.iter().all(|&e| e <= TOLERANCE), "{}: q v a tau W·theta differ by {worst:?}", model.name);
}

fn regressor_row_times_parameters(model: &Model, w: &nalgebra::DMatrix<f64>, k: usize, a: f64) -> f64 {
    let bodies = model.bodies.iter().enumerate();
    let rigid: f64 = bodies.map(|(i, b)| (0..10).map(|p| w[(k, 10 * i + p)] * b.to_vector()[p]).sum::<f64>()).sum();
    rigid + model.joints[model.actuators[k]].armature * a
}

#[test]
fn a_platform_on_three_legs_with_ball_joints_agrees() {
    check_loops(include_str!("golden/pinocchio/spatial_loop.json"));
}

#[test]
fn a_spatial_loop_closed_by_a_pin_agrees() {
    check_loops(include_str!("golden/pinocchio/spatial_pin.json"));
}

#[test]
fn a_planar_four_bar_agrees() {
    check_loops(include_str!("golden/pinocchio/four_bar.json"));
}

#[test]
fn a_planar_five_bar_with_redundant_rows_agrees() {
    check_loops(include_str!("golden/pinocchio/five_bar.json"));
}
