//! `pkm excite`: its files, that they can be played, what it refuses.

use std::fs;
use std::process::Command;

use serde_json::Value;

use crate::fixture::{csv_lines, names, prints, refused, rig};

const ARGUMENTS: [&str; 14] = [
    "excite",
    "rig.toml",
    "--out",
    "motion.csv",
    "--period",
    "4",
    "--restarts",
    "2",
    "--draws",
    "6",
    "--iterations",
    "12",
    "--harmonics",
    "4",
];

#[test]
fn a_motion_is_better_than_random_and_plays() {
    let folder = rig();
    let told = prints(folder.path(), &[&ARGUMENTS[..], &["--html", "out.html", "--json"]].concat());
    let json: Value = serde_json::from_str(&told).unwrap();
    assert_eq!((&json["schema"], &json["criterion"]), (&"pkm.excitation/1".into(), &"condition".into()));
    assert!(json["gain_over_random"].as_f64().unwrap() > 1.0, "{json}");
    let margins = json["margins"].as_array().unwrap();
    assert!(margins.len() >= 4 && margins.iter().all(|m| m["room"].as_f64().unwrap() >= 0.0), "{json}");
    assert_eq!(json["settings"]["seed"], 1);
    let page = fs::read_to_string(folder.path().join("out.html")).unwrap();
    assert!(page.contains("Position of j1") && page.contains("Velocity of j2") && page.contains("The search") && !page.contains("http"));
    let (first, lines) = csv_lines(&folder.path().join("motion.csv"));
    assert_eq!((lines.len() - first, lines[first - 1].as_str()), (401, "t,ddq_ref.j1,ddq_ref.j2,dq_ref.j1,dq_ref.j2,q_ref.j1,q_ref.j2"));
    assert!(lines.iter().any(|l| l.starts_with("# excitation_period = \"4\"")), "{:?}", &lines[..first]);
    // It plays: the simulator checks every limit of the robot on its own.
    let simulated = prints(folder.path(), &["simulate", "rig.toml", "--out", "A.csv", "--reference", "motion.csv", "--rate", "200"]);
    assert!(simulated.contains("A.csv: 801 samples"), "{simulated}");
}

#[test]
fn words_are_for_people_and_quiet_is_quiet() {
    let folder = rig();
    let said = prints(folder.path(), &[&ARGUMENTS[..], &["--basis", "spline", "--criterion", "determinant"]].concat());
    for part in [
        "rig: log-determinant",
        "best of 12 random motions",
        "structural rank",
        "Nearest to their limits",
        "Motion: motion.csv, 401 samples",
    ] {
        assert!(said.contains(part), "{part} in {said}");
    }
    let mut arguments = [&ARGUMENTS[..], &["--quiet", "--periods", "2"]].concat();
    arguments[3] = "motion.mcap";
    assert!(prints(folder.path(), &arguments).is_empty());
    prints(folder.path(), &["convert", "motion.mcap", "back.csv"]);
    let (first, lines) = csv_lines(&folder.path().join("back.csv"));
    assert_eq!(lines.len() - first, 801);
}

#[test]
fn the_same_arguments_give_the_same_bytes_whatever_the_threads_do() {
    let folder = rig();
    let contents = ["1", "4"].map(|threads| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pkm"));
        let output =
            command.args(ARGUMENTS).args(["--force", "--quiet"]).env("RAYON_NUM_THREADS", threads).current_dir(folder.path()).output();
        let output = output.unwrap();
        assert!(output.status.success() && output.stdout.is_empty() && output.stderr.is_empty(), "{output:?}");
        fs::read(folder.path().join("motion.csv")).unwrap()
    });
    assert_eq!(contents[0], contents[1]);
    assert_eq!(names(folder.path()), ["motion.csv", "rig.toml", "rig.urdf"]);
}

#[test]
fn bad_usage_is_one_line() {
    let folder = rig();
    let with = |more: &[&'static str]| [&ARGUMENTS[..], more].concat();
    refused(folder.path(), &["excite", "rig.toml", "--out", "motion.txt"], &["motion.txt"]);
    refused(folder.path(), &["excite", "rig.toml", "--out", "rig.csv", "--harmonics", "2"], &["rig.toml", "harmonics = 2", "3 to 50"]);
    refused(folder.path(), &["excite", "rig.toml", "--out", "a.csv", "--basis", "bezier"], &["--basis", "bezier"]);
    refused(folder.path(), &with(&["--criterion", "angle"]), &["--criterion angle", "0 effects", "--separate"]);
    refused(folder.path(), &with(&["--separate", "friction_coulomb@j1:coulomb=1"]), &["--separate", "1 effects"]);
    let twice = ["--criterion", "power", "--separate", "friction_load@j9:mu=0.1", "--separate", "friction_load@j1:mu=0.1"];
    refused(folder.path(), &with(&twice), &["--separate", "j9"]);
    refused(folder.path(), &with(&["--rate", "2"]), &["--rate 2 Hz", "10.000 Hz"]);
    refused(folder.path(), &with(&["--periods", "0"]), &["--periods 0"]);
    refused(folder.path(), &with(&["--share", "0"]), &["share of the limits = 0"]);
    refused(folder.path(), &with(&["--html", "motion.csv"]), &["motion.csv", "two outputs"]);
    fs::write(folder.path().join("motion.csv"), "x").unwrap();
    refused(folder.path(), &ARGUMENTS, &["motion.csv", "exists already", "--force"]);
    let weak = fs::read_to_string(folder.path().join("rig.urdf")).unwrap().replace("effort=\"80\"", "effort=\"0.5\"");
    fs::write(folder.path().join("rig.urdf"), weak).unwrap();
    refused(folder.path(), &with(&["--force"]), &["rig.toml", "no motion of \"rig\"", "effort of j1", "limits -0.475"]);
}
