//! `pkm prove`: a small run with a fixed seed. It holds the machinery to account, not the diagnosis: seals, scores, going on, refusals.

use std::fs;
use std::path::Path;

use serde_json::Value;
use tempfile::TempDir;

use crate::fixture::{pkm, prints, refused};

fn json(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn a_small_run_is_sealed_diagnosed_scored_and_cannot_be_changed_afterwards() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    let make = [
        "prove", "--cases", "6", "--seed", "11", "--out", "run", "--level", "L1", "--level", "L6", "--robot", "prs3", "--robot", "five_bar",
    ];
    let sealed = prints(at, &[&make[..], &["--size", "4", "--seal-only"]].concat());
    assert_eq!(sealed.lines().filter(|l| l.ends_with(".json")).count(), 6, "{sealed}");
    assert!(
        !at.join("run/results.json").exists() && fs::read_dir(at.join("run/runs")).unwrap().count() == 0,
        "sealed before anything runs"
    );
    let kept = fs::read_to_string(at.join("run/seals.txt")).unwrap();
    refused(at, &make, &["run", "--resume"]);

    let told = prints(at, &["prove", "--out", "run", "--jobs", "2"]);
    assert!(told.contains("false alarms") && at.join("run/results.html").exists() && at.join("run/results.md").exists());
    let results = json(&at.join("run/results.json"));
    let cases = results["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 6);
    for case in cases {
        assert_eq!(case["ran"], true, "{case}");
        assert!(case["level"] != "L6" || case["is_alarm"] == false, "a healthy robot was accused: {case}");
    }
    assert!(cases.iter().any(|c| c["level"] == "L6") && cases.iter().any(|c| c["level"] == "L1"));
    let printed = prints(at, &["prove", "--out", "run", "--score-only", "--json"]);
    assert_eq!(printed, fs::read_to_string(at.join("run/results.json")).unwrap());

    // Going on makes nothing anew.
    let before = fs::metadata(at.join("run/runs/0001.json")).unwrap().modified().unwrap();
    prints(at, &[&make[..], &["--size", "4", "--resume", "--quiet"]].concat());
    assert_eq!(fs::metadata(at.join("run/runs/0001.json")).unwrap().modified().unwrap(), before);
    assert_eq!(fs::read_to_string(at.join("run/seals.txt")).unwrap(), kept);

    // An answer that is changed afterwards is noticed.
    let answer = at.join("run/answers/0002.json");
    let text = fs::read_to_string(&answer).unwrap();
    fs::write(&answer, text.replacen("L", "M", 1)).unwrap();
    let output = pkm(at, &["prove", "--out", "run", "--score-only"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("0002"));
}

#[test]
fn bad_runs_are_refused() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    refused(at, &["prove", "--out", "run", "--cases", "1", "--level", "L9"], &["L0"]);
    refused(at, &["prove", "--out", "run", "--cases", "1", "--effect", "gremlins"], &["gremlins", "must be one of", "backlash"]);
    // What no drive of the robot can have.
    let coupled = ["--cases", "1", "--effect", "transmission_coupling", "--robot", "prs3", "--level", "L1"];
    refused(at, &[&["prove", "--out", "coupled"], &coupled[..]].concat(), &["case 1", "transmission_coupling cannot be concealed in prs3"]);
    refused(at, &["prove", "--out", "run", "--cases", "0"], &["--cases"]);
    refused(at, &["prove", "--out", "run", "--cases", "1", "--robot", "nobody"], &["prs3"]);
    refused(at, &["prove", "--out", "nowhere"], &["nowhere"]);
    refused(at, &["prove", "--out", "nowhere", "--score-only"], &["nowhere", "seals.txt"]);
}

#[test]
fn cases_of_strangers_are_scored_like_ours() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    prints(
        at,
        &["prove", "--cases", "1", "--seed", "2", "--out", "run", "--level", "L6", "--robot", "motobotte", "--seal-only", "--quiet"],
    );
    // Another name, an answer with the least that docs/PROOF.md asks for, a seal made with any other program.
    fs::rename(at.join("run/cases/0001"), at.join("run/cases/theirs")).unwrap();
    fs::remove_file(at.join("run/answers/0001.json")).unwrap();
    let answer = r#"{"schema": "pkm.trial/1", "salt": "any", "level": "L1", "robot": "motobotte", "concealed": [{"effect": "spring", "where": ["d"]}]}"#;
    fs::write(at.join("run/answers/theirs.json"), answer).unwrap();
    let hash = "0".repeat(64);
    fs::write(at.join("run/seals.txt"), format!("{hash}  theirs.json\n")).unwrap();
    let output = pkm(at, &["prove", "--out", "run", "--quiet"]);
    assert_eq!(output.status.code(), Some(1), "a seal that does not fit");
    // SHA-256 of the answer above, as sha256sum prints it.
    fs::write(at.join("run/seals.txt"), format!("{SHA}  theirs.json\n")).unwrap();
    prints(at, &["prove", "--out", "run", "--quiet"]);
    let results = json(&at.join("run/results.json"));
    assert_eq!(results["cases"][0]["concealed"][0], "spring@d");
    assert_eq!(results["cases"][0]["is_first_right"], false, "nothing is there to be found");
}

const SHA: &str = "1884b222db9076660d7d1a386e3f760458e3415254abe790b9a363357a5a662d";
