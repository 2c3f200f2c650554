//! Bad input and bad usage: one line that names file, place, value and limit; exit 2; no file left behind.

use std::fs;
use std::path::Path;

use crate::fixture::{RIG_TOML, RIG_URDF, csv_lines, demo, pkm, prints, refused, rig, rig_with_recordings};

/// Every output there is, so that none may appear.
const OUTPUTS: [&str; 6] = ["--json", "out.json", "--html", "out.html", "--refined", "out.toml"];

fn diagnosis_refused(folder: &Path, robot: &str, recording: &str, parts: &[&str]) {
    let mut arguments = vec!["diagnose", robot, "--recording", recording];
    arguments.extend(OUTPUTS);
    refused(folder, &arguments, parts);
}

/// A changed A.csv under the name bad.csv.
fn with_bad(change: impl Fn(usize, &mut Vec<String>)) -> tempfile::TempDir {
    let folder = rig_with_recordings();
    let (first, mut lines) = csv_lines(&folder.path().join("A.csv"));
    change(first, &mut lines);
    fs::write(folder.path().join("bad.csv"), lines.join("\n") + "\n").unwrap();
    folder
}

fn rename(first: usize, lines: &mut [String], from: &str, to: &str) {
    lines[first - 1] = lines[first - 1].replace(from, to);
}

#[test]
fn a_missing_column() {
    let folder = with_bad(|first, lines| rename(first, lines, "tau.j1", "current.j1"));
    diagnosis_refused(folder.path(), "rig.toml", "bad.csv", &["bad.csv", "\"tau.j1\"", "every actuated joint"]);
    let folder = with_bad(|first, lines| rename(first, lines, "t,", "time,"));
    diagnosis_refused(folder.path(), "rig.toml", "bad.csv", &["bad.csv line ", "no column t"]);
}

#[test]
fn a_column_that_is_there_twice() {
    let folder = with_bad(|first, lines| rename(first, lines, "q_ref.j2", "tau.j1"));
    diagnosis_refused(folder.path(), "rig.toml", "bad.csv", &["bad.csv line ", "column tau.j1 is there twice"]);
}

#[test]
fn time_that_does_not_increase() {
    let folder = with_bad(|first, lines| lines.swap(first + 10, first + 11));
    diagnosis_refused(folder.path(), "rig.toml", "bad.csv", &["bad.csv line ", "t = 0.02 s does not increase", "0.022 s"]);
    let folder = with_bad(|first, lines| lines[first + 11] = lines[first + 10].clone());
    diagnosis_refused(folder.path(), "rig.toml", "bad.csv", &["bad.csv line ", "does not increase"]);
}

#[test]
fn a_column_of_gaps() {
    let folder = with_bad(|first, lines| {
        let column = lines[first - 1].split(',').position(|name| name == "tau.j2").unwrap();
        for line in &mut lines[first + 100..] {
            let mut fields: Vec<&str> = line.split(',').collect();
            fields[column] = "nan";
            *line = fields.join(",");
        }
    });
    diagnosis_refused(folder.path(), "rig.toml", "bad.csv", &["bad.csv", "\"tau.j2\" has 100 known samples of ", "at least half"]);
}

#[test]
fn fields_that_are_no_numbers() {
    let folder = with_bad(|first, lines| lines[first + 5] = lines[first + 5].replacen("0.0", "zero", 1));
    diagnosis_refused(folder.path(), "rig.toml", "bad.csv", &["bad.csv line ", "column t", "zero", "is not a number"]);
    let folder = with_bad(|first, lines| lines[first + 5].push_str(",1"));
    diagnosis_refused(folder.path(), "rig.toml", "bad.csv", &["bad.csv line ", "fields, the header has"]);
    let folder = with_bad(|first, lines| {
        let at = lines[first + 5].rfind(',').unwrap();
        lines[first + 5].replace_range(at.., ",inf");
    });
    diagnosis_refused(folder.path(), "rig.toml", "bad.csv", &["bad.csv line ", "\"inf\" is not finite"]);
}

#[test]
fn a_recording_of_another_robot() {
    let folder = rig_with_recordings();
    diagnosis_refused(folder.path(), "prs3", "A.csv", &["A.csv", "\"q.q1\"", "\"prs3\""]);
    // The right names, but positions that this robot cannot take.
    let folder = with_bad(|first, lines| {
        rename(first, lines, "q.j1", "q.shoulder_left");
        rename(first, lines, "q.j2", "q.shoulder_right");
        rename(first, lines, "tau.j1", "tau.shoulder_left");
        rename(first, lines, "tau.j2", "tau.shoulder_right");
        for line in &mut lines[first..] {
            let (t, rest) = line.split_once(',').unwrap();
            let tenfold: Vec<String> = rest.split(',').map(|x| (10.0 * x.parse::<f64>().unwrap()).to_string()).collect();
            *line = format!("{t},{}", tenfold.join(","));
        }
    });
    prints(folder.path(), &["diagnose", "five_bar", "--recording", "bad.csv", "--json", "out.json"]);
    let told = fs::read_to_string(folder.path().join("out.json")).unwrap();
    assert!(
        told.contains("\"unusable\"")
            && told.contains("bad.csv: q.shoulder_left goes from")
            && told.contains("limits are -0.600 to 0.600 rad"),
        "{told}"
    );
}

#[test]
fn three_samples() {
    let folder = with_bad(|first, lines| lines.truncate(first + 3));
    diagnosis_refused(folder.path(), "rig.toml", "bad.csv", &["bad.csv", "3 samples", "at least 200"]);
    let folder = with_bad(|first, lines| lines.truncate(first));
    diagnosis_refused(folder.path(), "rig.toml", "bad.csv", &["bad.csv", "no samples"]);
}

#[test]
fn files_of_zero_bytes() {
    let folder = rig_with_recordings();
    for name in ["zero.csv", "zero.mcap", "zero.toml"] {
        fs::write(folder.path().join(name), "").unwrap();
    }
    diagnosis_refused(folder.path(), "rig.toml", "zero.csv", &["zero.csv", "empty"]);
    diagnosis_refused(folder.path(), "rig.toml", "zero.mcap", &["zero.mcap"]);
    diagnosis_refused(folder.path(), "zero.toml", "A.csv", &["zero.toml", "empty"]);
    fs::write(folder.path().join("rig.urdf"), "").unwrap();
    diagnosis_refused(folder.path(), "rig.toml", "A.csv", &["rig.urdf", "empty"]);
}

#[test]
fn files_that_are_cut() {
    let folder = rig_with_recordings();
    let text = fs::read_to_string(folder.path().join("A.csv")).unwrap();
    let last = text.trim_end().rfind('\n').unwrap();
    let cut = &text[..last + 12];
    fs::write(folder.path().join("cut.csv"), cut).unwrap();
    diagnosis_refused(folder.path(), "rig.toml", "cut.csv", &["cut.csv line ", "the header has"]);
    let bytes = fs::read(folder.path().join("A.mcap")).unwrap();
    fs::write(folder.path().join("cut.mcap"), &bytes[..bytes.len() * 2 / 3]).unwrap();
    diagnosis_refused(folder.path(), "rig.toml", "cut.mcap", &["cut.mcap byte ", "--recover"]);
    refused(folder.path(), &["convert", "cut.mcap", "mended.csv"], &["cut.mcap byte "]);
    prints(folder.path(), &["convert", "cut.mcap", "mended.csv", "--recover"]);
    let urdf = &RIG_URDF[..RIG_URDF.len() / 2];
    fs::write(folder.path().join("rig.urdf"), urdf).unwrap();
    diagnosis_refused(folder.path(), "rig.toml", "A.csv", &["rig.urdf"]);
}

#[test]
fn binary_garbage() {
    let folder = rig_with_recordings();
    let garbage: Vec<u8> = (0..5000_u32).map(|i| u8::try_from((i * 7919 + i * i) % 256).unwrap()).collect();
    for name in ["bad.csv", "bad.mcap", "bad.toml"] {
        fs::write(folder.path().join(name), &garbage).unwrap();
    }
    diagnosis_refused(folder.path(), "rig.toml", "bad.csv", &["bad.csv"]);
    diagnosis_refused(folder.path(), "rig.toml", "bad.mcap", &["bad.mcap"]);
    diagnosis_refused(folder.path(), "bad.toml", "A.csv", &["bad.toml", "UTF-8"]);
    refused(folder.path(), &["check", "bad.toml"], &["bad.toml"]);
}

#[test]
fn robots_that_are_none() {
    for (from, to, parts) in [
        ("rotor_inertia = 0.05", "rotor_inertia = 0.05\ncolour = 3", &["rig.toml", "line 7", "colour"][..]),
        ("joint = \"j1\"", "joint = \"shoulder\"", &["rig.toml", "shoulder"]),
        ("rotor_inertia = 0.05", "rotor_inertia = -1.0", &["rig.toml", "j1", "-1"]),
        ("name = \"rig\"", "name = \"rig", &["rig.toml", "line 1"]),
        ("rig.urdf", "lost.urdf", &["lost.urdf", "No such file"]),
    ] {
        let folder = rig_with_recordings();
        fs::write(folder.path().join("rig.toml"), RIG_TOML.replacen(from, to, 1)).unwrap();
        refused(folder.path(), &["check", "rig.toml"], parts);
        diagnosis_refused(folder.path(), "rig.toml", "A.csv", parts);
    }
    for (from, to, parts) in [
        ("<mass value=\"2\"/>", "<mass value=\"-2\"/>", &["rig.urdf", "arm", "mass", "-2"][..]),
        ("izz=\"0.02\"", "izz=\"nan\"", &["rig.urdf", "arm"]),
        ("type=\"revolute\"", "type=\"floating\"", &["rig.toml", "j1"]),
        ("<child link=\"hand\"/>", "<child link=\"arm\"/>", &["rig.urdf"]),
    ] {
        let folder = rig_with_recordings();
        fs::write(folder.path().join("rig.urdf"), RIG_URDF.replacen(from, to, 1)).unwrap();
        refused(folder.path(), &["check", "rig.toml"], parts);
        diagnosis_refused(folder.path(), "rig.toml", "A.csv", parts);
    }
}

#[test]
fn effects_that_are_none() {
    for (effect, parts) in [
        ("name = \"magnetism\"\nwhere = \"j1\"", &["rig.toml", "magnetism", "not in the library"][..]),
        ("name = \"friction_coulomb\"\nwhere = \"j9\"\nparameters = { coulomb = 1.0 }", &["rig.toml", "j9"]),
        ("name = \"friction_coulomb\"\nwhere = \"j1\"\nparameters = { coulomb = -1.0 }", &["coulomb", "-1", ">= 0"]),
        ("name = \"friction_coulomb\"\nwhere = \"j1\"\nparameters = { viscous = 1.0, coulomb = 1.0 }", &["viscous", "unknown"]),
    ] {
        let folder = rig_with_recordings();
        fs::write(folder.path().join("rig.toml"), format!("{RIG_TOML}\n[[effect]]\n{effect}\n")).unwrap();
        refused(folder.path(), &["check", "rig.toml"], parts);
        diagnosis_refused(folder.path(), "rig.toml", "A.csv", parts);
    }
    let folder = rig();
    refused(folder.path(), &["effects", "magnetism"], &["magnetism", "friction_coulomb"]);
    refused(folder.path(), &["demo", "--effect", "magnetism", "--out", "x"], &["magnetism"]);
}

#[test]
fn loops_that_cannot_be_closed() {
    let folder = rig_with_recordings();
    let robot = pkm_robots::find("five_bar").unwrap();
    let toml = robot.toml.replace("xyz = [0.35, 0.0, 0.0]", "xyz = [0.05, 0.0, 0.0]");
    fs::write(folder.path().join("open.toml"), toml).unwrap();
    fs::write(folder.path().join("five_bar.urdf"), robot.urdf).unwrap();
    let parts = &["open.toml", "loop \"pin\"", "open (limit 1e-9)"];
    refused(folder.path(), &["check", "open.toml"], parts);
    diagnosis_refused(folder.path(), "open.toml", "A.csv", parts);
    let free = robot.toml.split("[[loop]]").next().unwrap().to_string() + "[[actuator]]\njoint = \"shoulder_left\"\n";
    fs::write(folder.path().join("free.toml"), free).unwrap();
    refused(folder.path(), &["check", "free.toml"], &["free.toml", "4 degrees of freedom and 1 drives"]);
}

#[test]
fn files_that_are_not_there_and_folders_that_are() {
    let folder = rig_with_recordings();
    fs::create_dir(folder.path().join("dir.csv")).unwrap();
    diagnosis_refused(folder.path(), "rig.toml", "lost.csv", &["lost.csv", "No such file"]);
    diagnosis_refused(folder.path(), "lost.toml", "A.csv", &["lost.toml", "No such file"]);
    diagnosis_refused(folder.path(), "lost", "A.csv", &["lost", "no shipped robot", "prs3"]);
    diagnosis_refused(folder.path(), "rig.toml", "dir.csv", &["dir.csv", "a folder with 0 MCAP files"]);
    diagnosis_refused(folder.path(), ".", "A.csv", &[".", "a folder", "robot.toml"]);
    diagnosis_refused(folder.path(), "rig.toml", "rig.urdf", &["rig.urdf", ".csv, .mcap"]);
    refused(folder.path(), &["convert", "lost.csv", "x.mcap"], &["lost.csv"]);
    refused(folder.path(), &["convert", "A.csv", "no/such/x.mcap"], &["no/such/x.mcap"]);
    refused(folder.path(), &["convert", "A.csv", "x.txt"], &["x.txt"]);
    refused(folder.path(), &["convert", "A.csv", "A.csv"], &["A.csv", "same file"]);
    refused(folder.path(), &["convert", "A.mcap", "x.csv", "--robot", "rig.toml"], &["x.csv", ".mcap"]);
    refused(folder.path(), &["convert", "A.csv", "x.mcap", "--robot", "prs3"], &["A.csv", "q.q1"]);
}

#[test]
fn outputs_that_cannot_be_written() {
    let folder = rig_with_recordings();
    fs::create_dir(folder.path().join("dir.html")).unwrap();
    let base = ["diagnose", "rig.toml", "--recording", "A.csv"];
    for (more, parts) in [
        (vec!["--json", "no/such/out.json"], &["no/such/out.json", "no directory no/such"][..]),
        (vec!["--json", "out.json", "--html", "no/out.html"], &["no/out.html"]),
        (vec!["--html", "dir.html"], &["dir.html", "directory"]),
        (vec!["--json", "A.csv"], &["A.csv", "overwrite the input"]),
        (vec!["--json", "out.json", "--html", "./out.json"], &["out.json", "two outputs"]),
        (vec!["--refined", "rig.toml"], &["rig.toml", "overwrite the input"]),
        (vec!["--refined", "out.txt"], &["out.txt", ".toml"]),
    ] {
        refused(folder.path(), &[&base[..], &more].concat(), parts);
    }
}

#[test]
fn bad_usage() {
    let folder = rig_with_recordings();
    let base = ["diagnose", "rig.toml"];
    for (more, parts) in [
        (vec![], &["--recording"][..]),
        (vec!["--recording", "A.csv", "--colour"], &["--colour"]),
        (vec!["--recording", "A.csv", "--band", "-3"], &["-3"]),
        (vec!["--recording", "A.csv", "--band", "nan"], &["nan", "--band"]),
        (vec!["--recording", "A.csv", "--band", "9000"], &["9000", "Hz"]),
        (vec!["--recording", "A.csv", "--null-runs", "2"], &["2", "19..=9999"]),
        (vec!["--recording", "A.csv", "--floor", "2"], &["2", "--floor"]),
        (vec!["--recording", "A.csv", "--without", "friction_colomb"], &["friction_colomb", "--without"]),
        (vec!["--recording", "A.csv", "--without", "spring,grease"], &["grease", "--without"]),
        (vec!["--recording", "A.csv", "--recording", "./A.csv"], &["A.csv", "given twice"]),
        (vec!["--recording", "A.csv", "--holdout", "A.csv"], &["A.csv", "given twice"]),
        (vec!["--recording", "A.mcap", "--topic", "/nope"], &["A.mcap", "/nope"]),
    ] {
        refused(folder.path(), &[&base[..], &more].concat(), parts);
    }
    refused(folder.path(), &["dance"], &["dance"]);
    refused(folder.path(), &["demo", "--duration", "0.1", "--out", "x"], &["0.1", "4 to 600"]);
    refused(folder.path(), &["trial-null", "rig.toml", "--recording", "A.csv", "--runs", "0"], &["--runs"]);
}

#[test]
fn a_refusal_leaves_older_outputs_as_they_were() {
    let folder = with_bad(|first, lines| lines.truncate(first + 3));
    fs::write(folder.path().join("out.json"), "old").unwrap();
    diagnosis_refused(folder.path(), "rig.toml", "bad.csv", &["3 samples"]);
    assert_eq!(fs::read_to_string(folder.path().join("out.json")).unwrap(), "old");
}

#[test]
fn no_arguments_are_bad_usage_and_help_is_not() {
    let folder = rig();
    assert_eq!(pkm(folder.path(), &[]).status.code(), Some(2));
    for arguments in [&["--help"][..], &["diagnose", "--help"], &["--version"]] {
        assert!(pkm(folder.path(), arguments).status.success());
    }
    assert!(demo().is_dir());
}

#[test]
fn a_workspace_that_cannot_be_asked_for() {
    let folder = rig();
    for (robot, arguments, parts) in [
        ("ups3_rpu1", &["--axes", "x,nose"][..], &["\"nose\" is no coordinate", "q42"][..]),
        ("ups3_rpu1", &["--axes", "x,y"], &["y: it is fixed or follows"]),
        ("ups3_rpu1", &["--axes", "x,z,ry"], &["3 axes"]),
        ("ups3_rpu1", &["--axes", "x", "--at", "x=0"], &["\"x\" is named twice"]),
        ("ups3_rpu1", &["--link", "nose"], &["--link \"nose\"", "platform"]),
        ("ups3_rpu1", &["--link", "base"], &["does not move"]),
        ("ups3_rpu1", &["--cone", "nose=3"], &["--cone \"nose\"", "leg1"]),
        ("ups3_rpu1", &["--cone", "200"], &["between 0 and 180"]),
        ("ups3_rpu1", &["--range", "x=0:nan:5"], &["must be finite"]),
        ("ups3_rpu1", &["--range", "x=0:1:2000", "z=0:1:2000", "--slices", "ry=0:1:9"], &["36000000 cells (limit 4000000)"]),
        ("ups3_rpu1", &["--length", "0"], &["--length 0 m"]),
        ("ups3_rpu1", &["--singularity-limit", "nan"], &["--singularity-limit NaN"]),
        ("serial_arm", &[], &["determine 5 of 6 degrees of freedom"]),
        ("rig.toml", &["--axes", "j1", "--html", "rig.urdf"], &["would overwrite the input"]),
        ("rig.toml", &["--html", "no/such/w.html"], &["no directory"]),
    ] {
        let mut all = vec!["workspace", robot, "--csv", "w.csv"];
        all.extend(arguments);
        refused(folder.path(), &all, parts);
    }
}

#[test]
fn a_newcomers_mistakes_are_told_with_what_to_do() {
    let folder = rig_with_recordings();
    let at = folder.path();
    fs::create_dir(at.join("robot")).unwrap();
    refused(at, &["check", "./robot"], &["./robot: a folder", "there is no robot.toml in it"]);
    fs::copy(at.join("rig.toml"), at.join("robot/robot.toml")).unwrap();
    refused(at, &["check", "./robot"], &["a folder", "its robot is ./robot/robot.toml"]);
    // The robot.toml alone: the URDF that it names stayed behind.
    refused(at, &["check", "robot/robot.toml"], &["robot/rig.urdf: ", "robot/robot.toml names it"]);
    refused(at, &["check", "rig.urdf"], &["rig.urdf: a URDF alone is no robot", "robot.toml that names it"]);
    refused(at, &["check"], &["<ROBOT>", "(see `pkm check --help`)"]);
    refused(at, &["diagnose", "rig.toml", "--recoding", "A.csv"], &["--recording", "(see `pkm diagnose --help`)"]);
    refused(at, &["dignose"], &["dignose", "(see `pkm --help`)"]);
}

#[test]
fn columns_that_are_there_are_told() {
    let folder = with_bad(|first, lines| rename(first, lines, "tau.j1", "current.j1"));
    for verb in ["diagnose", "identify"] {
        refused(folder.path(), &[verb, "rig.toml", "--recording", "bad.csv"], &["no column \"tau.j1\"", "columns: current.j1, "]);
    }
    let folder = with_bad(|_, lines| lines.iter_mut().for_each(|line| *line = line.replace(',', ";")));
    diagnosis_refused(folder.path(), "rig.toml", "bad.csv", &["no column t, the time in seconds", "must be separated by commas"]);
}

#[test]
fn a_clock_in_milliseconds_is_doubted() {
    let folder = with_bad(|first, lines| {
        for line in &mut lines[first..] {
            let (t, rest) = line.split_once(',').unwrap();
            *line = format!("{},{rest}", 1e3 * t.parse::<f64>().unwrap());
        }
    });
    let output = pkm(folder.path(), &["diagnose", "rig.toml", "--recording", "bad.csv"]);
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(told.contains("note: bad.csv: ") && told.contains("are these milliseconds? t is in seconds"), "{told}");
    let output = pkm(folder.path(), &["diagnose", "rig.toml", "--recording", "bad.csv", "--quiet"]);
    assert!(output.stderr.is_empty() && output.stdout.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    let output = pkm(folder.path(), &["diagnose", "rig.toml", "--recording", "A.csv"]);
    assert!(!String::from_utf8(output.stderr).unwrap().contains("milliseconds"));
}

#[test]
fn without_a_verb_the_help_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let output = pkm(folder.path(), &[]);
    let told = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(told.contains("Look at a robot:") && told.contains("pkm VERB --help") && output.stdout.is_empty(), "{told}");
}

#[test]
fn links_that_weigh_nothing_are_named() {
    let folder = rig_with_recordings();
    let (from, to) = (RIG_URDF.find("<inertial>").unwrap(), RIG_URDF.find("</inertial>").unwrap() + "</inertial>".len());
    fs::write(folder.path().join("rig.urdf"), format!("{}{}", &RIG_URDF[..from], &RIG_URDF[to..])).unwrap();
    let told = prints(folder.path(), &["check", "rig.toml"]);
    assert!(told.contains("without mass, which the URDF's <inertial> gives: ") && told.contains("(moved by "), "{told}");
    let bare: Vec<&str> =
        RIG_URDF.split("<inertial>").enumerate().map(|(k, p)| if k == 0 { p } else { p.split_once("</inertial>").unwrap().1 }).collect();
    fs::write(folder.path().join("rig.urdf"), bare.concat()).unwrap();
    assert!(prints(folder.path(), &["check", "rig.toml"]).contains("nothing can be identified"));
}

#[test]
fn a_file_that_is_not_there_has_no_line() {
    let folder = rig();
    for arguments in [
        &["check", "nofile.toml"][..],
        &["simulate", "rig.toml", "--out", "A.csv", "--controller", "nofile.toml"],
        &["simulate", "rig.toml", "--out", "A.csv", "--world", "nofile.toml"],
        &["mu", "nofile.toml"],
        &["daemon", "nofile.toml"],
        &["daemon", "--check", "nofile.toml"],
        &["driver-sim", "nofile.toml"],
        &["order", "arm", "--config", "nofile.toml"],
        &["status", "--config", "nofile.toml"],
    ] {
        let output = pkm(folder.path(), arguments);
        let told = String::from_utf8(output.stderr).unwrap();
        assert!(told.lines().count() == 1 && told.contains("nofile.toml: No such file"), "{arguments:?}: {told}");
        assert!(output.status.code().is_some_and(|code| [2, 74, 78].contains(&code)), "{arguments:?}: {:?}", output.status);
    }
    // What is there and cannot be understood has one.
    fs::write(folder.path().join("bad.toml"), "robot = \"rig.toml\"\ncolour = 3\n").unwrap();
    let told = String::from_utf8(pkm(folder.path(), &["daemon", "bad.toml"]).stderr).unwrap();
    assert!(told.starts_with("error: bad.toml:2: "), "{told}");
}
