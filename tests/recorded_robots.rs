//! Geometry and weight of robots that were really recorded. Their data are not ours to give away and stay outside: `PKM_DATA` names
//! the folder that holds `upv_3ups_rpu/`, `upv_3prs/`, `dvrk_mtm/`, `emps/`, `servo_xl330/`. Without it these tests do not run, and say so.

extern crate alloc;

use alloc::collections::BTreeMap;
use std::path::PathBuf;

use nalgebra::{Matrix3, Vector3};
use pkm_dyn::inverse_dynamics::{closed_loop_motion, inverse_dynamics};
use pkm_dyn::loops::{assemble, mobility, solve_positions, walk_to};
use pkm_dyn::spatial::Pose;
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

/// A shipped robot, to be compared with the machine it was made after.
fn shipped(name: &str) -> Model {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    pkm_dyn::urdf::parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("a shipped robot reads").bare
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

/// Largest differences along a recording of lengths `[m]` and of gravity forces `[N]` from what `model` has at the recorded poses, and
/// the number of legs compared. `start` is q42 at the pose where the model's angles read zero.
fn lengths_and_weight(model: &Model, table: &Table, start: f64) -> (f64, f64, usize) {
    let inverse = driven_by_the_platform(model);
    let (mut data, mut forward) = (Data::new(&inverse), Data::new(model));
    let hinge = model.joints[model.joint_index("q41").expect("q41")].placement.translation.x;
    data.q.copy_from_slice(&model.assembly);
    assert!(solve_positions(&inverse, &mut data, &[0.0, start, 0.0, 0.0]).is_closed);
    let home = platform_pose(&inverse, &data);
    let (zero, mut worst, mut weight, mut compared) = ([0.0; 4], 0.0_f64, 0.0_f64, 0);
    for row in (0..rows(table)).filter(|&row| !table["tau_grav_model.q13"][row].is_nan()) {
        let chain = chain_at(&home, hinge, POSE.map(|name| table[name][row]));
        let closure = if compared == 0 { walk_to(&inverse, &mut data, &chain) } else { solve_positions(&inverse, &mut data, &chain) };
        assert!(closure.is_closed, "row {row}: {closure:?}");
        let lengths: Vec<f64> = model.actuators.iter().map(|&j| data.q[j]).collect();
        for (got, want) in lengths.iter().zip(drives_at(model, table, row)) {
            worst = worst.max((got - want).abs());
        }
        forward.q.copy_from_slice(&data.q);
        assert!(inverse_dynamics(model, &mut forward, &lengths, &zero, &zero).is_closed);
        for (k, &j) in model.actuators.iter().enumerate() {
            weight = weight.max((forward.tau_act[k] - table[&format!("tau_grav_model.{}", model.joints[j].name)][row]).abs());
            compared += 1;
        }
    }
    (worst, weight, compared)
}

#[test]
fn recorded_poses_give_the_recorded_lengths_and_the_controllers_gravity_term() {
    let Some((recorded, folder)) = robot("upv_3ups_rpu") else { return println!("{NOT_RUN}") };
    let table = read_csv(&folder.join("ident_a.csv"));
    // The robot beside the recordings has its zero at X = 0.02, Z = 0.64 m, the shipped one at 0.05 and 0.70 m; leg 4's hinge is at 0.15 m.
    for (model, start) in [(recorded, math::hypot(0.02 - 0.15, 0.64)), (shipped("ups3_rpu1"), math::hypot(0.05 - 0.15, 0.70))] {
        let (worst, weight, compared) = lengths_and_weight(&model, &table, start);
        println!("{}: {compared} legs: lengths differ by at most {worst:.2e} m, gravity forces by {weight:.2e} N", model.name);
        // Poses and lengths are printed to a micrometre; forces to a millinewton.
        assert!(compared > 30_000 && worst < 1.1e-6 && weight < 1e-3, "{}: {compared}: {worst} m, {weight} N", model.name);
    }
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

/// Lengths of the recorded 3-PRS [README of the data]: slider to centre, coupler, sphere to sphere.
const PRS: [f64; 3] = [0.384_516, 0.513_997, 0.516_003];

/// Sphere of a leg for its slider height and its absolute angle [Valera2017, Figure 2].
fn sphere(leg: usize, s: f64, t: f64) -> Vector3<f64> {
    let (sa, ca) = math::sin_cos(leg as f64 * 2.0 * core::f64::consts::PI / 3.0);
    let out = PRS[0] - PRS[1] * math::cos(t);
    Vector3::new(out * ca, out * sa, s + PRS[1] * math::sin(t))
}

/// Platform orientation as the recording's software has it: its first axis is parallel to the side of the base between legs 1 and 2, not
/// to the hinge of leg 1, which only its own files need.
fn recorded_orientation(q2: f64, q3: f64, q4: f64, q5: f64) -> Matrix3<f64> {
    let about = |axis: usize, degrees: f64| {
        let mut rpy = [0.0; 3];
        rpy[axis] = degrees.to_radians();
        Pose::from_xyz_rpy([0.0; 3], rpy).rotation
    };
    let z = |angle: f64| Pose::from_xyz_rpy([0.0; 3], [0.0, 0.0, angle]).rotation;
    let to_hinge = about(2, 60.0) * about(0, -90.0) * z(q2 + q3) * about(2, 30.0);
    to_hinge * about(0, -90.0) * z(q4) * about(0, -90.0) * z(q5)
}

/// Spheres 2 and 3 in the recording's platform frame.
fn recorded_corners() -> [Vector3<f64>; 2] {
    [180.0_f64, 240.0].map(|degrees| {
        let (s, c) = math::sin_cos(degrees.to_radians());
        Vector3::new(PRS[2] * c, PRS[2] * s, 0.0)
    })
}

#[test]
fn nine_recorded_coordinates_of_the_3prs_satisfy_its_constraints() {
    let Some((_, folder)) = robot("upv_3prs") else { return println!("{NOT_RUN}") };
    let model = shipped("prs3");
    let mut data = Data::new(&model);
    let table = read_csv(&folder.join("tilt_a.csv"));
    assert!(assemble(&model, &mut data).is_closed && walk_to(&model, &mut data, &drives_at(&model, &table, 0)).is_closed);
    let (mut open, mut apart) = (Vec::new(), 0.0_f64);
    for row in (0..rows(&table)).filter(|&row| !table["pose_model.q1"][row].is_nan()) {
        let q = |name: &str| table[&format!("pose_model.{name}")][row];
        let other = |name: &str| table[&format!("pose_model_other_convention.{name}")][row];
        let legs = [("q1", "q2"), ("q6", "q7"), ("q8", "q9")];
        let p: [Vector3<f64>; 3] = core::array::from_fn(|leg| sphere(leg, q(legs[leg].0), q(legs[leg].1)));
        let turn = recorded_orientation(q("q2"), other("q3"), other("q4"), other("q5"));
        // The constraints of equation (1): from sphere 1 over the platform to the others.
        let gaps = recorded_corners().into_iter().zip(&p[1..]).map(|(corner, end)| (p[0] + turn * corner - end).amax());
        open.push(gaps.fold(0.0, f64::max));
        // The shipped robot at the same slider heights has its spheres in the same places.
        assert!(solve_positions(&model, &mut data, &[q("q1"), q("q6"), q("q8")]).is_closed, "row {row}");
        let platform = &model.links[model.link_index("platform").expect("platform")];
        let pose = data.pose_wb[platform.body.expect("it moves")].compose(&platform.pose);
        for (l, end) in model.loops.iter().zip(&p[1..]) {
            apart = apart.max((pose.transform_point(&l.a.pose.translation) - end).amax());
        }
    }
    open.sort_by(f64::total_cmp);
    let (share, last) = (open[open.len() * 9 / 10], open[open.len() - 1]);
    println!("{} rows: constraints open by {share:.1e} m (90 %), {last:.1e} m (all); shipped robot {apart:.1e} m away", open.len());
    // The file prints angles to 1e-5 rad: five of them, half a digit each, at half a metre, may add up to 1.3e-5 m.
    assert!(open.len() > 5000 && share < 5e-6 && last < 1.3e-5 && apart < 5e-6, "{share} m, {last} m, {apart} m");
}
