//! `pkm replay`: what a controller did is done again to the bit, one wrong bit is found, and what cannot be replayed is refused.

use std::fs;
use std::path::Path;

use pkm_record::{Control, ControlStep, ReadOptions};
use serde_json::Value;

use crate::fixture::{pkm, prints, refused, rig};

const COMPUTED_TORQUE: &str = "law = \"computed_torque\"\nrate_hz = 500\nbandwidth = 30\n";

fn simulated(robot: &str, controller: &str, more: &[&str]) -> tempfile::TempDir {
    let folder = rig();
    fs::write(folder.path().join("c.toml"), controller).unwrap();
    let simulate = ["simulate", robot, "--out", "A.mcap", "--controller", "c.toml", "--duration", "1", "--rate", "200", "--quiet"];
    prints(folder.path(), &[&simulate[..], more].concat());
    folder
}

#[test]
fn every_command_comes_back_to_the_bit() {
    let voltage = "law = \"computed_torque_dae\"\nrate_hz = 1000\nbandwidth = 30\nb0 = 10\n[limits]\nu_limit = 1e5\n";
    let adrc = "law = \"adrc_nonlinear\"\nrate_hz = 1000\nbandwidth = 30\n";
    for (robot, controller, steps) in [("prs3", COMPUTED_TORQUE, 501), ("five_bar", adrc, 1001), ("rig.toml", voltage, 1001)] {
        let folder = simulated(robot, controller, &[]);
        let told: Value = serde_json::from_str(&prints(folder.path(), &["replay", "A.mcap", "--json"])).unwrap();
        assert_eq!((&told["schema"], &told["same"]), (&"pkm.replay/1".into(), &true.into()), "{told}");
        assert_eq!((&told["steps"], &told["differing"]), (&steps.into(), &0.into()), "{told}");
        // And through a conversion, which keeps the steps.
        prints(folder.path(), &["convert", "A.mcap", "B.mcap"]);
        let told = prints(folder.path(), &["replay", "B.mcap"]);
        assert!(told.contains(&format!("{steps} steps of")) && told.contains("the same to the bit"), "{told}");
    }
}

#[test]
fn a_run_on_simulated_hardware_comes_back() {
    let folder = rig();
    let controller = "law = \"pd_model\"\nrate_hz = 1000\nbandwidth = 20\n";
    fs::write(folder.path().join("c.toml"), controller).unwrap();
    fs::write(folder.path().join("world.toml"), "[sampling]\nloss_begins = 0.05\n").unwrap();
    let simulate = ["simulate", "rig.toml", "--out", "A.mcap", "--controller", "c.toml", "--duration", "1", "--world", "world.toml"];
    let output = pkm(folder.path(), &simulate);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(prints(folder.path(), &["replay", "A.mcap"]).contains("1001 steps of pd_model done again, every command the same"));
}

/// Writes `to` as `from` but with the steps that `change` makes.
fn altered(from: &Path, to: &Path, change: impl Fn(ControlStep) -> ControlStep) {
    let options = ReadOptions::default();
    let recording = pkm_record::read(from, &options).unwrap();
    let mut attachments = pkm_record::read_attachments(from, &options).unwrap();
    pkm_record::read_controls(from, &options, &mut |step| attachments.controls.push(change(step))).unwrap();
    pkm_record::write(to, &recording, &attachments).unwrap();
}

#[test]
fn one_wrong_bit_is_found_and_named() {
    let folder = simulated("rig.toml", COMPUTED_TORQUE, &[]);
    let at = |name: &str| folder.path().join(name);
    let flip = |step: ControlStep| {
        let control = step.as_control();
        let mut command = control.command.to_vec();
        if step.number == 137 {
            command[1] = f64::from_bits(command[1].to_bits() ^ 1);
        }
        ControlStep::new(step.t, step.number, &Control { command: &command, ..control })
    };
    altered(&at("A.mcap"), &at("B.mcap"), flip);
    let output = pkm(folder.path(), &["replay", "B.mcap", "--json"]);
    assert_eq!(output.status.code(), Some(1));
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    let first = &told["first"];
    assert_eq!((&told["differing"], &first["step"], &first["joint"]), (&1.into(), &137.into(), &"j2".into()), "{told}");
    assert!((first["t"].as_f64().unwrap() - 0.274).abs() < 1e-9, "{told}");
    let text = String::from_utf8(pkm(folder.path(), &["replay", "B.mcap"]).stdout).unwrap();
    assert!(text.contains("1 of 501 steps") && text.contains("step 137 at t = 0.274 s: joint \"j2\""), "{text}");
    // An input that is off shows in the step it was given to, and from there on where the controller remembers.
    let push = |step: ControlStep| {
        let control = step.as_control();
        let mut q = control.q_meas.to_vec();
        q[0] += if step.number == 300 { 1e-6 } else { 0.0 };
        ControlStep::new(step.t, step.number, &Control { q_meas: &q, ..control })
    };
    altered(&at("A.mcap"), &at("C.mcap"), push);
    let output = pkm(folder.path(), &["replay", "C.mcap", "--json"]);
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((output.status.code(), &told["first"]["step"]), (Some(1), &300.into()), "{told}");
}

#[test]
fn another_controller_differs_and_what_cannot_be_replayed_is_refused() {
    let folder = simulated("rig.toml", COMPUTED_TORQUE, &[]);
    fs::write(folder.path().join("other.toml"), COMPUTED_TORQUE.replace("30", "31")).unwrap();
    let output = pkm(folder.path(), &["replay", "A.mcap", "--controller", "other.toml"]);
    assert_eq!(output.status.code(), Some(1));
    prints(folder.path(), &["simulate", "rig.toml", "--out", "bare.mcap", "--duration", "1"]);
    refused(
        folder.path(),
        &["replay", "bare.mcap"],
        &["bare.mcap: robot.toml, a URDF and controller.toml must be attached", "robot.toml, rig.urdf"],
    );
    prints(folder.path(), &["convert", "A.mcap", "A.csv"]);
    refused(folder.path(), &["replay", "A.csv"], &["A.csv", "attached: none"]);
    refused(folder.path(), &["replay", "none.mcap"], &["none.mcap"]);
    refused(folder.path(), &["replay", "A.mcap", "--controller", "rig.toml"], &["rig.toml"]);
    let at = |name: &str| folder.path().join(name);
    let later = |step: ControlStep| ControlStep::new(step.t, step.number + 1, &Control { is_first: false, ..step.as_control() });
    altered(&at("A.mcap"), &at("B.mcap"), later);
    refused(folder.path(), &["replay", "B.mcap"], &["B.mcap: step 1", "was not at rest before it"]);
    // The first file's controller goes on in the second.
    assert!(pkm(folder.path(), &["replay", "A.mcap", "B.mcap"]).status.code() == Some(1));
    // Another robot's file of the same number of drives, or none at all.
    let none = |step: ControlStep| {
        ControlStep::new(
            step.t,
            step.number,
            &Control { command: &[], q_meas: &[], tau_meas: &[], q_ref: &[], v_ref: &[], a_ref: &[], tau_ff: &[], ..step.as_control() },
        )
    };
    altered(&at("A.mcap"), &at("D.mcap"), none);
    refused(folder.path(), &["replay", "D.mcap"], &["D.mcap: step 0", "0 drives (the attached robot has 2)"]);
}

/// A robot that is simulated in the daemon's own process; what is late on a busy machine is no reason to stop.
const DAEMON: &str = r#"
robot = "prs3"
controller = "hold.toml"
directory = "meet"
realtime = "off"
[hal]
kind = "simulated"
valid_for_s = 1.0
stale_s = 0.8
[loop]
stall_s = 10.0
supervisor_s = 10.0
consecutive_overruns = 1000
overrun_share = 1.0
soft_start_s = 0.2
[limits]
following = 0.1
[safe]
kind = "hold"
stiffness = 20000.0
damping = 2000.0
effort = 1400.0
[run]
controller = "run.toml"
motion = "motion.csv"
"#;

#[test]
fn what_a_daemon_commanded_comes_back_to_the_bit_and_one_wrong_bit_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let law = |bandwidth: &str| {
        let observer = "[observer]\nkind = \"commanded_acceleration\"\nbandwidth = 30\n[limits]\ndt_limit = inf\n";
        format!("law = \"computed_torque\"\nrate_hz = 100\nbandwidth = {bandwidth}\n{observer}")
    };
    fs::write(at("daemon.toml"), DAEMON).unwrap();
    fs::write(at("hold.toml"), law("10")).unwrap();
    fs::write(at("run.toml"), law("8")).unwrap();
    let rows = (0..200).map(|i| (0.01 * f64::from(i), 0.15 + 1e-5 * f64::from(i)));
    let rows: String = rows.map(|(t, q)| format!("{t},{q},{q},{q}\n")).collect();
    fs::write(at("motion.csv"), format!("t,q_ref.q1,q_ref.q6,q_ref.q8\n{rows}")).unwrap();
    let told = prints(folder.path(), &["daemon", "daemon.toml", "--start", "--seconds", "6", "--record", "runs"]);
    let told_of_all = told.contains("holding -> running-position") && told.contains(" 0 lost");
    assert!(told_of_all, "{told}");
    let recorded = "runs/prs3_0001.mcap";
    let again: Value = serde_json::from_str(&prints(folder.path(), &["replay", recorded, "--json"])).unwrap();
    assert_eq!((&again["same"], &again["differing"]), (&true.into(), &0.into()), "{again}");
    let mut steps = Vec::new();
    pkm_record::read_controls(&at(recorded), &ReadOptions::default(), &mut |step| steps.push(step)).unwrap();
    assert_eq!(again["steps"], steps.len());
    let of_run = steps.iter().filter(|step| step.as_control().is_other_law).count();
    assert!(of_run > 50 && steps.len() - of_run > 20, "{of_run} of {}", steps.len());
    // Without the second controller's own file these would be another law's steps.
    let output = pkm(folder.path(), &["replay", recorded, "--controller", "hold.toml", "--json"]);
    let other: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(output.status.code() == Some(1) && other["differing"].as_u64().unwrap() <= of_run as u64, "{other}");
    let chosen = steps[steps.len() / 2].number;
    let flip = |step: ControlStep| {
        let control = step.as_control();
        let mut command = control.command.to_vec();
        if step.number == chosen {
            command[2] = f64::from_bits(command[2].to_bits() ^ 1);
        }
        ControlStep::new(step.t, step.number, &Control { command: &command, ..control })
    };
    altered(&at(recorded), &at("B.mcap"), flip);
    let output = pkm(folder.path(), &["replay", "B.mcap", "--json"]);
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    let (first, differing) = (&told["first"], &told["differing"]);
    assert_eq!(
        (output.status.code(), differing, &first["step"], &first["joint"]),
        (Some(1), &1.into(), &chosen.into(), &"q8".into()),
        "{told}"
    );
}

#[test]
fn a_cut_file_is_mended_and_says_what_it_lost() {
    let folder = simulated("rig.toml", COMPUTED_TORQUE, &["--reference", "min-jerk"]);
    let whole = fs::read(folder.path().join("A.mcap")).unwrap();
    fs::write(folder.path().join("cut.mcap"), &whole[..whole.len() * 3 / 5]).unwrap();
    refused(folder.path(), &["convert", "cut.mcap", "B.mcap"], &["cut.mcap byte", "`pkm convert --recover` mends the file"]);
    let told = prints(folder.path(), &["convert", "cut.mcap", "mended.mcap", "--recover"]);
    assert!(told.contains("Recovered: ") && told.contains(" bytes lost; first damage at byte"), "{told}");
    let told = prints(folder.path(), &["replay", "mended.mcap"]);
    assert!(told.contains("every command the same to the bit"), "{told}");
    // One byte in the only chunk: its checksum says that nothing in it can be believed.
    let mut bad = whole.clone();
    let at = bad.len() / 3;
    bad[at] ^= 0xff;
    fs::write(folder.path().join("bad.mcap"), &bad).unwrap();
    fs::remove_file(folder.path().join("mended.mcap")).unwrap();
    refused(folder.path(), &["convert", "bad.mcap", "mended.mcap", "--recover"], &["bad.mcap", "no samples"]);
}
