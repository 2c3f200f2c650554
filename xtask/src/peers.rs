//! `cargo xtask peers`: pkm-dyn and Pinocchio's C++ measured in one run, and the table in benches/README.md written anew.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::chores::{PINOCCHIO, commit};
use crate::python;
use crate::shell::{answer, cargo, program, root, run, target};

/// The other side's source.
const SOURCE: &str = "benches/pinocchio/peer.cpp";

/// What the wheel's own build files define for those who use its headers.
const DEFINES: [&str; 4] = [
    "-DBOOST_MPL_LIMIT_LIST_SIZE=30",
    "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30",
    "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
    "-DBOOST_FUSION_INVOKE_MAX_ARITY=12",
];

/// Columns of the table, and what the compiler is told for each.
const COLUMNS: [(&str, &[&str]); 2] = [("Pinocchio", &[]), ("Pinocchio, -march=native", &["-march=native"])];

/// The table stands between these two in benches/README.md.
const MARKS: [&str; 2] = ["<!-- cargo xtask peers -->", "<!-- end -->"];

/// Installs Pinocchio's headers, compiles both sides, measures, and writes the table.
pub(crate) fn peers(rest: &[&str]) -> Result<(), String> {
    let programs = python::environment()?;
    python::install(&programs, &[PINOCCHIO, "cmeel-eigen"])?;
    let prefix = python::printed(&programs, "import sysconfig; print(sysconfig.get_path('purelib'))")?;
    let folder = target().join("peers");
    fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let table = folder.join("table.md");
    let mut arguments = vec!["--folder".to_string(), folder.display().to_string(), "--table".into(), table.display().to_string()];
    for (k, (name, options)) in COLUMNS.iter().enumerate() {
        let compiled = compile(&Path::new(&prefix).join("cmeel.prefix/include"), &folder.join(format!("peer{k}")), options)?;
        arguments.extend(["--peer".to_string(), format!("{name}={}", compiled.display())]);
    }
    run(&mut cargo("build --release --locked -p pkm-benches --bin peers"))?;
    let (mut command, how) = undisturbed(&target().join("release/peers"));
    run(command.args(arguments).args(rest))?;
    let text = fs::read_to_string(&table).map_err(|e| format!("{}: {e}", table.display()))?;
    publish(&format!("{}\n\n{text}", head(how)))
}

fn compiler() -> String {
    std::env::var("CXX").unwrap_or_else(|_| "g++".to_string())
}

/// Compiles the other side, unless that is newer than its source; headers are all it needs, so that nothing is linked.
fn compile(include: &Path, out: &Path, options: &[&str]) -> Result<PathBuf, String> {
    let age = |path: &Path| fs::metadata(path).and_then(|m| m.modified()).ok();
    if age(out).is_some_and(|built| age(&root().join(SOURCE)).is_some_and(|source| built > source)) {
        return Ok(out.to_path_buf());
    }
    let mut command = program(compiler(), &["-std=c++17", "-O3", "-DNDEBUG", "-Wno-deprecated-declarations"]);
    command.args(DEFINES).args(options).arg("-isystem").arg(include).arg("-isystem").arg(include.join("eigen3"));
    run(command.arg(SOURCE).arg("-o").arg(out))?;
    Ok(out.to_path_buf())
}

/// The command on one core under the real-time scheduler, where that is permitted, and a word about it.
fn undisturbed(path: &Path) -> (Command, &'static str) {
    let core = std::thread::available_parallelism().map_or(0, |n| n.get() - 1).to_string();
    let pinned = ["-f", "20", "taskset", "-c", core.as_str()];
    if answer(program("chrt", &pinned).arg("true")).is_some() {
        let mut command = program("chrt", &pinned);
        command.arg(path);
        (command, "one core, real-time scheduler")
    } else {
        (program(path, &[]), "not pinned, ordinary scheduler")
    }
}

/// Where, when and with what the numbers were measured.
fn head(how: &str) -> String {
    let first = |text: Option<String>| text.and_then(|t| t.lines().next().map(str::to_string)).unwrap_or_else(|| "unknown".to_string());
    let processor = fs::read_to_string("/proc/cpuinfo").ok().and_then(|text| {
        let line = text.lines().find(|l| l.starts_with("model name"))?.to_string();
        line.split_once(':').map(|(_, name)| name.trim().to_string())
    });
    format!(
        "{}, {how}; {}; {}; {PINOCCHIO}; commit {}, {}.",
        first(processor),
        first(answer(&mut program("rustc", &["--version"]))),
        first(answer(&mut program(compiler(), &["--version"]))),
        commit(),
        first(answer(&mut program("date", &["-u", "+%F"]))),
    )
}

/// Puts the text between the marks of benches/README.md.
fn publish(text: &str) -> Result<(), String> {
    let path = root().join("benches/README.md");
    let old = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let new = between(&old, text).ok_or_else(|| format!("{}: no {:?} and {:?} after it", path.display(), MARKS[0], MARKS[1]))?;
    fs::write(&path, new).map_err(|e| format!("{}: {e}", path.display()))
}

/// `old` with what stands between the marks replaced.
fn between(old: &str, text: &str) -> Option<String> {
    let (before, rest) = old.split_once(MARKS[0])?;
    let (_, after) = rest.split_once(MARKS[1])?;
    Some(format!("{before}{}\n{}\n{}{after}", MARKS[0], text.trim_end(), MARKS[1]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_stands_between_the_marks_is_replaced() {
        let old = "a\n<!-- cargo xtask peers -->\nold\n<!-- end -->\nb\n";
        assert_eq!(between(old, "new\n").as_deref(), Some("a\n<!-- cargo xtask peers -->\nnew\n<!-- end -->\nb\n"));
        assert_eq!(between("<!-- end --> <!-- cargo xtask peers -->", "new"), None);
    }
}
