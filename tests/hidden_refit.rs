//! Physics that a refit conceals: the nominal robot was identified on the very recordings that have the effect in them, so that inertias,
//! frictions and offsets hold most of it before a diagnosis begins.

use pkm_diagnose::{Diagnosis, Settings, diagnose};
use pkm_dyn::effects::{Applied, Robot};
use pkm_dyn::urdf::{Description, parse};
use pkm_ident::refine::identified;
use pkm_ident::{Recording, identify};
use pkm_sim::Scenario;

fn shipped(name: &str) -> Description {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("a shipped robot reads")
}

/// Three motions of the truth: two to fit and to search on, one to judge on.
fn recordings(true_to: &Description, (name, place, numbers): (&str, &str, &[(&str, f64)])) -> Vec<Recording> {
    let stated: Vec<(String, f64)> = numbers.iter().map(|(n, v)| ((*n).to_string(), *v)).collect();
    let hidden = Applied::try_new(&true_to.bare, name, place, &stated).expect("a valid effect");
    let truth = Robot::new(true_to.bare.clone(), [true_to.robot.effects.clone(), vec![hidden]].concat());
    let record = |seed: u64| {
        let scenario = Scenario { seed, ..Scenario::default() };
        let mut r = pkm_sim::run(&truth, &true_to.robot, &scenario, &mut |_| {}).expect("the closed loop runs");
        r.name = format!("motion{seed}");
        r
    };
    [71, 72, 73].map(record).to_vec()
}

/// The robot as an identification on these recordings has it.
fn refitted(description: &Description, fitted: &[Recording]) -> Description {
    let answer = identify(&description.robot, fitted, &[], &pkm_ident::Settings::default(), &mut |_| {}).expect("it can be identified");
    let [toml, urdf] = identified(description, &answer).texts(description, "refitted.urdf").expect("it can be written");
    parse(&toml, &urdf, ["refitted.toml", "refitted.urdf"]).expect("what was written reads")
}

/// Diagnoses with the refitted robot.
fn concealed(robot: &str, hidden: (&str, &str, &[(&str, f64)])) -> Diagnosis {
    let given = shipped(robot);
    let r = recordings(&given, hidden);
    let nominal = refitted(&given, &r[..2]);
    diagnose(&nominal, &r[..2], &r[2..], &Settings::default(), &mut |_| {}).expect("the recordings are usable")
}

/// Whether a finding at the place has one of the names.
fn is_named(d: &Diagnosis, names: &[&str], place: &str) -> bool {
    d.verdict.findings.iter().any(|f| names.contains(&f.effect.as_str()) && f.place.iter().any(|p| p == place))
}

#[test]
fn friction_that_grows_with_load_is_named_though_inertias_were_fitted_to_it() {
    let d = concealed("prs3", ("friction_load", "q8", &[("mu", 0.2)]));
    // Losses of a gear that are alike in both directions are the same law.
    assert!(is_named(&d, &["friction_load", "directional_efficiency"], "q8"), "{}", d.verdict.says);
    assert!(d.verdict.notes.iter().any(|n| n.contains("fitted along")), "{:?}", d.verdict.notes);
    // Beside what was fitted along nothing else will do; beside the robot's files as they are, friction along the stroke would.
    let same = d.verdict.findings.iter().flat_map(|f| &f.cannot_tell_from);
    let other: Vec<&str> = same.map(|a| a.effect.as_str()).filter(|e| !["friction_load", "directional_efficiency"].contains(e)).collect();
    assert!(other.is_empty(), "{other:?}");
    let h = &d.verdict.heldout;
    assert!(h.rms_final < h.rms_nominal, "{} -> {}", h.rms_nominal, h.rms_final);
}

#[test]
fn a_late_effort_is_named_though_frictions_were_fitted_to_it() {
    let d = concealed("serial_arm", ("time_delay", "j2", &[("delay", 0.008)]));
    assert!(is_named(&d, &["time_delay", "actuator_lag"], "j2"), "{}", d.verdict.says);
    let late = d.verdict.findings.iter().find(|f| f.effect == "time_delay").and_then(|f| f.parameters.get("delay"));
    let delay = late.map_or(0.0, |e| e.value);
    assert!((delay - 0.008).abs() < 0.0016, "{delay} s instead of 0.008: {}", d.verdict.says);
    let late = d.verdict.findings.iter().find(|f| f.effect == "time_delay");
    let same: Vec<&str> = late.iter().flat_map(|f| &f.cannot_tell_from).map(|a| a.effect.as_str()).collect();
    assert_eq!(same, ["actuator_lag"], "to first order a lag is the same, and nothing else is");
}
