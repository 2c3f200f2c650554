//! `pkm plan`: its answers as files and exit codes, from a motion that `pkm excite` wrote and from a recording, and what it refuses.

use std::fs;

use serde_json::Value;

use crate::fixture::{names, pkm, prints, refused, rig};

const MOTION: [&str; 15] = [
    "excite",
    "rig.toml",
    "--out",
    "motion.csv",
    "--period",
    "4",
    "--restarts",
    "1",
    "--draws",
    "4",
    "--iterations",
    "5",
    "--harmonics",
    "4",
    "--quiet",
];

#[test]
fn a_motion_of_excite_is_planned_with_and_without_demands() {
    let folder = rig();
    prints(folder.path(), &MOTION);
    let plan = ["plan", "rig.toml", "--reference", "motion.csv", "--noise", "0.02", "--noise", "j2=0.01"];
    let told = prints(folder.path(), &[&plan[..], &["--json", "plan.json", "--html", "plan.html"]].concat());
    assert!(told.contains("Smallest visible"), "{told}");
    let json: Value = serde_json::from_str(&fs::read_to_string(folder.path().join("plan.json")).unwrap()).unwrap();
    assert_eq!((&json["schema"], &json["noise"]["j1"], &json["noise"]["j2"]), (&"pkm.plan/1".into(), &0.02.into(), &0.01.into()));
    let effects = json["isolability"]["effects"].as_array().unwrap();
    let cosines = json["isolability"]["cosines"].as_array().unwrap();
    assert!(effects.len() > 10 && cosines.len() == effects.len());
    for (i, row) in cosines.iter().enumerate() {
        assert_eq!(row[i], 1.0);
        assert!(row.as_array().unwrap().iter().enumerate().all(|(j, c)| *c == cosines[j][i] && (0.0..=1.0).contains(&c.as_f64().unwrap())));
    }
    let page = fs::read_to_string(folder.path().join("plan.html")).unwrap();
    assert!(page.contains("Angles between effects") && !page.contains("http") && !page.contains("NaN"));
    // A rotor moves with its joint, dry friction with its direction; a torque scale of a drive is a share of everything it does.
    let ok = pkm(folder.path(), &[&plan[..], &["--require", "rotor_inertia@j2,friction_coulomb@j2", "--prior", "anchored"]].concat());
    assert_eq!(ok.status.code(), Some(0), "{}", String::from_utf8_lossy(&ok.stdout));
    let missed = pkm(folder.path(), &[&plan[..], &["--require", "time_delay@j1,actuator_lag@j1", "--json", "no.json"]].concat());
    assert_eq!(missed.status.code(), Some(1), "{}", String::from_utf8_lossy(&missed.stdout));
    let json: Value = serde_json::from_str(&fs::read_to_string(folder.path().join("no.json")).unwrap()).unwrap();
    assert!(json["ok"] == false && json["required"][0]["ok"] == false, "{}", json["required"]);
}

#[test]
fn what_makes_no_plan_is_refused_in_one_line() {
    let folder = rig();
    prints(folder.path(), &MOTION);
    let with = |more: &[&'static str]| [&["plan", "rig.toml", "--reference", "motion.csv"][..], more].concat();
    for (arguments, parts) in [
        (with(&[]), &["--noise"][..]),
        (with(&["--noise", "0"]), &["--noise 0", "> 0"]),
        (with(&["--noise", "j9=1"]), &["--noise j9=1", "\"j9\"", "j1, j2"]),
        (with(&["--noise", "j1=1"]), &["none stated for joint j2"]),
        (with(&["--noise", "1", "--require", "spring"]), &["--require \"spring\"", "two different effects"]),
        (with(&["--noise", "1", "--require", "spring,ghost", "--json", "o.json"]), &["--require spring,ghost", "no effect \"ghost\""]),
        (with(&["--noise", "1", "--require", "spring@j9,payload"]), &["no spring at \"j9\"", "j1, j2"]),
        (with(&["--noise", "1", "--band", "0.01"]), &["motion.csv", "leaves 0 rows"]),
        (with(&["--noise-from", "motion.csv"]), &["motion.csv", "tau.j1"]),
    ] {
        let before = names(folder.path());
        refused(folder.path(), &arguments, parts);
        assert_eq!(names(folder.path()), before, "nothing is written: {arguments:?}");
    }
}
