//! An exercise from files, as a patient's therapist runs it: armed, started, over by itself, held; and what was recorded done again to the bit.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use serde_json::Value;

use crate::site::{CONFIG, PATIENCE_S, Site};

const EXERCISE: &str = "\
law = \"exercise\"
rate_hz = 100.0
lower = [-2.0, -0.3, -0.3]
upper = [2.0, 0.3, 0.3]
[task]
kind = \"platform\"
link = \"platform\"
components = [\"z\", \"rx\", \"ry\"]
length = 0.3
[force]
kp = 1e-3
output_limit = 0.05
[inner]
law = \"computed_torque\"
bandwidth = 10.0
[inner.observer]
kind = \"commanded_acceleration\"
bandwidth = 30.0
[limits]
dt_limit = inf
[[phase]]
duration_s = 1.5
ramp_s = 1.0
channels = [{ kind = \"force\" }, { kind = \"position\", mean = 0.03 }, { kind = \"position\" }]
[[phase]]
duration_s = 1.5
ramp_s = 1.0
channels = [{ kind = \"force\" }, { kind = \"position\" }, { kind = \"position\", mean = 0.03 }]
";

#[test]
fn an_exercise_runs_from_its_order_to_the_hold_after_it_and_comes_back_to_the_bit() {
    let site = Site::new();
    let robot = pkm_robots::find("prs3").unwrap();
    let at = |name: &str| site.dir.path().join(name);
    fs::write(at("robot.toml"), format!("{}\n[[sensor]]\nname = \"foot\"\nkind = \"wrench\"\nlink = \"platform\"\n", robot.toml)).unwrap();
    let urdf = PathBuf::from(robot.urdf_name);
    fs::write(at(urdf.file_name().unwrap().to_str().unwrap()), robot.urdf).unwrap();
    fs::write(at("exercise.toml"), EXERCISE).unwrap();
    let config = CONFIG
        .replace("\"prs3\"", "\"robot.toml\"")
        .replace("kind = \"iceoryx2\"", "kind = \"simulated\"\nwrench = \"foot\"")
        .replace("motion = \"motion.csv\"", "controller = \"exercise.toml\"\nlength_s = 3.0");
    fs::write(site.config(), config).unwrap();
    let mut daemon = site.start_with("daemon", &["--record", "runs"], &[]);
    site.until(&["ready"]);
    site.order("arm");
    site.until(&["holding"]);
    site.order("start");
    let over = crate::site::within(PATIENCE_S, || site.status().filter(|s| daemon_ran(s) && s["phase"] != "running-exercise"));
    let over = over.unwrap_or_else(|| panic!("{:?}\n{}", site.status(), daemon.told()));
    assert_eq!((&over["phase"], &over["cause"], &over["law"]), (&"holding".into(), &"arrived".into(), &"exercise".into()), "{over}");
    let times: Vec<f64> = over["transitions"].as_array().unwrap().iter().rev().take(2).map(|t| t["cycle"].as_f64().unwrap()).collect();
    // Whole periods of 10 ms. Of a long gap it is told five: a machine with other work takes longer, never shorter.
    assert!(0.01 * (times[0] - times[1]) > 2.95, "{times:?}");
    site.order("quit");
    assert_eq!(daemon.end(PATIENCE_S), 0, "{}", daemon.told());
    let files: Vec<PathBuf> = fs::read_dir(at("runs")).unwrap().map(|f| f.unwrap().path()).collect();
    let told = Command::new(env!("CARGO_BIN_EXE_pkm")).arg("replay").args(&files).arg("--json").output().unwrap();
    let again: Value = serde_json::from_slice(&told.stdout).unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&told.stderr)));
    assert_eq!((&again["same"], &again["differing"]), (&true.into(), &0.into()), "{again}");
    // The recording says which build made it.
    let version = Command::new(env!("CARGO_BIN_EXE_pkm")).arg("--version").output().unwrap();
    let version = String::from_utf8_lossy(&version.stdout).trim().strip_prefix("pkm ").unwrap().to_string();
    let bytes = fs::read(&files[0]).unwrap();
    let noted = mcap::read::LinearReader::new(&bytes).unwrap().find_map(|record| match record.unwrap() {
        mcap::records::Record::Metadata(metadata) => metadata.metadata.get("version").cloned(),
        _ => None,
    });
    assert_eq!(noted, Some(version));
}

/// Whether the exercise has begun.
fn daemon_ran(status: &Value) -> bool {
    status["transitions"].as_array().unwrap().iter().any(|t| t["to"] == "running-exercise")
}
