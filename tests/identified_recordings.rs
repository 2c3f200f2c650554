//! Identification of robots that were really recorded, against published values and against a peer: the same program written with
//! Pinocchio, scipy and cvxpy (`golden/identification/make_golden.py`; its numbers are in `peer.json`).
//!
//! The recordings are not ours to give away and stay outside: `PKM_DATA` names the folder that holds `emps/`, `upv_3ups_rpu/` and
//! `dvrk_mtm/`. Without it these tests do not run, and say so.
#![expect(clippy::print_stdout, reason = "the numbers of every recording, for whoever runs it with --nocapture")]

use std::path::{Path, PathBuf};

use pkm_dyn::urdf::{Description, load, parse};
use pkm_ident::columns::Columns;
use pkm_ident::estimate::Method;
use pkm_ident::observation::{RowOptions, Standstill};
use pkm_ident::{Identification, Recording, Settings, identify};
use pkm_record::ReadOptions;
use serde::Deserialize;

const NOT_RUN: &str = "not run: PKM_DATA is not set";

fn folder(name: &str) -> Option<PathBuf> {
    std::env::var_os("PKM_DATA").map(|data| PathBuf::from(data).join(name))
}

fn read(path: &Path) -> Recording {
    pkm_record::read(path, &ReadOptions::default()).expect("the recording reads")
}

fn go(robot: &Description, fit: &[Recording], holdout: &[Recording], settings: &Settings) -> Identification {
    let answer = identify(&robot.robot, fit, holdout, settings, &mut |_| {}).expect("the recordings fit the robot");
    println!("{}, {}: {:?}", answer.robot, settings.method.name(), answer.status);
    answer.notes.iter().for_each(|note| println!("  {note}"));
    let of =
        |f: fn(&pkm_ident::answer::JointError) -> f64| answer.joints.iter().map(|j| format!("{:.1}", 100.0 * f(j))).collect::<Vec<_>>();
    println!("  held-out {:?} -> {:?} %, pooled {:.2} %", of(|j| j.nominal), of(|j| j.identified), 100.0 * answer.pooled(|j| j.identified));
    answer
}

fn with_band(method: Method, band: f64) -> Settings {
    Settings { method, rows: RowOptions { band_hz: Some(band), ..RowOptions::default() }, ..Settings::default() }
}

fn assert_physical(answer: &Identification) {
    for l in 0..answer.columns.links.len() {
        let lowest = Columns::inertial(&answer.theta, l).pseudo_inertia().symmetric_eigenvalues().min();
        assert!(lowest > 0.0, "link {l}: {lowest}");
    }
    for (p, x) in answer.columns.list.iter().zip(&answer.theta) {
        assert!(*x >= p.lower, "{} = {x}", p.name);
    }
}

/// Held-out errors of the peer on the same recordings, as shares of the effort's rms.
fn peer(robot: &str) -> Vec<f64> {
    #[derive(Deserialize)]
    struct Run {
        robot: String,
        heldout: Vec<f64>,
    }
    #[derive(Deserialize)]
    struct Peer {
        runs: Vec<Run>,
    }
    let all: Peer = serde_json::from_str(include_str!("golden/identification/peer.json")).expect("the golden file");
    all.runs.into_iter().find(|r| r.robot == robot).expect("the peer ran on it").heldout
}

fn pooled(errors: &[f64]) -> f64 {
    (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt()
}

#[test]
fn emps_has_the_published_parameters() {
    let Some(folder) = folder("emps") else { return println!("{NOT_RUN}") };
    let robot = load(&folder.join("robot.toml")).expect("the robot reads");
    let [train, pulses] = ["train.csv", "pulses.csv"].map(|f| read(&folder.join(f)));
    // As the authors did it: all samples, a sharp sign of velocity, 100 Hz.
    let rows = RowOptions { band_hz: Some(100.0), standstill: Standstill::Keep, softness: 1e-9, ..RowOptions::default() };
    let answer = go(&robot, &[train], &[pulses], &Settings { method: Method::Ols, rows, ..Settings::default() });
    let value = |start: &str| answer.parameters.iter().find(|p| p.name.starts_with(start)).unwrap_or_else(|| panic!("{start}"));
    // [Janot2019], least squares on the inverse dynamics model, with their standard deviations.
    for (name, published) in [("slide.viscous", 203.5034), ("slide.coulomb", 20.3935), ("slide.offset", -3.1648)] {
        let p = value(name);
        println!("{name}: {} [{}, {}], published {published}", p.value, p.ci95[0], p.ci95[1]);
        // Three digits, half a unit in the last of a number that begins with two; the authors decimated with another filter.
        assert!((p.value / published - 1.0).abs() < 2.5e-3, "{name}: {} instead of {published}", p.value);
    }
    let mass = answer.parameters.iter().find(|p| p.name.contains(".mass")).expect("the moving mass");
    println!("{}: {} [{}, {}]", mass.name, mass.value, mass.ci95[0], mass.ci95[1]);
    assert!((mass.value / 95.1089 - 1.0).abs() < 5e-4, "{} kg", mass.value);
}

#[test]
fn emps_predicts_as_well_as_the_peer() {
    let Some(folder) = folder("emps") else { return println!("{NOT_RUN}") };
    let robot = load(&folder.join("robot.toml")).expect("the robot reads");
    let [train, pulses] = ["train.csv", "pulses.csv"].map(|f| read(&folder.join(f)));
    let answer = go(&robot, &[train], &[pulses], &with_band(Method::Sdp, 40.0));
    assert_physical(&answer);
    assert!(answer.pooled(|j| j.identified) < 1.01 * pooled(&peer("emps")), "peer {:?}", peer("emps"));
}

#[test]
fn upv_legs_one_to_three_lose_at_least_two_fifths_of_their_error() {
    let Some(folder) = folder("upv_3ups_rpu") else { return println!("{NOT_RUN}") };
    let robot = load(&folder.join("robot.toml")).expect("the robot reads");
    let ident = read(&folder.join("ident_a.csv"));
    let answer = go(&robot, &[ident], &[], &with_band(Method::Sdp, 2.0));
    assert_physical(&answer);
    for j in answer.joints.iter().take(3) {
        assert!(j.identified < 0.6 * j.nominal, "{}: {:.3} of {:.3}", j.joint, j.identified, j.nominal);
    }
    // The fourth leg keeps two thirds of its error.
    let fourth = &answer.joints[3];
    assert!(fourth.identified < 0.7 * fourth.nominal, "{}: {:.3} of {:.3}", fourth.joint, fourth.identified, fourth.nominal);
    assert!(answer.pooled(|j| j.identified) < 1.01 * pooled(&peer("upv_3ups_rpu")), "peer {:?}", peer("upv_3ups_rpu"));
}

/// The arm with what its authors found besides rigid bodies and friction: a spring on a lever at the wrist and the cables on the
/// platform, each an effort periodic in the joint's angle.
fn dvrk(folder: &Path) -> Description {
    let mut toml = std::fs::read_to_string(folder.join("robot.toml")).expect("robot.toml");
    for (joint, order) in [("wrist_pitch", 1), ("wrist_pitch", 2), ("platform", 1), ("platform", 2)] {
        toml += &format!(
            "\n[[effect]]\nname = \"torque_ripple\"\nwhere = \"{joint}\"\nparameters = {{ amplitude = 0.0, order = {order}.0 }}\n"
        );
    }
    let urdf = std::fs::read_to_string(folder.join("dvrk_mtm.urdf")).expect("the URDF");
    parse(&toml, &urdf, ["robot.toml", "dvrk_mtm.urdf"]).expect("the robot reads")
}

#[test]
fn the_arm_with_a_parallelogram_is_predicted_as_its_authors_predict_it() {
    let Some(folder) = folder("dvrk_mtm") else { return println!("{NOT_RUN}") };
    let robot = dvrk(&folder);
    let [train, test] = ["train.csv", "test.csv"].map(|f| read(&folder.join(f)));
    let answer = go(&robot, &[train], &[test], &with_band(Method::Sdp, 1.8));
    assert_physical(&answer);
    // The best of the authors' weighted least squares, of their feasible fit, and of the fit with every term in the README of the data.
    let best = [0.064, 0.141, 0.170, 0.209, 0.202, 0.234, 0.316];
    for (j, best) in answer.joints.iter().zip(best) {
        assert!(j.identified < best + 0.01, "{}: {:.3}, best known {best}", j.joint, j.identified);
    }
    assert!(answer.pooled(|j| j.identified) < 1.01 * pooled(&peer("dvrk_mtm")), "peer {:?}", peer("dvrk_mtm"));
}
