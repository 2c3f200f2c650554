//! Efforts a thousand times too small or too large, and time a thousand times too long: recognised by what the model says of the same motion,
//! and by nothing else that may be wrong with a robot. Real recordings are read through `PKM_DATA`; without it their test says "not run".

use core::panic::AssertUnwindSafe;
use core::slice::from_ref;
use std::panic::{catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};

use pkm_diagnose::verdict::Status;
use pkm_diagnose::{Located, Settings, Watch, diagnose, diagnose_watched};
use pkm_dyn::Data;
use pkm_dyn::effects::{Applied, Robot};
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::urdf::{Description, load, parse};
use pkm_ident::note::Note;
use pkm_ident::seconds::other_time;
use pkm_ident::{Recording, identify};
use pkm_record::ReadOptions;
use pkm_sim::Scenario;

/// Unwinds a diagnosis that has found its recordings usable.
struct Usable;

impl Watch for Usable {
    fn progress(&mut self, _share: f64) {}

    fn located(&mut self, _first: Option<&Located>) {
        resume_unwind(Box::new(Usable));
    }
}

/// What a diagnosis has against the recordings; none where it goes on to look for physics.
fn refusal(robot: &Description, train: &[Recording], holdout: &[Recording]) -> Option<String> {
    let run = || diagnose_watched(robot, (train, holdout), &Settings::default(), None, &mut Usable);
    match catch_unwind(AssertUnwindSafe(run)) {
        Ok(Ok(d)) if d.verdict.status == Status::Unusable => Some(d.verdict.says),
        Ok(other) => panic!("neither usable nor unusable: {other:?}"),
        Err(stopped) if stopped.is::<Usable>() => None,
        Err(panic) => resume_unwind(panic),
    }
}

fn shipped(name: &str) -> Description {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("a shipped robot reads")
}

/// Effect, place, numbers.
type Hidden<'a> = (&'a str, &'a str, &'a [(&'a str, f64)]);

/// Ten seconds of the robot with `hidden` besides its files.
fn recorded(nominal: &Description, hidden: &[Hidden], seed: u64) -> Recording {
    let effect = |(name, place, numbers): &Hidden| {
        let numbers: Vec<(String, f64)> = numbers.iter().map(|(n, v)| ((*n).to_string(), *v)).collect();
        Applied::try_new(&nominal.bare, name, place, &numbers).expect("a valid effect")
    };
    let effects = nominal.robot.effects.iter().cloned().chain(hidden.iter().map(effect)).collect();
    let truth = Robot::new(nominal.bare.clone(), effects);
    let scenario = Scenario { seed, duration_s: 10.0, ..Scenario::default() };
    let mut out = pkm_sim::run(&truth, &nominal.robot, &scenario, &mut |_| {}).expect("the closed loop runs");
    out.name = format!("motion{seed}");
    out
}

/// The recording with the efforts of all drives, or of one, multiplied.
fn times(r: &Recording, factor: f64, joint: Option<&str>) -> Recording {
    let mut out = r.clone();
    let is_meant = |name: &str| joint.map_or(name.starts_with("tau."), |j| name == format!("tau.{j}"));
    out.signals.iter_mut().filter(|(name, _)| is_meant(name)).for_each(|(_, x)| x.iter_mut().for_each(|x| *x *= factor));
    out
}

/// The recording with its clock multiplied.
fn clock(r: &Recording, factor: f64) -> Recording {
    let mut out = r.clone();
    out.time.iter_mut().for_each(|t| *t *= factor);
    out
}

/// What a recording would be of a robot that creeps along the same path a thousand times as slowly: its weight alone, and noise.
fn creeping(robot: &Robot, r: &Recording) -> Recording {
    let (model, mut out) = (&robot.model, clock(r, 1e3));
    let mut data = Data::new(model);
    assert!(pkm_dyn::loops::assemble(model, &mut data).is_closed);
    let still = vec![0.0; model.n_act()];
    for i in 0..r.len() {
        let q: Vec<f64> = model.actuators.iter().map(|&j| r.signals[&format!("q.{}", model.joints[j].name)][i]).collect();
        assert!(inverse_dynamics(model, &mut data, &q, &still, &still).is_closed);
        for (k, &j) in model.actuators.iter().enumerate() {
            let noise = 0.05 * pkm_dyn::math::sin(7919.0 * (i * (k + 1)) as f64);
            out.signals.get_mut(&format!("tau.{}", model.joints[j].name)).expect("an effort")[i] = data.tau_act[k] + noise;
        }
    }
    out
}

/// Columns of efforts that a refusal names.
fn named(robot: &Description, says: &str) -> Vec<String> {
    let model = &robot.robot.model;
    let columns = model.actuators.iter().map(|&j| format!("tau.{}", model.joints[j].name));
    let is_there = |c: &String| says.replace(',', " ").split(' ').any(|word| word == c);
    columns.filter(is_there).collect()
}

#[test]
fn every_shipped_robot_in_kilonewtons_is_told_so_and_as_recorded_it_is_not() {
    for name in pkm_robots::ALL.iter().map(|r| r.name) {
        let robot = shipped(name);
        let r = recorded(&robot, &[], 1);
        assert_eq!(refusal(&robot, from_ref(&r), &[]), None, "{name}");
        let says = refusal(&robot, &[times(&r, 1e-3, None)], &[]).unwrap_or_else(|| panic!("{name} in kN is taken"));
        assert!(says.starts_with("recording unusable: motion1: tau.") && says.contains("Multiply by 1000 to have N"), "{name}: {says}");
        let drives = robot.robot.model.actuators.iter().map(|&j| format!("tau.{}", robot.robot.model.joints[j].name));
        assert_eq!(named(&robot, &says), drives.collect::<Vec<_>>(), "{name}: {says}");
    }
}

#[test]
fn thousandths_are_told_where_weight_or_coupling_shows_them() {
    // Not of a foot whose one drive feels hardly more than its own inertia: a rotor could be missing as well.
    for name in ["prs3", "ups3_rpu1", "five_bar", "serial_arm", "serial_arm7"] {
        let robot = shipped(name);
        let r = recorded(&robot, &[], 1);
        let says = refusal(&robot, &[times(&r, 1e3, None)], &[]).unwrap_or_else(|| panic!("{name} in thousandths is taken"));
        assert!(says.contains("Multiply by 0.001 to have N") && says.contains("recorded in mN"), "{name}: {says}");
    }
    let foot = shipped("motobotte");
    assert_eq!(refusal(&foot, &[times(&recorded(&foot, &[], 1), 1e3, None)], &[]), None);
}

#[test]
fn turned_signs_and_exchanged_columns_are_told_and_nothing_is_made_of_them() {
    for name in ["prs3", "serial_arm", "five_bar", "motobotte"] {
        let robot = shipped(name);
        let r = recorded(&robot, &[], 1);
        let drives: Vec<String> = robot.robot.model.actuators.iter().map(|&j| robot.robot.model.joints[j].name.clone()).collect();
        let says = refusal(&robot, &[times(&r, -1.0, None)], &[]).unwrap_or_else(|| panic!("{name} with turned signs is taken"));
        assert!(says.contains("with its sign turned") && named(&robot, &says).len() == drives.len(), "{name}: {says}");
        let says = refusal(&robot, &[times(&r, -1.0, Some(&drives[0]))], &[]).unwrap_or_else(|| panic!("one sign of {name} is taken"));
        assert_eq!(named(&robot, &says), [format!("tau.{}", drives[0])], "{name}: {says}");
    }
    let robot = shipped("serial_arm");
    let mut r = recorded(&robot, &[], 1);
    let [a, b] = ["tau.j2", "tau.j3"].map(|c| r.signals[c].clone());
    r.signals.extend([("tau.j2".to_string(), b), ("tau.j3".to_string(), a)]);
    let says = refusal(&robot, from_ref(&r), &[]).expect("exchanged columns are taken");
    assert!(says.contains("are the columns exchanged?") && named(&robot, &says) == ["tau.j2", "tau.j3"], "{says}");
    let found = identify(&robot.robot, from_ref(&r), &[], &pkm_ident::Settings::default(), &mut |_| {}).expect("it reads");
    assert!(found.notes.iter().any(|n| matches!(n, Note::Mixed(_))), "{:?}", found.notes);
}

#[test]
fn one_column_or_one_held_out_recording_in_another_unit_is_named() {
    let robot = shipped("prs3");
    let [r, other] = [1, 2].map(|seed| recorded(&robot, &[], seed));
    let says = refusal(&robot, &[times(&r, 1e-3, Some("q6"))], from_ref(&other)).expect("one column in kN");
    assert_eq!(named(&robot, &says), ["tau.q6"], "{says}");
    let says = refusal(&robot, from_ref(&r), &[times(&other, 1e3, None)]).expect("a hold-out in mN");
    assert!(says.contains("motion2: ") && says.contains("recorded in mN?") && says.contains("Multiply by 0.001 to have N"), "{says}");
    assert_eq!(named(&robot, &says), ["tau.q1", "tau.q6", "tau.q8"], "{says}");
}

#[test]
fn what_else_is_wrong_with_a_robot_is_no_unit_and_hides_none() {
    let robot = shipped("prs3");
    let wrong: [Hidden; 6] = [
        ("torque_constant", "q1", &[("scale", 0.8)]),
        ("torque_constant", "q6", &[("scale", 1.25)]),
        ("payload", "platform", &[("mass", 10.0)]),
        ("friction_coulomb", "q8", &[("coulomb", 120.0)]),
        ("friction_viscous", "q1", &[("viscous", 400.0)]),
        ("rotor_inertia", "q6", &[("inertia", 60.0)]),
    ];
    for hidden in wrong {
        let r = recorded(&robot, &[hidden], 3);
        assert_eq!(refusal(&robot, from_ref(&r), &[]), None, "{hidden:?}");
        for factor in [1e-3, 1e3] {
            let says = refusal(&robot, &[times(&r, factor, None)], &[]).unwrap_or_else(|| panic!("{hidden:?} times {factor} is taken"));
            assert!(says.contains(&format!("Multiply by {} to have N", 1.0 / factor)), "{says}");
        }
        // Ten times, or a tenth: newtons read as kilograms, a gear that is not counted. Wrong, but not this.
        for factor in [0.1, 10.0] {
            assert_eq!(refusal(&robot, &[times(&r, factor, None)], &[]), None, "{hidden:?} times {factor}");
        }
    }
}

#[test]
fn the_factor_that_is_told_makes_the_recording_healthy() {
    let robot = shipped("five_bar");
    let [r, other] = [4, 5].map(|seed| recorded(&robot, &[], seed));
    let [kilo, also] = [&r, &other].map(|r| times(r, 1e-3, None));
    let run = |a: &Recording, b: &Recording| {
        diagnose(&robot, from_ref(a), from_ref(b), &Settings::default(), &mut |_| {}).expect("recordings of this robot").verdict
    };
    let refused = run(&kilo, &also);
    assert_eq!((refused.status, refused.findings.len(), refused.nothing_missing), (Status::Unusable, 0, false));
    assert!(!refused.says.contains('\n'), "{}", refused.says);
    let mended = run(&times(&kilo, 1e3, None), &times(&also, 1e3, None));
    assert_eq!((mended.status, mended.findings.len()), (Status::Ok, 0), "{}", mended.says);
}

#[test]
fn a_clock_in_milliseconds_is_told_and_a_robot_that_creeps_is_not_taken_for_one() {
    for name in pkm_robots::ALL.iter().map(|r| r.name) {
        let robot = shipped(name);
        let r = recorded(
            &robot,
            &[("friction_viscous", &robot.robot.model.joints[robot.robot.model.actuators[0]].name, &[("viscous", 1.0)])],
            6,
        );
        for (factor, unit) in [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")] {
            let says = refusal(&robot, &[clock(&r, factor)], &[]).unwrap_or_else(|| panic!("{name} in {unit} is taken"));
            let parts = [format!("only when t is divided by {factor} "), format!("is t in {unit}? It must be in seconds")];
            assert!(
                says.starts_with("recording unusable: motion6: samples are ") && parts.iter().all(|p| says.contains(p)),
                "{name}: {says}"
            );
        }
        // However it goes on with so slow a motion, time is not what it has against it.
        assert_eq!(other_time(&robot.robot, &creeping(&robot.robot, &r)), None, "{name}");
    }
}

#[test]
fn nothing_is_identified_by_a_clock_in_milliseconds() {
    let robot = shipped("five_bar");
    let [r, other] = [7, 8].map(|seed| recorded(&robot, &[], seed));
    let notes = |fit: &Recording, holdout: &Recording| {
        let found =
            identify(&robot.robot, from_ref(fit), from_ref(holdout), &Default::default(), &mut |_| {}).expect("readable recordings");
        let told = found.notes.into_iter().find_map(|n| if let Note::OtherTime(t) = n { Some((t.recording, t.recorded_in)) } else { None });
        (found.status == pkm_ident::note::Status::NotIdentified, told)
    };
    let told = |name: &str| (true, Some((name.to_string(), "milliseconds")));
    assert_eq!(notes(&clock(&r, 1e3), &other), told("motion7"));
    assert_eq!(notes(&r, &clock(&other, 1e3)), told("motion8"));
    assert_eq!(notes(&r, &other), (false, None));
}

#[expect(clippy::print_stdout, reason = "a test that could not run must say so")]
fn data() -> Option<PathBuf> {
    let root = std::env::var_os("PKM_DATA").map(PathBuf::from).filter(|p| p.is_dir());
    if root.is_none() {
        println!("not run: PKM_DATA is not set");
    }
    root
}

fn read(path: &Path) -> Recording {
    pkm_record::read(path, &ReadOptions::default()).expect("a readable recording")
}

#[test]
fn no_real_recording_is_taken_for_one_in_another_unit() {
    let Some(root) = data() else { return };
    let (mut judged, mut in_milliseconds, mut told) = (0, Vec::new(), Vec::new());
    for robot in ["dvrk_mtm", "emps", "servo_xl330", "upv_3prs", "upv_3ups_rpu"] {
        let folder = root.join(robot);
        let description = load(&folder.join("robot.toml")).expect("a readable robot");
        let mut files: Vec<PathBuf> = std::fs::read_dir(&folder).expect("a folder").map(|e| e.expect("an entry").path()).collect();
        files.retain(|p| p.extension().is_some_and(|e| e == "csv"));
        files.sort();
        for file in files {
            let r = read(&file);
            // One of them is half gaps, which is told; none is in another unit.
            let says = refusal(&description, from_ref(&r), &[]).unwrap_or_default();
            assert!(!says.contains("Multiply by") && (says.is_empty() || says.contains("free of gaps")), "{robot}: {says}");
            judged += 1;
            if refusal(&description, &[times(&r, 1e-3, None)], &[]).is_some_and(|says| says.contains("Multiply by 1000 to have N")) {
                told.push(format!("{robot}/{}", file.file_name().expect("a name").display()));
            }
            assert_eq!(other_time(&description.robot, &r), None, "{robot}: {}", r.name);
            if other_time(&description.robot, &clock(&r, 1e3)).is_some_and(|t| t.recorded_in == "milliseconds") {
                in_milliseconds.push(format!("{robot}/{}", file.file_name().expect("a name").display()));
            }
        }
    }
    assert!(judged > 20, "{judged} recordings");
    // Where the robot's file explains its efforts at all, they are missed when they are a thousandth.
    for file in ["dvrk_mtm/train.csv", "dvrk_mtm/test.csv", "emps/train.csv", "emps/pulses.csv", "upv_3ups_rpu/ident_a.csv"] {
        assert!(told.iter().any(|t| t == file), "{file} in kN is taken; told: {told:?}");
    }
    assert!(4 * told.len() > 3 * judged, "{} of {judged} told: {told:?}", told.len());
    // An axis without weight has nothing but inertia to follow. What a robot's weight explains by either clock is not told, and need not be.
    assert!(in_milliseconds.iter().any(|file| file == "emps/train.csv"), "told in milliseconds: {in_milliseconds:?}");
}
