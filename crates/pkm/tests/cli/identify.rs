//! `pkm identify`: its files, its words, its exit status, what it refuses.

use std::fs;

use serde_json::Value;

use crate::fixture::{RIG_TOML, names, pkm, prints, refused, rig, rig_with_recordings};

const ARGUMENTS: [&str; 6] = ["identify", "rig.toml", "--recording", "A.csv", "--holdout", "B.mcap"];
const OUTPUTS: [&str; 6] = ["--out", "rig.identified.toml", "--json", "out.json", "--html", "out.html"];

#[test]
fn an_identification_writes_a_robot_that_runs() {
    let folder = rig_with_recordings();
    let before = names(folder.path());
    let said = prints(folder.path(), &[&ARGUMENTS[..], &OUTPUTS].concat());
    for part in ["base parameters", "Held-out error", "95 % interval", "j1.coulomb", "rig.identified.toml"] {
        assert!(said.contains(part), "{part} in {said}");
    }
    let mut all = [before, ["rig.identified.toml", "rig.identified.urdf", "out.json", "out.html"].map(str::to_string).to_vec()].concat();
    all.sort_unstable();
    assert_eq!(names(folder.path()), all);
    let json: Value = serde_json::from_str(&fs::read_to_string(folder.path().join("out.json")).unwrap()).unwrap();
    assert_eq!((&json["schema"], &json["method"]), (&"pkm.identification/1".into(), &"sdp".into()));
    let mut numbers = json.clone();
    // Without a simulated loop there are no instruments to tell of.
    assert!(numbers.as_object_mut().unwrap().remove("instruments").is_some_and(|i| i.is_null()));
    assert!(!numbers.to_string().contains("null"), "every number is finite: {numbers}");
    assert!(json["heldout"]["rms_identified"].as_f64().unwrap() < 0.5 * json["heldout"]["rms_nominal"].as_f64().unwrap(), "{json}");
    let page = fs::read_to_string(folder.path().join("out.html")).unwrap();
    assert!(page.contains("j1.coulomb") && !page.contains("http://") && !page.contains("https://"));
    // The robot reads, and there is nothing left to identify in it.
    assert!(!prints(folder.path(), &["check", "rig.identified.toml"]).contains("Warnings"));
    let again = ["identify", "rig.identified.toml", "--recording", "A.csv", "--holdout", "B.mcap", "--json", "again.json"];
    prints(folder.path(), &again);
    let again: Value = serde_json::from_str(&fs::read_to_string(folder.path().join("again.json")).unwrap()).unwrap();
    let (first, second) = (&json["heldout"]["rms_identified"], &again["heldout"]["rms_nominal"]);
    assert!((first.as_f64().unwrap() - second.as_f64().unwrap()).abs() < 1e-6, "{first} {second}");
}

#[test]
fn quiet_is_quiet_and_terms_can_be_held() {
    let folder = rig_with_recordings();
    let held = ["--hold", "offset", "--hold", "rotor", "--method", "relevant", "--quiet", "--json", "out.json"];
    let output = pkm(folder.path(), &[&ARGUMENTS[..], &held].concat());
    assert_eq!((output.status.code(), output.stdout.len(), output.stderr.len()), (Some(0), 0, 0));
    let json: Value = serde_json::from_str(&fs::read_to_string(folder.path().join("out.json")).unwrap()).unwrap();
    let parameters = json["parameters"].as_array().unwrap();
    let value = |name: &str| parameters.iter().find(|p| p["name"] == name).unwrap()["value"].as_f64().unwrap();
    assert!((value("j1.rotor_inertia") - 0.05).abs() < 1e-12 && value("j2.offset").abs() < 1e-12);
    assert!(!json["reduction"].as_array().unwrap().is_empty());
}

#[test]
fn a_robot_that_stood_still_is_told_by_the_exit_status_and_not_written() {
    let folder = rig();
    let mut csv = "t,q.j1,tau.j1,q.j2,tau.j2\n".to_string();
    (0..1000).for_each(|i| csv += &format!("{},0.1,-3.0,0.2,-0.5\n", f64::from(i) * 0.01));
    fs::write(folder.path().join("still.csv"), csv).unwrap();
    let arguments = ["identify", "rig.toml", "--recording", "still.csv", "--out", "new.toml", "--json", "out.json"];
    let output = pkm(folder.path(), &arguments);
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(said.contains("not identified") && said.contains("no drive moves"), "{said}");
    assert_eq!(names(folder.path()), ["out.json", "rig.toml", "rig.urdf", "still.csv"]);
}

#[test]
fn preprocessing_and_instruments_are_told_in_words_json_and_page() {
    let folder = rig_with_recordings();
    let steps = ["--outliers", "12", "--rate", "100", "--find-late", "0.02", "--derivative", "spline", "--method", "iv"];
    let said = prints(folder.path(), &[&ARGUMENTS[..], &steps, &["--json", "out.json", "--html", "out.html"]].concat());
    for part in ["method iv", "Durbin-Wu-Hausman", "Preprocessing", "decimation", "late_s", "spline"] {
        assert!(said.contains(part), "{part} in {said}");
    }
    let text = fs::read_to_string(folder.path().join("out.json")).unwrap();
    let json: Value = serde_json::from_str(&text).unwrap();
    let steps: Vec<&str> = json["preprocessing"].as_array().unwrap().iter().filter_map(|d| d["step"].as_str()).collect();
    assert!(["outliers", "decimation", "clock of the efforts", "spline"].iter().all(|s| steps.contains(s)), "{steps:?}");
    assert!(json["instruments"]["relevance"].as_f64().unwrap() > 0.5, "{}", json["instruments"]);
    let page = fs::read_to_string(folder.path().join("out.html")).unwrap();
    assert!(page.contains("Durbin-Wu-Hausman") && page.contains("clock of the efforts"));
    let help = prints(folder.path(), &["identify", "--help"]);
    for part in ["--period", "--shapes", "instruments from the simulated loop", "Preprocessing"] {
        assert!(help.contains(part), "{part} in {help}");
    }
}

#[test]
fn bad_usage_is_one_line() {
    let folder = rig_with_recordings();
    let with = |more: &[&'static str]| [&ARGUMENTS[..], more].concat();
    refused(folder.path(), &with(&["--method", "best"]), &["--method", "best"]);
    refused(folder.path(), &with(&["--period", "500"]), &["A.csv", "period = 500 s", "fit at least twice"]);
    refused(folder.path(), &with(&["--derivative", "best"]), &["--derivative", "best"]);
    refused(folder.path(), &with(&["--hold", "mass"]), &["--hold", "mass"]);
    refused(folder.path(), &with(&["--band", "1e6"]), &["--band", "1000000 Hz", "0.4 of the sampling rate"]);
    refused(folder.path(), &with(&["--out", "robot.yaml"]), &["robot.yaml", ".toml"]);
    refused(folder.path(), &with(&["--out", "rig.toml"]), &["rig.toml", "would overwrite the input"]);
    refused(folder.path(), &["identify", "rig.toml", "--recording", "A.csv", "--holdout", "A.csv"], &["A.csv", "given twice"]);
    let without_drive = RIG_TOML.replace("joint = \"j2\"", "joint = \"j1\"");
    fs::write(folder.path().join("bad.toml"), without_drive).unwrap();
    refused(folder.path(), &["identify", "bad.toml", "--recording", "A.csv"], &["bad.toml", "j1"]);
}
