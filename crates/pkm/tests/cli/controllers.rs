//! `--controller`: every law from a file moves a robot, what is told of faults, and which files are refused.

use std::fs;
use std::path::PathBuf;

use crate::fixture::{csv_lines, prints, refused, rig};

/// Laws that follow a motion by themselves, with the largest error over the range of the motion that is expected of them.
const TRACKING: [(&str, f64); 8] = [
    ("pd_gravity", 0.1),
    ("pd_model", 0.1),
    ("pid", 0.1),
    ("pid_clamping", 0.1),
    ("computed_torque", 0.01),
    ("computed_torque_dae", 0.01),
    ("adrc", 0.15),
    ("adrc_nonlinear", 0.15),
];

/// Largest difference of `q` and `q_ref` of any joint after the first half second, over the range of `q_ref`.
fn error(file: &PathBuf) -> f64 {
    let (first, lines) = csv_lines(file);
    let names: Vec<&str> = lines[first - 1].split(',').collect();
    let column = |name: &str| -> Vec<f64> {
        let at = names.iter().position(|n| *n == name).unwrap();
        lines[first..].iter().map(|line| line.split(',').nth(at).unwrap().parse().unwrap()).collect()
    };
    let t = column("t");
    let mut worst = 0.0_f64;
    for joint in names.iter().filter_map(|n| n.strip_prefix("q_ref.")) {
        let (q, q_ref) = (column(&format!("q.{joint}")), column(&format!("q_ref.{joint}")));
        let most = (0..t.len()).filter(|&i| t[i] > 0.5).map(|i| (q[i] - q_ref[i]).abs()).fold(0.0, f64::max);
        let range = q_ref.iter().fold(f64::MIN, |a, b| a.max(*b)) - q_ref.iter().fold(f64::MAX, |a, b| a.min(*b));
        worst = worst.max(most / range);
    }
    worst
}

/// Error of a run of `robot` under the controller `text`; `more` are arguments.
fn followed(robot: &str, text: &str, more: &[&str]) -> f64 {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("c.toml"), text).unwrap();
    let arguments = ["simulate", robot, "--out", "A.csv", "--controller", "c.toml", "--rate", "200", "--noise", "none", "--quiet"];
    let motion = ["--duration", "2.5", "--reference", "min-jerk", "--period", "1.25"];
    prints(folder.path(), &[&arguments[..], &motion, more].concat());
    assert!(fs::read_to_string(folder.path().join("A.csv")).unwrap().contains("# controller = \"c.toml\""));
    error(&folder.path().join("A.csv"))
}

#[test]
fn every_tracking_law_from_a_file_follows_on_closed_loops() {
    let mut told = Vec::new();
    for robot in ["prs3", "five_bar"] {
        for (law, bound) in TRACKING {
            let voltage = if law == "computed_torque_dae" { "b0 = 10\n[limits]\nu_limit = 1e5\n" } else { "" };
            let text = format!("law = {law:?}\nrate_hz = 1000\nbandwidth = 30\n{voltage}");
            told.push((robot, law, followed(robot, &text, &[]), bound));
        }
    }
    assert!(told.iter().all(|(_, _, error, bound)| error < bound), "{told:?}");
}

#[test]
fn laws_of_contact_from_a_file_follow_what_nobody_disturbs() {
    let inner = "[inner]\nlaw = \"computed_torque\"\nbandwidth = 30\n";
    let force = "[force]\nkp = 1e-6\n";
    let mut told = Vec::new();
    for (robot, m, [stiffness, damping]) in [("prs3", 3, [4e5, 1.5e4]), ("five_bar", 2, [400.0, 20.0])] {
        let zero = ["0"; 3][..m].join(", ");
        let cases = [
            format!("law = \"impedance\"\nrate_hz = 1000\nstiffness = {stiffness}\ndamping = {damping}\nfilter_s = 0.001\n"),
            format!("law = \"hybrid\"\nrate_hz = 1000\nselection = [{zero}]\ntravel = 0.1\n{force}{inner}"),
            // Nothing is measured of the environment but what the model does not explain: a heavy mass on a hard spring stays.
            format!("law = \"admittance\"\nrate_hz = 1000\nmass = 1e3\ndamping = 1e6\nstiffness = 1e7\ntravel = 0.1\nspeed = 1\n{inner}"),
        ];
        for text in cases {
            told.push((robot, text.lines().next().unwrap().to_string(), followed(robot, &text, &[])));
        }
    }
    assert!(told.iter().all(|(_, _, error)| *error < 0.1), "{told:?}");
}

#[test]
fn rates_of_controller_and_recording_are_their_own() {
    let text = |hz: f64| format!("law = \"computed_torque\"\nrate_hz = {hz}\nbandwidth = 20\n");
    let errors = [2000.0, 500.0, 300.0].map(|hz| followed("five_bar", &text(hz), &[]));
    // The slower, the worse; all of them good.
    assert!(errors[0] < errors[1] && errors[1] < errors[2] && errors[2] < 0.1, "{errors:?}");
    let folder = rig();
    fs::write(folder.path().join("c.toml"), text(317.123_456)).unwrap();
    let parts = ["rate_hz = 1000", "no common multiple with the controller's rate"];
    refused(folder.path(), &["simulate", "rig.toml", "--out", "A.csv", "--controller", "c.toml", "--duration", "1"], &parts);
}

#[test]
fn the_file_travels_with_the_recording() {
    let folder = rig();
    let text = "law = \"pid\"\nrate_hz = 1000\nbandwidth = 30 # a comment that only this file has\n";
    fs::write(folder.path().join("mine.toml"), text).unwrap();
    prints(folder.path(), &["simulate", "rig.toml", "--out", "A.mcap", "--controller", "mine.toml", "--duration", "1", "--quiet"]);
    let bytes = fs::read(folder.path().join("A.mcap")).unwrap();
    let has = |text: &str| bytes.windows(text.len()).any(|w| w == text.as_bytes());
    assert!(has("a comment that only this file has") && has("controller.toml") && !has("mine.toml"));
    // A twin under the same controller does the same; under the usual one it does not.
    let position = |more: &[&str]| -> f64 {
        let arguments = ["twin", "rig.toml", "--recording", "A.mcap", "--json"];
        let told: serde_json::Value = serde_json::from_str(&prints(folder.path(), &[&arguments[..], more].concat())).unwrap();
        told["joints"][0]["position"]["rms"].as_f64().unwrap()
    };
    let (same, other) = (position(&["--controller", "mine.toml"]), position(&[]));
    assert!(same < 1e-4 && other > 5.0 * same, "{same} {other}");
}

#[test]
fn a_fault_ends_the_run_and_says_code_joint_value_and_limit() {
    let folder = rig();
    let text = "law = \"pid\"\nrate_hz = 1000\nbandwidth = 30\n[limits]\nq_upper = 0.1\nq_lower = -1\nq_tolerance = 1e-3\n";
    fs::write(folder.path().join("c.toml"), text).unwrap();
    let arguments = ["simulate", "rig.toml", "--out", "A.csv", "--controller", "c.toml", "--duration", "5"];
    refused(folder.path(), &arguments, &["controller pid: fault Position (8) at joint \"j", "at t = ", "(limit 0.101)"]);
}

#[test]
fn files_that_are_no_controllers_are_refused_in_one_line() {
    let folder = rig();
    let cases = [
        ("law = \"pid\"\nrate_hz = 1000\nbandwidth = -3\n", "c.toml:3: bandwidth = -3 (must be finite and > 0)"),
        ("law = \"pid\"\nrate_hz = 1000\nbandwith = 3\n", "c.toml:1: gains are missing"),
        ("law = \"pd\"\nrate_hz = 1000\n", "c.toml:1: law = \"pd\" (must be one of: pd_gravity"),
        ("law = \"pid\"\nlaw = \"pid\"\n", "c.toml:2: duplicate key"),
        ("\u{1b}[31m", "c.toml:1: "),
    ];
    for (text, part) in cases {
        fs::write(folder.path().join("c.toml"), text).unwrap();
        refused(folder.path(), &["simulate", "rig.toml", "--out", "A.csv", "--controller", "c.toml"], &[part]);
        refused(folder.path(), &["twin", "rig.toml", "--recording", "A.csv", "--controller", "c.toml"], &[""]);
    }
    fs::write(folder.path().join("c.toml"), [0xff, 0xfe]).unwrap();
    refused(folder.path(), &["simulate", "rig.toml", "--out", "A.csv", "--controller", "c.toml"], &["c.toml: byte 0 is not UTF-8"]);
    refused(folder.path(), &["simulate", "rig.toml", "--out", "A.csv", "--controller", "none.toml"], &["none.toml: No such file"]);
}
