//! `pkm identify`: its files, its words, its exit status, what it refuses.

extern crate alloc;

use alloc::collections::BTreeMap;
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
fn gains_and_a_payload_are_told_in_words_json_and_page() {
    let folder = rig();
    let simulate = |out: &str, seed: &str, more: &[&str]| {
        prints(
            folder.path(),
            &[&["simulate", "rig.toml", "--out", out, "--seed", seed, "--duration", "12", "--rate", "500"], more].concat(),
        );
    };
    simulate("free.csv", "1", &[]);
    simulate("heavy.csv", "2", &["--hide", "payload@hand:mass=1"]);
    let heavy = fs::read_to_string(folder.path().join("heavy.csv")).unwrap();
    fs::write(folder.path().join("weighed.csv"), format!("# load = {{link = \"hand\", mass = 1.0, xyz = [0, 0, 0]}}\n{heavy}")).unwrap();
    let json = || -> Value { serde_json::from_str(&fs::read_to_string(folder.path().join("out.json")).unwrap()).unwrap() };
    let page = || fs::read_to_string(folder.path().join("out.html")).unwrap();
    let outputs = ["--json", "out.json", "--html", "out.html"];
    let weighed = ["identify", "rig.toml", "--recording", "free.csv", "--recording", "weighed.csv", "--gains"];
    let said = prints(folder.path(), &[&weighed[..], &outputs].concat());
    assert!(said.contains("Gains of the drives") && page().contains("acting over recorded effort"), "{said}");
    for drive in json()["gains"]["drives"].as_array().unwrap() {
        assert!((drive["gain"].as_f64().unwrap() - 1.0).abs() < 0.1, "{drive}");
    }
    let held = ["identify", "rig.toml", "--recording", "heavy.csv", "--payload", "hand", "--gains"];
    let said = prints(folder.path(), &[&held[..], &outputs].concat());
    assert!(said.contains("Payload on hand") && said.contains("none of 1 recordings states a load"), "{said}");
    assert!(page().contains("On hand:") && json()["gains"]["status"] == "not_identified");
    let mass = json()["payload"]["body"]["mass"].as_f64().unwrap();
    assert!((mass - 1.0).abs() < 0.15, "{mass} kg");
    let nowhere = ["identify", "rig.toml", "--recording", "heavy.csv", "--payload", "tail"];
    refused(folder.path(), &nowhere, &["payload: no link \"tail\"", "arm, hand"]);
}

/// Values of a row by column.
type Row = BTreeMap<String, f64>;

/// A recording with `change` made to every row: its number, how many there are, and its values by column.
fn altered(text: &str, change: &dyn Fn(usize, usize, &mut Row)) -> String {
    let all: Vec<&str> = text.lines().collect();
    let head = all.iter().position(|l| l.starts_with("t,")).unwrap();
    let names: Vec<&str> = all[head].split(',').collect();
    let mut out = all[..=head].join("\n") + "\n";
    for (i, line) in all[head + 1..].iter().enumerate() {
        let mut row = names.iter().zip(line.split(',')).map(|(name, x)| (name.to_string(), x.parse().unwrap())).collect();
        change(i, all.len() - head - 1, &mut row);
        out += &(names.iter().map(|name| row[*name].to_string()).collect::<Vec<_>>().join(",") + "\n");
    }
    out
}

/// A name, the status, what the note says, and what happens to each row.
type Poor<'p> = (&'p str, &'p str, &'p [&'p str], &'p dyn Fn(usize, usize, &mut Row));

#[test]
fn poor_recordings_are_told_with_numbers() {
    let folder = rig();
    prints(folder.path(), &["simulate", "rig.toml", "--out", "good.csv", "--duration", "12", "--rate", "500"]);
    let good = fs::read_to_string(folder.path().join("good.csv")).unwrap();
    let add = |row: &mut BTreeMap<String, f64>, name: &str, x: f64| *row.get_mut(name).unwrap() += x;
    let contact = |i: usize, n: usize, row: &mut BTreeMap<String, f64>| add(row, "tau.j1", if 20 * i / n % 10 == 3 { 25.0 } else { 0.0 });
    let spikes = |i: usize, _: usize, row: &mut BTreeMap<String, f64>| add(row, "tau.j1", if i.is_multiple_of(10) { 60.0 } else { 0.0 });
    let cases: [Poor<'_>; 5] = [
        ("stands", "with doubts", &["j2 stands still: it travels 0", "(limit 8.400e-3)"], &|_, _, row| {
            row.insert("q.j2".to_string(), 0.2);
        }),
        // The hand keeps its direction: its inertia never acts.
        ("mirror", "with doubts", &["the motion shows 12 of 13 base parameters"], &|_, _, row| {
            row.insert("q.j2".to_string(), -row["q.j1"]);
        }),
        // Efforts of negative masses; those of a turned sign would be told as such.
        ("negative", "with doubts", &["no physical robot has what the recordings ask for", "(limit 1.5 times)"], &|_, _, row| {
            ["tau.j1", "tau.j2"].iter().for_each(|tau| *row.get_mut(*tau).unwrap() *= -0.3);
        }),
        ("contact", "with doubts", &["% of the rows are further than 4 standard deviations off (limit 2.0 %)"], &contact),
        ("spikes", "with doubts", &["j1: 10.0 % of its effort samples stood out", "(limit 0.5 %)"], &spikes),
    ];
    for (name, status, parts, change) in cases {
        let file = format!("{name}.csv");
        fs::write(folder.path().join(&file), altered(&good, change)).unwrap();
        let said = prints(folder.path(), &["identify", "rig.toml", "--recording", &file]);
        for part in [&[status][..], parts].concat() {
            assert!(said.contains(part), "{name}: {part} in {said}");
        }
    }
    let short: Vec<&str> = good.lines().take(604).collect();
    fs::write(folder.path().join("short.csv"), short.join("\n") + "\n").unwrap();
    let output = pkm(folder.path(), &["identify", "rig.toml", "--recording", "short.csv", "--band", "4"]);
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.code() == Some(1) && said.contains("6 independent rows for 6 parameters (at least 30 are needed)"), "{said}");
}

#[test]
fn efforts_in_another_unit_identify_nothing() {
    let folder = rig();
    for (name, seed) in [("A.csv", "1"), ("B.csv", "2")] {
        prints(folder.path(), &["simulate", "rig.toml", "--out", name, "--duration", "12", "--rate", "500", "--seed", seed]);
    }
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    let scaled = |from: &str, factor: f64, to: &str| {
        let change = |_: usize, _: usize, row: &mut Row| ["tau.j1", "tau.j2"].iter().for_each(|tau| *row.get_mut(*tau).unwrap() *= factor);
        fs::write(folder.path().join(to), altered(&read(from), &change)).unwrap();
    };
    scaled("A.csv", 1e-3, "kilo.csv");
    scaled("A.csv", 1e3, "milli.csv");
    scaled("B.csv", 1e-3, "judged.csv");
    let cases = [
        (vec!["--recording", "kilo.csv"], "kilo.csv: tau.j1 and tau.j2 follow", "multiplied by about 1000 ", "recorded in kN·m?"),
        (vec!["--recording", "milli.csv"], "milli.csv: tau.j1 and tau.j2 follow", "multiplied by about 0.001 ", "recorded in mN·m?"),
        (vec!["--recording", "A.csv", "--holdout", "judged.csv"], "judged.csv: tau.j1 and tau.j2", "multiplied by about 1000 ", "kN·m?"),
    ];
    let before = names(folder.path());
    for (recordings, which, factor, unit) in cases {
        let output = pkm(folder.path(), &[&["identify", "rig.toml", "--out", "new.toml"], &recordings[..]].concat());
        let said = String::from_utf8(output.stdout).unwrap();
        assert_eq!(output.status.code(), Some(1), "{said}");
        for part in ["not identified", which, factor, unit, "masses of the robot are in kg"] {
            assert!(said.contains(part), "{part} in {said}");
        }
        // The reason is the second line; there are no columns of a robot that there is not.
        assert!(
            said.lines().nth(1).unwrap().contains(which) && !said.contains("base parameters") && !said.contains("fitted rows"),
            "{said}"
        );
        assert_eq!(names(folder.path()), before);
    }
    let json = pkm(folder.path(), &["identify", "rig.toml", "--recording", "kilo.csv", "--json", "-"]);
    let json: Value = serde_json::from_slice(&json.stdout).unwrap();
    let numbers = &json["notes"][0]["numbers"];
    assert_eq!((&json["status"], &numbers["note"], &numbers["factor"]), (&"not_identified".into(), &"other_units".into(), &1000.0.into()));
    assert_eq!((&numbers["joints"], &numbers["recorded_in"]), (&serde_json::json!(["j1", "j2"]), &serde_json::json!(["kN·m"])));
    // Positions in degrees are told by the joint's limits, which they pass by far.
    let degrees = |_: usize, _: usize, row: &mut Row| ["q.j1", "q.j2"].iter().for_each(|q| *row.get_mut(*q).unwrap() *= 57.295_779_513);
    fs::write(folder.path().join("degrees.csv"), altered(&read("A.csv"), &degrees)).unwrap();
    let output = pkm(folder.path(), &["identify", "rig.toml", "--recording", "degrees.csv"]);
    let said = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    for part in ["not identified", "degrees.csv: q.j1 goes from -", "limits are -1.200 to 1.200 rad: is it in degrees?", "q.j2 goes from"] {
        assert!(said.contains(part), "{part} in {said}");
    }
    // As recorded, and with half of the effort, it is identified.
    scaled("A.csv", 0.5, "half.csv");
    for name in ["A.csv", "half.csv"] {
        assert!(!prints(folder.path(), &["identify", "rig.toml", "--recording", name]).contains("recorded in"), "{name}");
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
