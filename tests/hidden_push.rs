//! A push concealed in a run is named when and where it was, and nothing that stays is called a push.

use pkm_diagnose::{Diagnosis, Settings, diagnose};
use pkm_dyn::effects::{Applied, Robot};
use pkm_dyn::kinematics::frame_pose;
use pkm_dyn::model::FrameOnBody;
use pkm_dyn::urdf::{Description, parse};
use pkm_dyn::{Data, loops};
use pkm_ident::Recording;
use pkm_sim::Scenario;

fn shipped(name: &str) -> Description {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("a shipped robot reads")
}

fn effect(nominal: &Description, name: &str, place: &str, numbers: &[(&str, f64)]) -> Applied {
    let numbers: Vec<(String, f64)> = numbers.iter().map(|(n, v)| (n.to_string(), *v)).collect();
    Applied::try_new(&nominal.bare, name, place, &numbers).expect("a valid effect")
}

/// A motion of its own with these effects.
fn record(nominal: &Description, effects: &[Applied], seed: u64) -> Recording {
    let truth = Robot::new(nominal.bare.clone(), effects.to_vec());
    let scenario = Scenario { seed, ..Scenario::default() };
    let mut r = pkm_sim::run(&truth, &nominal.robot, &scenario, &mut |_| {}).expect("the closed loop runs");
    r.name = format!("motion{seed}");
    r
}

/// Diagnoses a motion with `hidden` and judges on another one with `in_holdout`.
fn judged(nominal: &Description, hidden: &[Applied], in_holdout: &[Applied], seed: u64) -> Diagnosis {
    let (train, holdout) = (record(nominal, hidden, 10 * seed + 1), record(nominal, in_holdout, 10 * seed + 2));
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

#[test]
fn a_limb_that_holds_the_middle_of_a_platform_is_named_with_its_stiffness_wherever_recordings_begin() {
    let nominal = shipped("prs3");
    let model = &nominal.bare;
    let link = model.link_index("platform").expect("a platform");
    // The platform's frame lies in a joint at its rim.
    let (middle, _) = model.links[link].parameters.centre_of_mass();
    assert!(middle.norm() > 0.1);
    let mut data = Data::new(model);
    assert!(loops::assemble(model, &mut data).is_closed);
    let rest = frame_pose(&data, &FrameOnBody { body: model.links[link].body, pose: model.links[link].pose });
    let rest = rest.rotation * middle + rest.translation;
    let numbers = [
        ("stiffness", 700.0),
        ("damping", 40.0),
        ("in_space", 1.0),
        ("rest_x", rest.x),
        ("rest_y", rest.y),
        ("rest_z", rest.z),
        ("x", middle.x),
        ("y", middle.y),
        ("z", middle.z),
    ];
    let limb = [effect(&nominal, "limb_impedance", "platform", &numbers)];
    let train = [71, 72].map(|seed| record(&nominal, &limb, seed));
    let d = diagnose(&nominal, &train, &[record(&nominal, &limb, 73)], &Settings::default(), &mut |_| {}).expect("usable recordings");
    let f = d.verdict.findings.first().unwrap_or_else(|| panic!("{}", d.verdict.says));
    assert_eq!((f.effect.as_str(), f.place[0].as_str()), ("limb_impedance", "platform"), "{}", d.verdict.says);
    assert!((f.parameters["stiffness"].value / 700.0 - 1.0).abs() < 0.05, "{:?}", f.parameters);
    assert!((f.parameters["damping"].value / 40.0 - 1.0).abs() < 0.1, "{:?}", f.parameters);
    let h = &d.verdict.heldout;
    assert!(h.rms_final < 0.3 * h.rms_nominal, "{h:?}");
}
