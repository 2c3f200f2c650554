//! A push concealed in a run is named when and where it was, and nothing that stays is called a push.

use pkm_diagnose::{Diagnosis, Settings, diagnose};
use pkm_dyn::effects::{Applied, Robot};
use pkm_dyn::urdf::{Description, parse};
use pkm_sim::Scenario;

fn shipped(name: &str) -> Description {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("a shipped robot reads")
}

fn effect(nominal: &Description, name: &str, place: &str, numbers: &[(&str, f64)]) -> Applied {
    let numbers: Vec<(String, f64)> = numbers.iter().map(|(n, v)| (n.to_string(), *v)).collect();
    Applied::try_new(&nominal.bare, name, place, &numbers).expect("a valid effect")
}

/// Diagnoses a motion with `hidden` and judges on another one with `in_holdout`.
fn judged(nominal: &Description, hidden: &[Applied], in_holdout: &[Applied], seed: u64) -> Diagnosis {
    let record = |effects: &[Applied], seed: u64| {
        let truth = Robot::new(nominal.bare.clone(), effects.to_vec());
        let scenario = Scenario { seed, ..Scenario::default() };
        let mut r = pkm_sim::run(&truth, &nominal.robot, &scenario, &mut |_| {}).expect("the closed loop runs");
        r.name = format!("motion{seed}");
        r
    };
    let (train, holdout) = (record(hidden, 10 * seed + 1), record(in_holdout, 10 * seed + 2));
    diagnose(nominal, &[train], &[holdout], &Settings::default(), &mut |_| {}).expect("the recordings are usable")
}

/// Robot, link, start, end and force of the pushes, about twice the smallest that a recording of that robot shows.
const PUSHES: [(&str, &str, [f64; 2], [f64; 3]); 2] =
    [("prs3", "platform", [5.0, 9.5], [10.0, 0.0, 60.0]), ("serial_arm", "flange", [6.0, 10.0], [8.0, 0.0, 10.0])];

#[test]
fn a_push_is_named_with_its_times_and_its_force() {
    for (robot, link, [start, end], [fx, fy, fz]) in PUSHES {
        let nominal = shipped(robot);
        let push = [effect(&nominal, "external_force", link, &[("start", start), ("end", end), ("fx", fx), ("fy", fy), ("fz", fz)])];
        let d = judged(&nominal, &push, &push, 4);
        let found =
            d.verdict.findings.iter().find(|f| f.effect == "external_force").unwrap_or_else(|| panic!("{robot}: {}", d.verdict.says));
        let value = |name: &str| found.parameters[name].value;
        assert!((value("start") - start).abs() < 0.2 && (value("end") - end).abs() < 0.2, "{robot}: {:?}", found.parameters);
        assert!(found.place == [link] || found.cannot_tell_from.iter().any(|a| a.place == [link]), "{robot}: {:?}", found.place);
        assert!(found.heldout_rms_after < found.heldout_rms_before, "{robot}: {:?}", d.verdict.heldout);
    }
}

/// Robot, effect, place and numbers.
type Case<'c> = (&'c str, &'c str, &'c str, &'c [(&'c str, f64)]);

#[test]
fn what_stays_is_no_push() {
    let cases: [Case; 3] = [
        ("prs3", "payload", "platform", &[("mass", 1.5)]),
        ("prs3", "limb_impedance", "platform", &[("stiffness", 700.0), ("damping", 40.0)]),
        ("serial_arm", "spring", "j2", &[("stiffness", 20.0), ("rest", 0.3)]),
    ];
    for (robot, name, place, numbers) in cases {
        let nominal = shipped(robot);
        let hidden = [effect(&nominal, name, place, numbers)];
        let d = judged(&nominal, &hidden, &hidden, 5);
        assert!(d.verdict.findings.iter().all(|f| f.effect != "external_force"), "{robot}, {name}: {}", d.verdict.says);
    }
}
