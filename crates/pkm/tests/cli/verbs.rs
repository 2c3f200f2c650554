//! What every verb does when its input is good.

use std::fs;

use crate::fixture::{demo, names, pkm, prints, rig, rig_with_recordings};
use serde_json::Value;

#[test]
fn every_shipped_robot_can_be_diagnosed() {
    let folder = tempfile::tempdir().unwrap();
    // ups4 has a drive more than freedoms, and says so.
    let text = prints(folder.path(), &["check", "ups4"]);
    assert!(text.contains("mobility 3, drives 4") && text.contains("move nothing: [0.528"), "{text}");
    for robot in pkm_robots::ALL.iter().filter(|robot| robot.name != "ups4") {
        let text = prints(folder.path(), &["check", robot.name]);
        assert!(text.contains("equal to the number of drives") && !text.contains("Warnings"), "{text}");
        let json: Value = serde_json::from_str(&prints(folder.path(), &["check", robot.name, "--json"])).unwrap();
        assert_eq!(json["robot"], robot.name);
        assert!(json["parameters"]["base"].as_u64().unwrap() <= json["parameters"]["acting"].as_u64().unwrap());
        assert!(json["parameters"]["gap"].as_f64().unwrap() > 1e6, "{}", robot.name);
    }
}

#[test]
fn impossible_inertias_are_a_warning() {
    let folder = rig();
    fs::write(folder.path().join("rig.urdf"), crate::fixture::RIG_URDF.replacen("izz=\"0.02\"", "izz=\"0.2\"", 1)).unwrap();
    let text = prints(folder.path(), &["check", "rig.toml"]);
    assert!(text.contains("Warnings") && text.contains("\"arm\"") && text.contains("pseudo-inertia"), "{text}");
}

#[test]
fn csv_to_mcap_and_back_keeps_every_value() {
    let folder = rig_with_recordings();
    let said = prints(folder.path(), &["convert", "A.csv", "there.mcap", "--robot", "rig.toml"]);
    assert!(said.contains("there.mcap"), "{said}");
    prints(folder.path(), &["convert", "there.mcap", "back.csv"]);
    let read = |name: &str| pkm_record::read(&folder.path().join(name), &pkm_record::ReadOptions::default()).unwrap();
    let (there, back) = (read("A.csv"), read("back.csv"));
    assert_eq!((there.time, there.signals), (back.time, back.signals));
    let attached = pkm_record::read_attachments(&folder.path().join("there.mcap"), &pkm_record::ReadOptions::default()).unwrap();
    let mut files: Vec<(&str, &[u8])> = attached.files.iter().map(|f| (f.name.as_str(), f.bytes.as_slice())).collect();
    files.sort_unstable();
    assert_eq!(files, [("rig.urdf", crate::fixture::RIG_URDF.as_bytes()), ("robot.toml", crate::fixture::RIG_TOML.as_bytes())]);
    // Through another MCAP file the attachments stay.
    prints(folder.path(), &["convert", "there.mcap", "again.mcap"]);
    let again = pkm_record::read_attachments(&folder.path().join("again.mcap"), &pkm_record::ReadOptions::default()).unwrap();
    assert_eq!(again.files, attached.files);
}

#[test]
fn the_catalogue_is_listed() {
    let folder = tempfile::tempdir().unwrap();
    let (all, json) = (prints(folder.path(), &["effects"]), prints(folder.path(), &["effects", "--json"]));
    let json: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json.as_array().unwrap().len(), pkm_dyn::effects::CATALOGUE.len());
    for e in pkm_dyn::effects::CATALOGUE {
        assert!(all.contains(e.name) && all.contains(e.equation), "{}", e.name);
        let one = prints(folder.path(), &["effects", e.name]);
        assert!(e.look_alikes.iter().all(|l| one.contains(l.effect) && one.contains(l.experiment)), "{one}");
    }
}

/// Keys of formats section 3, and that nothing in the file is null: a null is a number that was not finite.
fn assert_complete(verdict: &Value) {
    let has = |value: &Value, keys: &[&str]| {
        for key in keys {
            assert!(value.get(key).is_some_and(|v| !v.is_null()), "{key} in {value}");
        }
    };
    has(
        verdict,
        &[
            "schema",
            "status",
            "robot",
            "recordings",
            "nothing_missing",
            "heldout",
            "findings",
            "unexplained",
            "minimum_detectable",
            "refined_model",
        ],
    );
    assert_eq!(verdict["schema"], "pkm.verdict/1");
    assert_eq!(verdict["heldout"]["unit"], "fraction of tau rms");
    has(&verdict["heldout"], &["rms_nominal", "rms_refit", "rms_final", "noise_floor", "band_hz", "unit"]);
    has(&verdict["unexplained"], &["present", "share_of_residual", "where", "depends_on"]);
    for recording in verdict["recordings"].as_array().unwrap() {
        has(recording, &["path", "samples", "duration_s", "used"]);
    }
    let findings = verdict["findings"].as_array().unwrap();
    for (i, finding) in findings.iter().enumerate() {
        has(finding, &["rank", "effect", "where", "regime", "when", "confidence", "p_value", "parameters"]);
        has(finding, &["heldout_rms_before", "heldout_rms_after", "says", "look_alikes", "cannot_tell_from"]);
        assert_eq!(finding["rank"], i + 1);
        for look_alike in finding["look_alikes"].as_array().unwrap() {
            has(look_alike, &["effect", "why_not", "separating_experiment"]);
        }
        for alias in finding["cannot_tell_from"].as_array().unwrap() {
            has(alias, &["effect", "where"]);
        }
        for (_, estimate) in finding["parameters"].as_object().unwrap() {
            has(estimate, &["value", "ci95", "unit"]);
        }
    }
    for detectable in verdict["minimum_detectable"].as_array().unwrap() {
        has(detectable, &["effect", "where", "parameter", "value", "unit"]);
    }
    let is_silent = findings.is_empty() && verdict["unexplained"]["present"] == false;
    assert_eq!(verdict["nothing_missing"].as_bool().unwrap(), is_silent);
    assert!(!holds_null(verdict), "{verdict}");
}

/// Whether a number that JSON has no word for became nothing somewhere.
fn holds_null(value: &Value) -> bool {
    match value {
        Value::Null => true,
        Value::Array(all) => all.iter().any(holds_null),
        Value::Object(all) => all.values().any(holds_null),
        _ => false,
    }
}

#[test]
fn the_demo_finds_dry_friction_and_its_refined_robot_runs() {
    let said = fs::read_to_string(demo().join("told.txt")).unwrap();
    assert!(said.contains("Concealed: friction_coulomb at ") && said.contains("The effect is named and its place is right."), "{said}");
    assert!(said.contains("The seal is unbroken.") && said.contains("refined.robot.toml, runs in the simulator"), "{said}");
    let folder = demo().join("demo");
    let files = ["motion1.mcap", "motion2.mcap", "refined.robot.toml", "refined.robot.urdf", "report.html", "sealed.json", "verdict.json"];
    assert_eq!(names(&folder), files);
    assert_complete(&serde_json::from_str(&fs::read_to_string(folder.join("verdict.json")).unwrap()).unwrap());
    let sealed: Value = serde_json::from_str(&fs::read_to_string(folder.join("sealed.json")).unwrap()).unwrap();
    assert_eq!(sealed["concealed"][0]["effect"], "friction_coulomb");
    assert!(prints(&folder, &["check", "refined.robot.toml"]).contains("rig"));
}

#[test]
fn the_same_demo_twice_writes_the_same_verdict() {
    let folder = rig();
    pkm(folder.path(), &["demo", "--robot", "rig.toml", "--effect", "friction_coulomb", "--duration", "10", "--out", "demo"]);
    for name in ["verdict.json", "refined.robot.toml", "refined.robot.urdf", "sealed.json", "report.html"] {
        let [first, second] = [demo(), folder.path()].map(|f| fs::read(f.join("demo").join(name)).unwrap());
        assert!(first == second, "{name}");
    }
}

#[test]
fn a_diagnosis_writes_all_its_files_and_tells_by_its_exit_status() {
    let folder = rig_with_recordings();
    let diagnose = ["diagnose", "rig.toml", "--recording", "A.csv", "--holdout", "B.mcap"];
    let outputs = ["--json", "out.json", "--html", "out.html", "--null-runs", "39", "--seed", "3"];
    let output = pkm(folder.path(), &[&diagnose[..], &outputs, &["--fail-on-mismatch"]].concat());
    assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stdout).contains("friction_coulomb"));
    assert!(output.stderr.is_empty());
    let before = ["A.csv", "A.mcap", "B.csv", "B.mcap", "rig.toml", "rig.urdf"];
    let mut all: Vec<&str> = [&before[..], &["out.html", "out.json", "out.robot.toml", "out.robot.urdf"]].concat();
    all.sort_unstable();
    assert_eq!(names(folder.path()), all);
    let verdict: Value = serde_json::from_str(&fs::read_to_string(folder.path().join("out.json")).unwrap()).unwrap();
    assert_complete(&verdict);
    assert_eq!(verdict["refined_model"], "out.robot.toml");
    assert_eq!((&verdict["recordings"][0]["path"], &verdict["recordings"][0]["used"]), (&"A.csv".into(), &"train".into()));
    assert_eq!((&verdict["recordings"][1]["path"], &verdict["recordings"][1]["used"]), (&"B.mcap".into(), &"holdout".into()));
    let page = fs::read_to_string(folder.path().join("out.html")).unwrap();
    assert!(page.contains("friction_coulomb") && !page.contains("http://") && !page.contains("https://"));
    assert!(prints(folder.path(), &["check", "out.robot.toml"]).contains("rig"));
    // Without the flag the same answer is a success, and quiet means quiet.
    let quiet = pkm(folder.path(), &[&diagnose[..], &["--null-runs", "39", "--quiet"]].concat());
    assert_eq!((quiet.status.code(), quiet.stdout.len(), quiet.stderr.len()), (Some(0), 0, 0));
    assert_eq!(names(folder.path()), all, "no JSON, no refined robot");
}

#[test]
fn a_check_that_could_not_be_made_has_not_passed() {
    let folder = rig_with_recordings();
    let text = fs::read_to_string(folder.path().join("A.csv")).unwrap();
    let (head, rows) = text.split_at(text.find("\nt,").unwrap() + 1);
    let mut rows = rows.lines();
    let names: Vec<&str> = rows.next().unwrap().split(',').collect();
    let degrees = |line: &str| {
        let field = |(name, x): (&&str, &str)| {
            if name.starts_with("q.") { (57.295_779_513 * x.parse::<f64>().unwrap()).to_string() } else { x.to_string() }
        };
        names.iter().zip(line.split(',')).map(field).collect::<Vec<_>>().join(",")
    };
    let all: Vec<String> = core::iter::once(names.join(",")).chain(rows.map(degrees)).collect();
    fs::write(folder.path().join("degrees.csv"), head.to_string() + &all.join("\n") + "\n").unwrap();
    let diagnose = ["diagnose", "rig.toml", "--recording", "degrees.csv", "--null-runs", "39", "--json", "-"];
    for (more, code) in [(&[][..], 0), (&["--fail-on-mismatch"][..], 1)] {
        let output = pkm(folder.path(), &[&diagnose[..], more].concat());
        let verdict: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!((verdict["status"].as_str(), output.status.code()), (Some("unusable"), Some(code)), "{verdict}");
    }
    // A robot that its recordings agree with passes.
    let refined = demo().join("demo").join("refined.robot.toml").display().to_string();
    let simulate = ["simulate", &refined, "--duration", "10", "--rate", "500", "--out"];
    prints(folder.path(), &[&simulate[..], &["fit.csv", "--seed", "5"]].concat());
    prints(folder.path(), &[&simulate[..], &["judged.csv", "--seed", "6"]].concat());
    let passes =
        ["diagnose", &refined, "--recording", "fit.csv", "--holdout", "judged.csv", "--no-replay", "--fail-on-mismatch", "--quiet"];
    assert_eq!(pkm(folder.path(), &passes).status.code(), Some(0));
}

#[test]
fn what_controller_is_left_out_is_told_as_each_verb_has_it() {
    let folder = tempfile::tempdir().unwrap();
    let told = |verb: &str| prints(folder.path(), &[verb, "--help"]).split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(told("diagnose").contains("[default: commands are not checked, and the replay is held to the measured motion]"));
    assert!(["simulate", "twin"].iter().all(|verb| told(verb).contains("[default: a PD per drive with the weight as feed-forward]")));
}

#[test]
fn what_is_left_out_is_no_finding_and_the_verdict_says_that_it_was_left_out() {
    let folder = rig_with_recordings();
    let arguments =
        ["diagnose", "rig.toml", "--recording", "A.csv", "--holdout", "B.csv", "--null-runs", "39", "--no-replay", "--json", "-"];
    let without = ["--without", "friction_coulomb,friction_presliding", "--without", "friction_quadratic"];
    let verdict: Value = serde_json::from_str(&prints(folder.path(), &[&arguments[..], &without].concat())).unwrap();
    let said = serde_json::to_string(&[&verdict["findings"], &verdict["minimum_detectable"], &verdict["isolability"]]).unwrap();
    assert!(
        !["friction_coulomb", "friction_presliding", "friction_quadratic"].iter().any(|n| said.contains(&format!("\"effect\":\"{n}\"")))
    );
    let note = verdict["notes"][0].as_str().unwrap();
    assert!(note.contains("left out on request") && note.ends_with("friction_coulomb, friction_presliding, friction_quadratic"), "{note}");
    assert_ne!(verdict["nothing_missing"], true, "the friction is still there");
}

#[test]
fn a_refined_robot_can_be_asked_for_without_json() {
    let folder = rig_with_recordings();
    let arguments = ["diagnose", "rig.toml", "--recording", "A.csv", "--refined", "better.toml", "--null-runs", "39"];
    assert!(prints(folder.path(), &arguments).contains("better.toml"));
    assert!(folder.path().join("better.toml").is_file() && folder.path().join("better.urdf").is_file());
    prints(folder.path(), &["check", "better.toml"]);
}

#[test]
fn runs_with_nothing_missing_are_tabulated() {
    let folder = rig_with_recordings();
    let refined = demo().join("demo").join("refined.robot.toml").display().to_string();
    let arguments = ["trial-null", &refined, "--recording", "A.csv", "--holdout", "B.csv", "--runs", "2", "--json", "null.json"];
    let said = prints(folder.path(), &[&arguments[..], &["--null-runs", "39"]].concat());
    assert!(said.contains("of 2 runs with nothing missing"), "{said}");
    let json: Value = serde_json::from_str(&fs::read_to_string(folder.path().join("null.json")).unwrap()).unwrap();
    assert_eq!((&json["schema"], json["runs"].as_array().unwrap().len()), (&"pkm.null/1".into(), 2));
    assert_eq!(json["runs"][1]["seed"], 2);
}

#[test]
fn a_workspace_is_scanned_drawn_and_told() {
    let folder = tempfile::tempdir().unwrap();
    let ask = ["workspace", "ups3_rpu1", "--range", "ry=-10deg:20deg:16", "rz=-0.6:0.2:9", "--slices", "x=0:50mm:2", "--at", "z=0.69"];
    let told = prints(folder.path(), &[&ask[..], &["--cone", "20", "--html", "w.html", "--csv", "w.csv"]].concat());
    assert!(
        told.contains("poses reachable") && told.contains("drive stroke q13") && told.contains("z = 0.6900 m") && !told.contains('\u{1b}')
    );
    assert_eq!(names(folder.path()), ["w.csv", "w.html"]);
    let page = fs::read_to_string(folder.path().join("w.html")).unwrap();
    assert!(page.matches("<figure>").count() == 2 && !page.contains("http") && page.len() < 100_000);
    let csv = fs::read_to_string(folder.path().join("w.csv")).unwrap();
    assert_eq!(csv.lines().next(), Some("ry,rz,x,z,cause,place,parallel,serial,condition"));
    let json: Value = serde_json::from_str(&prints(folder.path(), &[&ask[..], &["--cone", "20", "--json"]].concat())).unwrap();
    assert_eq!((&json["schema"], &json["poses"], csv.lines().count()), (&"pkm.workspace/1".into(), &288.into(), 289));
    let reachable = csv.lines().filter(|l| l.contains(",reachable,")).count();
    assert_eq!(json["reachable"], reachable);
    assert!(reachable > 10 && reachable < 200 && told.contains(" of 288 poses"), "{reachable}");
    let causes: Vec<&str> = json["limits"].as_array().unwrap().iter().map(|l| l["cause"].as_str().unwrap()).collect();
    assert!(causes.contains(&"drive stroke"), "{causes:?}");
    // The middle leg allows no travel sideways; every pose of a slice has its values.
    assert_eq!(json["slices"][1]["parallel"].as_array().unwrap().len(), 144);
    assert!(json["home"]["parallel"].as_f64().unwrap() > 0.05);
    // Asked twice, told the same, whatever the threads do.
    assert_eq!(told, prints(folder.path(), &[&ask[..], &["--cone", "20", "--html", "w.html", "--csv", "w.csv"]].concat()));
    assert_eq!(page, fs::read_to_string(folder.path().join("w.html")).unwrap());
}

#[test]
fn every_shipped_parallel_robot_has_a_workspace_without_being_told_more() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["prs3", "ups3_rpu1", "five_bar"] {
        let told = prints(folder.path(), &["workspace", name]);
        assert!(told.contains("of 1681 poses reachable") && !told.contains("· 0 %"), "{told}");
    }
    let arm = prints(folder.path(), &["workspace", "serial_arm", "--axes", "j2,j3"]);
    assert!(arm.contains("of 1681 poses reachable"), "{arm}");
}

#[test]
fn the_demo_of_the_readme_finds_what_it_concealed() {
    let folder = tempfile::tempdir().unwrap();
    // Exit status 0: the first finding, or one that it cannot be told from, is what the seal holds.
    let told = prints(folder.path(), &["demo"]);
    assert!(told.contains("The seal is unbroken."), "{told}");
}
