//! Geometry and weight of robots that were really recorded. Their data are not ours to give away and stay outside: `PKM_DATA` names
//! the folder that holds `upv_3ups_rpu/`, `upv_3prs/`, `dvrk_mtm/`, `emps/`, `servo_xl330/`. Without it these tests do not run, and say so.

extern crate alloc;

use alloc::collections::BTreeMap;
use std::path::PathBuf;

use pkm_dyn::inverse_dynamics::{closed_loop_motion, inverse_dynamics};
use pkm_dyn::loops::{assemble, mobility, reduction, solve_positions, walk_to};
use pkm_dyn::{Data, Model, math};
use pkm_tests::read_csv;

const NOT_RUN: &str = "not run: PKM_DATA is not set";

fn data_folder() -> Option<PathBuf> {
    std::env::var_os("PKM_DATA").map(PathBuf::from)
}

fn robot(name: &str) -> Option<(Model, PathBuf)> {
    let folder = data_folder()?.join(name);
    let model = pkm_dyn::urdf::load(&folder.join("robot.toml")).expect("the robot reads").bare;
    Some((model, folder))
}

type Table = BTreeMap<String, Vec<f64>>;

fn drives_at(model: &Model, table: &Table, row: usize) -> Vec<f64> {
    model.actuators.iter().map(|&j| table[&format!("q.{}", model.joints[j].name)][row]).collect()
}

fn rows(table: &Table) -> usize {
    table["t"].len()
}

/// X, Z, pitch and yaw of the platform for the poses in `data`; its orientation is `Ry(pitch)·Rz(yaw)` [Armas, eq. 5].
fn platform_pose(model: &Model, data: &Data) -> [f64; 4] {
    let link = &model.links[model.link_index("platform").expect("platform")];
    let pose = data.pose_wb[link.body.expect("it moves")].compose(&link.pose);
    let r = pose.rotation;
    [pose.translation.x, pose.translation.z, math::atan2(r[(0, 2)], r[(2, 2)]), math::atan2(r[(1, 0)], r[(1, 1)])]
}

const POSE: [&str; 4] = ["pose_model.X", "pose_model.Z", "pose_model.theta", "pose_model.psi"];

#[test]
fn recorded_leg_lengths_close_to_the_recorded_platform_pose() {
    let Some((model, folder)) = robot("upv_3ups_rpu") else { return println!("{NOT_RUN}") };
    // The files print lengths to a micrometre: that much of the pose is not in them.
    let limits = [1.7e-6, 1.7e-6, 2.3e-6, 8.2e-6];
    for file in ["ident_a.csv", "rehab_a.csv", "singular_a.csv", "singular_b.csv"] {
        let table = read_csv(&folder.join(file));
        let mut data = Data::new(&model);
        let (mut worst, mut compared) = ([0.0_f64; 4], 0);
        for row in 0..rows(&table) {
            assert!(solve_positions(&model, &mut data, &drives_at(&model, &table, row)).is_closed, "{file} row {row}");
            let got = platform_pose(&model, &data);
            for (k, name) in POSE.into_iter().enumerate().filter(|(_, name)| !table[*name][row].is_nan()) {
                worst[k] = worst[k].max((got[k] - table[name][row]).abs());
                compared += 1;
            }
        }
        println!("{file}: {compared} coordinates, X Z theta psi differ by at most {worst:?}");
        assert!(compared > 10_000 && worst.iter().zip(limits).all(|(w, l)| *w <= l), "{file}: {worst:?}, limits {limits:?}");
    }
}

/// The same robot with the platform's own chain as drives: its closure is the inverse kinematics.
fn driven_by_the_platform(model: &Model) -> Model {
    let mut other = model.clone();
    other.actuators.clear();
    for joint in ["q41", "q42", "q43", "q44"] {
        other.add_actuator(joint, 0.0).expect("joint is there");
    }
    other
}

/// Coordinates of the platform's chain for a platform pose, from the pose at zero angles. The chain's first axis is −y, its third +y.
fn chain_at(home: &[f64; 4], hinge: f64, pose: [f64; 4]) -> [f64; 4] {
    let angle = |p: &[f64; 4]| math::atan2(p[0] - hinge, p[1]);
    let q41 = angle(home) - angle(&pose);
    [q41, math::hypot(pose[0] - hinge, pose[1]), pose[2] - home[2] + q41, pose[3] - home[3]]
}

#[test]
fn recorded_poses_give_the_recorded_lengths_and_the_controllers_gravity_term() {
    let Some((model, folder)) = robot("upv_3ups_rpu") else { return println!("{NOT_RUN}") };
    let table = read_csv(&folder.join("ident_a.csv"));
    let inverse = driven_by_the_platform(&model);
    let mut data = Data::new(&inverse);
    let mut forward = Data::new(&model);
    let hinge = model.joints[model.joint_index("q41").expect("q41")].placement.translation.x;
    let start = [0.0, math::hypot(0.02 - hinge, 0.64), 0.0, 0.0];
    assert!(solve_positions(&inverse, &mut data, &start).is_closed);
    let home = platform_pose(&inverse, &data);
    let (zero, mut worst, mut weight, mut compared) = ([0.0; 4], 0.0_f64, 0.0_f64, 0);
    for row in (0..rows(&table)).filter(|&row| !table["tau_grav_model.q13"][row].is_nan()) {
        let pose = POSE.map(|name| table[name][row]);
        assert!(solve_positions(&inverse, &mut data, &chain_at(&home, hinge, pose)).is_closed, "row {row}");
        let lengths: Vec<f64> = model.actuators.iter().map(|&j| data.q[j]).collect();
        for (got, want) in lengths.iter().zip(drives_at(&model, &table, row)) {
            worst = worst.max((got - want).abs());
        }
        forward.q.copy_from_slice(&data.q);
        assert!(inverse_dynamics(&model, &mut forward, &lengths, &zero, &zero).is_closed);
        for (k, &j) in model.actuators.iter().enumerate() {
            weight = weight.max((forward.tau_act[k] - table[&format!("tau_grav_model.{}", model.joints[j].name)][row]).abs());
            compared += 1;
        }
    }
    println!("{compared} legs: lengths differ by at most {worst:.2e} m, gravity forces by {weight:.2e} N");
    assert!(compared > 30_000 && worst < 1.1e-6 && weight < 8.5e-4, "{compared}: {worst} m, {weight} N");
}

#[test]
fn every_recorded_robot_is_assembled_by_walking_from_its_stated_assembly() {
    if data_folder().is_none() {
        return println!("{NOT_RUN}");
    }
    for (name, file, freedom) in [
        ("upv_3ups_rpu", "ident_a.csv", 4),
        ("upv_3prs", "tilt_a.csv", 3),
        ("dvrk_mtm", "train.csv", 7),
        ("emps", "train.csv", 1),
        ("servo_xl330", "kp100_sin_sin.csv", 1),
    ] {
        let (model, folder) = robot(name).expect("the folder is set");
        let mut data = Data::new(&model);
        let table = read_csv(&folder.join(file));
        data.q.copy_from_slice(&model.assembly);
        let closure = walk_to(&model, &mut data, &drives_at(&model, &table, 0));
        assert!(closure.is_closed, "{name}: {closure:?}");
        let q = data.q.clone();
        assert_eq!(mobility(&model, &mut data, &q), freedom, "{name}");
    }
}

/// The cables' ratio between shoulder, elbow and platform [README of the data].
const CABLE: f64 = 0.6697;

#[test]
fn the_parallelogram_keeps_its_constant_jacobian_along_both_recordings() {
    let Some((model, folder)) = robot("dvrk_mtm") else { return println!("{NOT_RUN}") };
    let joint = |name| model.joint_index(name).expect("joint by name");
    let drive = |name| model.actuators.iter().position(|&j| j == joint(name)).expect("drive by name");
    let (shoulder, elbow, motor) = (drive("shoulder_pitch"), drive("elbow_pitch"), drive("platform_drive"));
    for file in ["train.csv", "test.csv"] {
        let table = read_csv(&folder.join(file));
        let mut data = Data::new(&model);
        assert!(assemble(&model, &mut data).is_closed);
        assert!(walk_to(&model, &mut data, &drives_at(&model, &table, 0)).is_closed);
        let (mut worst, mut worst_ratio) = (0.0_f64, 0.0_f64);
        for row in 0..rows(&table) {
            let q = drives_at(&model, &table, row);
            assert!(solve_positions(&model, &mut data, &q).is_closed, "{file} row {row}");
            let want = [("elbow_passive", [-1.0, 1.0, 0.0]), ("coupler_passive", [1.0, -1.0, 0.0]), ("platform", [CABLE, -CABLE, 1.0])];
            reduction(&model, &mut data);
            for (name, ratios) in want {
                let expected = ratios[0] * q[shoulder] + ratios[1] * q[elbow] + ratios[2] * q[motor];
                worst = worst.max((data.q[joint(name)] - expected).abs());
                for (k, drive) in [shoulder, elbow, motor].into_iter().enumerate() {
                    worst_ratio = worst_ratio.max((data.reduction[(joint(name), drive)] - ratios[k]).abs());
                }
            }
        }
        println!("{file}: coordinates differ by {worst:.1e} rad, ratios by {worst_ratio:.1e}");
        assert!(worst < 1e-10 && worst_ratio < 1e-10, "{file}: {worst} rad, {worst_ratio}");
    }
}

#[test]
fn a_parallelogram_moved_at_constant_speed_needs_no_passive_acceleration() {
    let Some((model, folder)) = robot("dvrk_mtm") else { return println!("{NOT_RUN}") };
    let table = read_csv(&folder.join("train.csv"));
    let mut data = Data::new(&model);
    assert!(assemble(&model, &mut data).is_closed);
    assert!(walk_to(&model, &mut data, &drives_at(&model, &table, 0)).is_closed);
    let (v, a) = ([1.0, -2.0, 1.5, 0.7, -3.0, 2.0, 1.0], [0.0; 7]);
    let mut worst = 0.0_f64;
    for row in (0..rows(&table)).step_by(7) {
        assert!(closed_loop_motion(&model, &mut data, &drives_at(&model, &table, row), &v, &a).is_closed);
        worst = data.a.iter().fold(worst, |top, x| top.max(x.abs()));
    }
    // The constant Jacobian has no drift: whatever remains is rounding.
    assert!(worst < 1e-10, "{worst} rad/s²");
}

#[test]
fn slider_heights_close_to_the_recorded_leg_angles() {
    let Some((model, folder)) = robot("upv_3prs") else { return println!("{NOT_RUN}") };
    let level = 1.401_502_362_971_559;
    let table = read_csv(&folder.join("tilt_a.csv"));
    let mut data = Data::new(&model);
    let (mut worst, mut compared) = (0.0_f64, 0);
    for row in 0..rows(&table) {
        assert!(solve_positions(&model, &mut data, &drives_at(&model, &table, row)).is_closed, "row {row}");
        for name in ["q2", "q7", "q9"] {
            let want = table[&format!("pose_model.{name}")][row];
            if !want.is_nan() {
                let got = data.q[model.joint_index(name).expect("joint by name")] - level;
                worst = worst.max((got - want).abs());
                compared += 1;
            }
        }
    }
    println!("{compared} leg angles, largest difference {worst:.1e} rad");
    assert!(compared > 10_000 && worst < 1e-5, "{compared} compared, {worst} rad");
}
