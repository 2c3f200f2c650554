//! `--world`: what sensors, drives and a person do to a recording, and which files are refused.

extern crate alloc;

use alloc::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crate::fixture::{RIG_TOML, csv_lines, prints, refused, rig};

type Columns = BTreeMap<String, Vec<f64>>;

const EXAMPLE: &str = include_str!("../../../../docs/examples/world.toml");

/// Arguments of a run of the rig along a motion that repeats every second.
const RUN: [&str; 13] =
    ["simulate", "rig.toml", "--out", "A.csv", "--rate", "200", "--period", "1", "--duration", "2", "--force", "--world", "w.toml"];

/// Columns of a run with the world `text`.
fn moved(folder: &Path, text: &str, more: &[&str]) -> Columns {
    fs::write(folder.join("w.toml"), text).unwrap();
    prints(folder, &[&RUN[..], &["--quiet"], more].concat());
    columns(&folder.join("A.csv"))
}

fn columns(file: &Path) -> Columns {
    let (first, lines) = csv_lines(&file.to_path_buf());
    let number = |x: &str| if x.is_empty() { f64::NAN } else { x.parse().unwrap() };
    let names = lines[first - 1].split(',').enumerate();
    names.map(|(i, name)| (name.to_string(), lines[first..].iter().map(|l| number(l.split(',').nth(i).unwrap())).collect())).collect()
}

fn rms(x: impl Iterator<Item = f64>) -> f64 {
    let x: Vec<f64> = x.collect();
    (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt()
}

/// Largest distance of a column from whole multiples of `step`, over `step`.
fn off_grid(column: &[f64], step: f64) -> f64 {
    column.iter().map(|x| (x / step - (x / step).round()).abs()).fold(0.0, f64::max)
}

#[test]
fn counts_and_steps_are_seen_where_the_file_puts_them() {
    let folder = rig();
    let text = "[drive]\noutput = { step = 0.5 }\n[drive.encoder]\ncounts_per_unit = 1000\n[joint.j2.encoder]\n";
    let told = moved(folder.path(), text, &[]);
    assert!(off_grid(&told["q.j1"], 1e-3) < 1e-9, "{}", off_grid(&told["q.j1"], 1e-3));
    assert!(off_grid(&told["q.j2"], 1e-3) > 0.4, "an empty table at a joint is an ideal encoder");
    for joint in ["j1", "j2"] {
        let (q, q_ref) = (&told[&format!("q.{joint}")], &told[&format!("q_ref.{joint}")]);
        let range = q_ref.iter().fold(f64::MIN, |a, b| a.max(*b)) - q_ref.iter().fold(f64::MAX, |a, b| a.min(*b));
        assert!(range > 0.3 && rms(q.iter().zip(q_ref).map(|(a, b)| a - b)) < 0.1 * range);
        assert!(off_grid(&told[&format!("tau.{joint}")][1..], 0.5) < 1e-9, "a cell without errors shows whole steps");
    }
}

#[test]
fn velocity_is_counted_pulses_or_not_there_at_all() {
    let folder = rig();
    let counting = "[drive.encoder]\ncounts_per_unit = 1000\n[drive.velocity]\nkind = \"pulse_counting\"\n";
    // One count in a millisecond is 1 rad/s.
    assert!(off_grid(&moved(folder.path(), counting, &[])["dq.j1"], 1.0) < 1e-9);
    assert!(off_grid(&moved(folder.path(), "", &[])["dq.j1"], 1.0) > 0.4);
    assert!(!moved(folder.path(), "[drive.velocity]\nkind = \"none\"\n", &[]).contains_key("dq.j1"));
}

#[test]
fn lost_samples_are_missing_in_every_measured_column_and_counted() {
    let folder = rig();
    fs::write(folder.path().join("w.toml"), "[sampling]\nloss_begins = 0.1\nloss_goes_on = 0.5\n").unwrap();
    let told: serde_json::Value = serde_json::from_str(&prints(folder.path(), &[&RUN[..], &["--json"]].concat())).unwrap();
    let lost = told["samples_lost"].as_u64().unwrap();
    let columns = columns(&folder.path().join("A.csv"));
    let missing = |name: &str| columns[name].iter().filter(|x| x.is_nan()).count() as u64;
    // One in six in the mean, 401 samples, in bursts.
    assert!((30..=110).contains(&lost), "{lost}");
    assert_eq!(["q.j1", "dq.j1", "tau.j1", "q.j2", "q_ref.j1", "dq_ref.j2"].map(missing), [lost, lost, lost, lost, 0, 0]);
    assert!(prints(folder.path(), &RUN).contains(&format!("never arrived: {lost}")));
}

#[test]
fn a_second_encoder_sees_the_load_and_not_the_drift_of_the_first() {
    let folder = rig();
    let text = "[drive.encoder]\ndrift = 1e-3\n[joint.j1.second_encoder]\n";
    let rigid = moved(folder.path(), text, &[]);
    assert!(!rigid.contains_key("q_link.j2"));
    let apart = |c: &Columns, i: usize| c["q.j1"][i] - c["q_link.j1"][i];
    for (i, t) in rigid["t"].iter().enumerate() {
        assert!((apart(&rigid, i) - 1e-3 * t).abs() < 1e-9, "{} at {t} s", apart(&rigid, i));
    }
    let soft = moved(folder.path(), "[joint.j1.second_encoder]\n", &["--hide", "joint_elasticity@j1:stiffness=2000,damping=2"]);
    let twist = rms((0..soft["t"].len()).map(|i| apart(&soft, i)));
    let expected = rms(soft["tau.j1"].iter().map(|tau| tau / 2000.0));
    assert!((0.5..2.0).contains(&(twist / expected)), "{twist} rad, about {expected} rad");
}

#[test]
fn a_passive_limb_repeats_with_the_motion_and_a_trembling_person_does_not() {
    let folder = rig();
    let change = |text: &str| {
        let tau = &moved(folder.path(), text, &[])["tau.j1"];
        // The second period of one second, all but its begin, where the first one starts from rest.
        rms((50..200).map(|i| tau[i + 200] - tau[i]))
    };
    let passive = "[limb.axis.j1]\nstiffness = 20\ndamping = 0.5\n";
    let (alone, limb, person) = (change(""), change(passive), change(&format!("{passive}tremor = 2\n")));
    assert!(limb < 0.05 && limb < 2.0 * alone + 0.02, "{alone} {limb}");
    assert!(person > 0.5, "{person}");
}

#[test]
fn who_resists_costs_work_and_who_assists_saves_it() {
    let folder = rig();
    for (place, axis) in [("", "j1"), ("link = \"arm\"\n", "ry")] {
        let work = |will: &str| {
            let text = format!("[limb]\n{place}[limb.axis.{axis}]\nstrength = 5\n[limb.person]\nvariation = 0\nwill = {will:?}\n");
            let c = moved(folder.path(), &text, &[]);
            c["tau.j1"].iter().zip(&c["dq.j1"]).map(|(tau, v)| tau * v).sum::<f64>() / 200.0
        };
        let distance: f64 = moved(folder.path(), "", &[])["dq.j1"].iter().map(|v| v.abs()).sum::<f64>() / 200.0;
        let [passive, resists, assists] = ["passive", "resists", "assists"].map(work);
        // 5 N·m all the way, less near standstill.
        for saved in [resists - passive, passive - assists] {
            assert!((0.7..1.02).contains(&(saved / (5.0 * distance))), "{place}{saved} J over {distance} rad");
        }
    }
}

/// The rig with a wrench sensor on its last link.
const SENSOR: &str = "\n[[sensor]]\nname = \"cuff\"\nkind = \"wrench\"\nlink = \"hand\"\n";

#[test]
fn a_wrench_sensor_shows_what_the_limb_does_to_the_link_within_the_noise_of_its_cells() {
    let folder = rig();
    fs::write(folder.path().join("rig.toml"), format!("{RIG_TOML}{SENSOR}")).unwrap();
    let limb = "[limb]\nlink = \"hand\"\n[limb.axis.ry]\nstiffness = 5\n";
    let told = moved(folder.path(), limb, &[]);
    // Both joints turn about y: the limb turns by their sum.
    let turned = |i: usize| [&told["q.j1"], &told["q.j2"]].iter().map(|q| q[i] - q[0]).sum::<f64>();
    let noisy = moved(folder.path(), &format!("{limb}[wrench.cuff]\nmoment = {{ noise = 0.2, bias = 0.5 }}\n"), &[]);
    for (i, t) in told["t"].iter().enumerate() {
        let error = told["wrench.cuff.my"][i] + 5.0 * turned(i);
        // What the limb turns in half a step of 0.5 ms at up to 12 rad/s.
        assert!(error.abs() < 5.0 * 2.5e-4 * 12.0, "{error} N·m at {t} s");
        assert!(["fx", "fy", "fz", "mx", "mz"].iter().all(|c| told[&format!("wrench.cuff.{c}")][i].abs() < 1e-9));
    }
    assert!(rms(told["wrench.cuff.my"].iter().copied()) > 1.0);
    let left: Vec<f64> = noisy["wrench.cuff.my"].iter().zip(&told["wrench.cuff.my"]).map(|(a, b)| a - b).collect();
    let mean = left.iter().sum::<f64>() / left.len() as f64;
    // Five standard errors of 401 samples.
    assert!((mean - 0.5).abs() < 5.0 * 0.2 / 20.0 && (rms(left.iter().map(|x| x - mean)) / 0.2 - 1.0).abs() < 5.0 / 28.0);
}

#[test]
fn the_example_runs_and_the_same_arguments_give_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("w.toml"), EXAMPLE).unwrap();
    let run = |out: &str, seed: &str| {
        let arguments = ["simulate", "prs3", "--world", "w.toml", "--duration", "0.3", "--out", out, "--seed", seed, "--quiet"];
        prints(folder.path(), &arguments);
        fs::read(folder.path().join(out)).unwrap()
    };
    let (first, second, other) = (run("A.csv", "1"), run("B.csv", "1"), run("C.csv", "2"));
    assert!(first == second && first != other);
    assert!(run("A.mcap", "1") == run("B.mcap", "1"));
    let text = String::from_utf8(first).unwrap();
    assert!(text.contains("# simulated_world = ") && text.contains("q_link.q8") && text.contains(",,"), "{}", &text[..600]);
}

#[test]
fn a_robot_with_a_surplus_drive_follows_and_its_drives_share_the_weight() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("w.toml"), "").unwrap();
    let arguments = ["simulate", "ups4", "--world", "w.toml", "--duration", "1", "--rate", "200", "--out", "A.csv", "--quiet"];
    prints(folder.path(), &arguments);
    let told = columns(&folder.path().join("A.csv"));
    let joints: Vec<&str> = told.keys().filter_map(|n| n.strip_prefix("q_ref.")).collect();
    assert_eq!(joints.len(), 4);
    for joint in joints {
        let (q, q_ref) = (&told[&format!("q.{joint}")], &told[&format!("q_ref.{joint}")]);
        let range = q_ref.iter().fold(f64::MIN, |a, b| a.max(*b)) - q_ref.iter().fold(f64::MAX, |a, b| a.min(*b));
        let error = rms(q.iter().zip(q_ref).map(|(a, b)| a - b));
        assert!(error < 0.1 * range, "{joint}: {error} of {range}");
        assert!(rms(told[&format!("tau.{joint}")].iter().copied()) > 0.1);
    }
    // Without a world of sensors it is simulated as well, and what it recorded can be diagnosed and identified.
    prints(folder.path(), &["simulate", "ups4", "--duration", "24", "--rate", "200", "--out", "B.csv", "--quiet"]);
    prints(folder.path(), &["diagnose", "ups4", "--recording", "B.csv", "--json", "out.json", "--no-replay", "--quiet"]);
    let verdict: serde_json::Value = serde_json::from_str(&fs::read_to_string(folder.path().join("out.json")).unwrap()).unwrap();
    assert_eq!((&verdict["status"], &verdict["nothing_missing"]), (&"ok".into(), &true.into()), "{}", verdict["says"]);
    assert_eq!(verdict["internal_effort"]["where"], serde_json::json!(["l1", "l2", "l3", "l4"]));
    prints(folder.path(), &["identify", "ups4", "--recording", "B.csv", "--json", "found.json"]);
}

#[test]
fn worlds_that_cannot_be_are_refused_in_one_line() {
    let folder = rig();
    for (text, parts) in [
        ("nonsense = 1\n", &["w.toml:1: ", "nonsense"][..]),
        ("[drive.encoder]\ncounts_per_unit = \"many\"\n", &["w.toml:2: ", "string"]),
        ("[drive.encoder]\ncounts_per_unit = 0\n", &["w.toml: drive.encoder.counts_per_unit = 0 (must be finite and > 0)"]),
        ("[joint.j2.encoder]\nnoise = -1\n", &["joint.j2.encoder.noise = -1 (must be finite and >= 0)"]),
        ("[joint.j9.encoder]\n", &["joint.j9: no drive of that name (there are: j1, j2)"]),
        ("[drive.velocity]\nkind = \"pulse_counting\"\n", &["drive.velocity: ", "counts_per_unit"]),
        ("[drive.velocity]\nkind = \"exact\"\ntimer_s = 1e-6\n", &["drive.velocity.timer_s = 0.000001 (only of kind"]),
        ("[drive]\ndelay_s = 2\n", &["drive.delay_s = 2 (must be 0 to 1 s)"]),
        ("[drive.output]\nbits = 12\n", &["drive.output.ceiling is missing"]),
        ("[drive.output]\nceiling = 5\nbits = 99\n", &["drive.output.bits = 99 (must be 2 to 24)"]),
        ("[drive.three_mass]\nrod_mass = 1\n", &["w.toml:1: missing field"]),
        ("[sampling]\nloss_begins = 1.0\n", &["sampling.loss_begins = 1 (must be at least 0 and below 1)"]),
        ("[sampling]\njitter_s = 0.5\n", &["jitter = 0.5", "below the period"]),
        ("[wrench.cuff]\n", &["wrench.cuff: no wrench sensor of that name"]),
        ("[limb]\nlink = \"leg\"\n", &["limb.link = \"leg\" (no such link)"]),
        ("[limb]\nlink = \"base\"\n", &["limb.link = \"base\" (must be a link that moves)"]),
        ("[limb.axis.rx]\n", &["limb.axis.rx: no such axis (there are: j1, j2)"]),
        ("[limb.axis.j1]\nstiffness = nan\n", &["limb.axis.j1: ", "stiffness of a limb = NaN"]),
        ("[limb.person]\nspeed = 0\n", &["limb.person: ", "speed of a will = 0 (must be finite and positive)"]),
        ("substeps = 0\n", &["substeps = 0 (must be 1 to 100)"]),
    ] {
        fs::write(folder.path().join("w.toml"), text).unwrap();
        refused(folder.path(), &RUN, parts);
    }
    fs::write(folder.path().join("w.toml"), "[limb]\nlink = \"arm\"\n").unwrap();
    refused(folder.path(), &[&RUN[..], &["--plant", "reduced"]].concat(), &["a limb at a link", "constrained"]);
    refused(folder.path(), &[&RUN[..], &["--noise", "none"]].concat()[..], &["--noise"]);
}

#[cfg(not(feature = "rapier"))]
#[test]
fn a_plant_that_is_not_built_in_is_named_with_its_feature() {
    let folder = rig();
    refused(folder.path(), &["simulate", "rig.toml", "--out", "A.csv", "--plant", "rapier"], &["--plant rapier", "feature \"rapier\""]);
}

#[cfg(feature = "rapier")]
#[test]
fn the_foreign_engine_moves_the_robot_where_it_is_built_in() {
    let folder = rig();
    let told = moved(folder.path(), "", &["--plant", "rapier"]);
    let own = moved(folder.path(), "", &[]);
    assert!(rms(told["q.j1"].iter().zip(&own["q.j1"]).map(|(a, b)| a - b)) < 2e-2);
}
