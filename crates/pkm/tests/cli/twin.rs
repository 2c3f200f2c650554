//! `pkm twin`: a recording comes back, a concealed mass shows and is explained, what cannot be replayed is refused.

use std::fs;

use serde_json::Value;

use crate::fixture::{prints, refused, rig};

const MASS: &str = "payload@hand:mass=1.5,x=0.1";

fn largest_share(told: &str) -> f64 {
    let told: Value = serde_json::from_str(told).unwrap();
    assert_eq!((&told["schema"], &told["robot"]), (&"pkm.twin/1".into(), &"rig".into()));
    let joints = told["joints"].as_array().unwrap();
    assert_eq!(joints.len(), 2);
    let share = |j: &Value| j["effort"]["rms"].as_f64().unwrap() / j["effort"]["measured_rms"].as_f64().unwrap();
    joints.iter().map(share).fold(0.0, f64::max)
}

#[test]
fn a_simulated_recording_comes_back_and_a_concealed_mass_shows_until_it_is_stated() {
    let folder = rig();
    let simulate = ["simulate", "rig.toml", "--duration", "2", "--noise", "none", "--out"];
    prints(folder.path(), &[&simulate[..], &["well.csv"]].concat());
    prints(folder.path(), &[&simulate[..], &["sick.csv", "--hide", MASS]].concat());
    let twin = |arguments: &[&str]| prints(folder.path(), &[&["twin", "rig.toml", "--json", "--recording"], arguments].concat());
    assert!(largest_share(&twin(&["well.csv"])) < 1e-6);
    assert!(largest_share(&twin(&["sick.csv"])) > 0.05);
    assert!(largest_share(&twin(&["sick.csv", "--with", MASS])) < 1e-6);
    let told = prints(folder.path(), &["twin", "rig.toml", "--recording", "sick.csv", "--html", "twin.html"]);
    assert!(told.starts_with("sick.csv: 2.000 s replayed") && told.contains("j2"), "{told}");
    let page = fs::read_to_string(folder.path().join("twin.html")).unwrap();
    assert!(page.contains("<svg") && page.contains("measured") && page.contains("simulated"));
}

#[test]
fn what_cannot_be_replayed_is_refused() {
    let folder = rig();
    fs::write(folder.path().join("bare.csv"), "t,q.j1,q.j2,tau.j1,tau.j2\n0,0,0,0,0\n0.001,0,0,0,0\n0.002,0,0,0,0\n").unwrap();
    refused(folder.path(), &["twin", "rig.toml", "--recording", "bare.csv"], &["bare.csv", "q_ref.j1"]);
    refused(folder.path(), &["twin", "rig.toml", "--recording", "none.csv"], &["none.csv"]);
    refused(folder.path(), &["twin", "rig.toml", "--recording", "bare.csv", "--with", "payload"], &["--with", "payload"]);
    // In millimetres and in degrees a simulation would run along, far from any pose of the robot.
    let moved = |t: f64, at: f64| [t, at, at + 5.0 * t].map(|x| x.to_string()).join(",");
    let rows = |from: f64| (0..4).map(|i| moved(0.01 * f64::from(i), from + 9.0 * f64::from(i))).collect::<Vec<_>>().join("\n");
    let degrees = format!("t,q.shoulder_left,q.shoulder_right\n{}\n", rows(-12.0));
    fs::write(folder.path().join("degrees.csv"), degrees).unwrap();
    refused(folder.path(), &["twin", "five_bar", "--recording", "degrees.csv", "--follow", "measured"], &["degrees.csv", "degrees"]);
    let third = rows(140.0).lines().map(|l| format!("{l},{}", l.rsplit(',').next().unwrap())).collect::<Vec<_>>().join("\n");
    fs::write(folder.path().join("mm.csv"), format!("t,q.q1,q.q6,q.q8\n{third}\n")).unwrap();
    refused(folder.path(), &["twin", "prs3", "--recording", "mm.csv", "--follow", "measured"], &["mm.csv", "millimetres"]);
}

/// Simulates two motions of the heavier rig under a controller, diagnoses them, and returns what the verdict says of each drive's replay.
fn replayed(controller: &[&str]) -> Vec<Value> {
    let folder = rig();
    fs::write(folder.path().join("pd.toml"), "law = \"pd_gravity\"\nrate_hz = 1000.0\nkp = [300.0, 100.0]\nkd = [20.0, 6.0]\n").unwrap();
    for (file, seed) in [("a.csv", "1"), ("b.csv", "2")] {
        let made = ["simulate", "rig.toml", "--duration", "8", "--seed", seed, "--hide", MASS, "--controller", "pd.toml", "--out", file];
        prints(folder.path(), &made);
    }
    let diagnose = ["diagnose", "rig.toml", "--recording", "a.csv", "--holdout", "b.csv", "--null-runs", "39", "--json", "v.json", "-q"];
    prints(folder.path(), &[&diagnose[..], controller].concat());
    let told: Value = serde_json::from_str(&fs::read_to_string(folder.path().join("v.json")).unwrap()).unwrap();
    let replay = told["replay"].as_array().unwrap().clone();
    assert_eq!(replay.len(), 2, "two drives of the one recording that is judged");
    assert!(replay.iter().all(|r| r["recording"] == "b.csv"));
    replay
}

#[test]
fn the_refined_robot_moves_as_the_recorded_one_did() {
    let number = |r: &Value, key: &str| r[key].as_f64().unwrap();
    // Held to the measured motion, efforts are what tells the robots apart.
    let free = replayed(&[]);
    assert!(free[0]["how"].as_str().unwrap().contains("measured motion"));
    // Along the recorded reference under the same controller, positions are as well.
    let same = replayed(&["--controller", "pd.toml"]);
    assert!(same[0]["how"].as_str().unwrap().contains("pd.toml"));
    for r in free.iter().chain(&same) {
        assert!(number(r, "effort_after") < 0.2 * number(r, "effort_before"), "{r}");
        let [measured, after] = ["work_measured", "work_after"].map(|key| number(r, key));
        assert!((measured - after).abs() < 0.05 * measured.abs().max(1.0), "{r}");
    }
    for r in &same {
        assert!(number(r, "position_after") < 0.3 * number(r, "position_before"), "{r}");
    }
}
