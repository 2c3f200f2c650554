//! The command under test, a small robot, and recordings of it: all made here, nothing recorded anywhere.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use tempfile::TempDir;

/// Runs `pkm` with `folder` as the current one.
pub(crate) fn pkm(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pkm")).args(arguments).current_dir(folder).env("NO_COLOR", "1").output().expect("pkm runs")
}

/// What a successful run printed.
pub(crate) fn prints(folder: &Path, arguments: &[&str]) -> String {
    let output = pkm(folder, arguments);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{arguments:?}: {told}");
    String::from_utf8(output.stdout).expect("UTF-8")
}

/// Names of everything in a folder.
pub(crate) fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// `pkm` refuses: exit 2, nothing on standard output, one line on standard error with all of `parts`, and no file comes or goes.
pub(crate) fn refused(folder: &Path, arguments: &[&str], parts: &[&str]) {
    let before = names(folder);
    let output = pkm(folder, arguments);
    let told = String::from_utf8(output.stderr).expect("UTF-8");
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {told}");
    assert_eq!((told.lines().count(), told.starts_with("error: ")), (1, true), "{told}");
    assert_eq!(told.chars().filter(|c| c.is_control()).count(), 1, "{told:?}");
    for part in parts {
        assert!(told.contains(part), "{told} lacks {part:?}");
    }
    assert!(output.stdout.is_empty(), "{:?}", String::from_utf8_lossy(&output.stdout));
    assert_eq!(names(folder), before, "{arguments:?}");
}

pub(crate) const RIG_TOML: &str = "name = \"rig\"\nurdf = \"rig.urdf\"\n\n[[actuator]]\njoint = \"j1\"\nrotor_inertia = 0.05\n\n[[actuator]]\njoint = \"j2\"\nrotor_inertia = 0.02\n";

pub(crate) const RIG_URDF: &str = r#"<robot name="rig"><link name="base"/>
<link name="arm"><inertial><origin xyz="0.15 0 0"/><mass value="2"/>
<inertia ixx="0.002" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
<link name="hand"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
<inertia ixx="0.001" ixy="0" ixz="0" iyy="0.005" iyz="0" izz="0.005"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-1.2" upper="1.2" velocity="6" effort="80"/><dynamics damping="0.4" friction="0.5"/></joint>
<joint name="j2" type="revolute"><parent link="arm"/><child link="hand"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
<limit lower="-1.4" upper="1.4" velocity="6" effort="40"/><dynamics damping="0.2" friction="0.3"/></joint></robot>
"#;

/// A folder with rig.toml and rig.urdf.
pub(crate) fn rig() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("rig.toml"), RIG_TOML).unwrap();
    fs::write(folder.path().join("rig.urdf"), RIG_URDF).unwrap();
    folder
}

/// A demo of the rig with dry friction concealed: made once, copied by those who change it.
pub(crate) fn demo() -> &'static Path {
    static DEMO: OnceLock<TempDir> = OnceLock::new();
    let folder = DEMO.get_or_init(|| {
        let folder = rig();
        let told =
            pkm(folder.path(), &["demo", "--robot", "rig.toml", "--effect", "friction_coulomb", "--duration", "10", "--out", "demo"]);
        fs::write(folder.path().join("told.txt"), &told.stdout).unwrap();
        assert!(matches!(told.status.code(), Some(0 | 1)), "{}", String::from_utf8_lossy(&told.stderr));
        folder
    });
    folder.path()
}

/// A folder with the rig and its two recordings as CSV and MCAP: A and B.
pub(crate) fn rig_with_recordings() -> TempDir {
    let folder = rig();
    for (from, to) in [("motion1", "A"), ("motion2", "B")] {
        let source = demo().join("demo").join(format!("{from}.mcap"));
        let mcap = folder.path().join(format!("{to}.mcap"));
        fs::copy(source, &mcap).unwrap();
        prints(folder.path(), &["convert", &format!("{to}.mcap"), &format!("{to}.csv")]);
    }
    folder
}

/// The lines of a CSV file: how many come before the data, and all of them.
pub(crate) fn csv_lines(path: &PathBuf) -> (usize, Vec<String>) {
    let text = fs::read_to_string(path).unwrap();
    let lines: Vec<String> = text.lines().map(str::to_string).collect();
    let header = lines.iter().position(|l| l.starts_with("t,")).unwrap();
    (header + 1, lines)
}
