//! `cargo xtask peers`, `slicot`, `identify-peers`, `plants`, `fleet` and `prove-baselines`: this project and others measured in one run; all but the last
//! write their table in benches/README.md anew.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::chores::{PINOCCHIO, commit};
use crate::python;
use crate::shell::{answer, cargo, output, program, root, run, target};

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

/// The other side of μ.
const SLYCOT: &str = "slycot==0.7.1";

/// The other sides of identification.
const IDENTIFIERS: [&str; 6] = [PINOCCHIO, "numpy", "scipy==1.17.1", "cvxpy==1.9.3", "clarabel==0.11.1", "figaroh==1.0.2"];

/// Other methods on the blind trials.
const METHODS: [&str; 4] = ["numpy", "scipy==1.17.1", "scikit-learn==1.9.1", "pysindy==2.1.0"];

/// A table of benches/README.md stands between a mark that names its command and this one.
pub(crate) const END: &str = "<!-- end -->";

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
    publish("peers", &format!("{}\n\n{text}", head(PINOCCHIO, how)))
}

/// Builds and installs the wheel, optimised, runs it beside SLICOT, and writes the table; an argument is the number of problems.
pub(crate) fn slicot(rest: &[&str]) -> Result<(), String> {
    let n = rest.first().copied().unwrap_or("2000");
    let programs = installed(&[SLYCOT, "numpy"])?;
    let table = target().join("slicot.md");
    python::python(&programs, &["tests/golden/slicot/ab13md.py", "compare", n, &table.display().to_string()])?;
    let text = fs::read_to_string(&table).map_err(|e| format!("{}: {e}", table.display()))?;
    publish("slicot", &format!("{}\n\n{text}", head(SLYCOT, "wheels called from Python, not pinned, ordinary scheduler")))
}

/// Builds and installs the wheel, optimised, identifies an arm with it and with its peers, and writes the table; an argument is the
/// number of rounds.
pub(crate) fn identify(rest: &[&str]) -> Result<(), String> {
    let rounds = rest.first().copied().unwrap_or("3");
    let programs = installed(&IDENTIFIERS)?;
    let table = target().join("identify.md");
    python::python(&programs, &["benches/identification/compare.py", "robots/serial_arm", &table.display().to_string(), rounds])?;
    let text = fs::read_to_string(&table).map_err(|e| format!("{}: {e}", table.display()))?;
    publish("identify-peers", &format!("{}\n\n{text}", head(&IDENTIFIERS.join(", "), "not pinned, ordinary scheduler")))
}

/// What a fleet needs besides the wheel; the names that the wheel itself states.
const FLEET: &str = "pkm[fleet]";

/// Builds and installs the wheel, optimised, lets it diagnose in one process and on a cluster of this machine in turn, and writes the table; arguments are
/// the numbers of tasks and of rounds.
pub(crate) fn fleet(rest: &[&str]) -> Result<(), String> {
    let (tasks, rounds) = (rest.first().copied().unwrap_or("16"), rest.get(1).copied().unwrap_or("3"));
    let programs = installed(&["numpy", FLEET])?;
    let bench = ["-m", "pkm.fleet", "--bench", "--tasks", tasks, "--rounds", rounds];
    let text = output(&mut program(programs.join(python::name("python")), &bench))?;
    publish("fleet", &format!("{}\n\n{}", head("dask, distributed", "not pinned, ordinary scheduler"), text.trim_end()))
}

/// Lengths of a millisecond in the own plant and in the engine rapier: the beginnings of criterion's names.
const PLANTS: [&str; 2] = ["1 ms of ReducedPlant_", "1 ms of RapierPlant_"];

/// Runs the bench of plants and writes the table; arguments go to criterion (`-- --quick`).
pub(crate) fn plants(rest: &[&str]) -> Result<(), String> {
    run(cargo("bench --locked -p pkm-benches --bench plants").args(rest))?;
    let folder = target().join("criterion");
    let entries = fs::read_dir(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let names: Vec<String> = entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    let mut robots: Vec<&str> = names.iter().filter_map(|n| n.strip_prefix(PLANTS[0])).collect();
    robots.sort_unstable();
    let mut text = "| robot | what | pkm, us | rapier, us | ours / theirs |\n|---|---|---|---|---|\n".to_string();
    for robot in robots.into_iter().filter(|r| names.iter().any(|n| n.strip_prefix(PLANTS[1]) == Some(*r))) {
        let [ours, theirs] = PLANTS.map(|plant| median_ns(&folder.join(format!("{plant}{robot}/new/estimates.json"))));
        let (ours, theirs) = (ours? / 1e3, theirs? / 1e3);
        text += &format!("| {robot} | 1 ms | {ours:.2} | {theirs:.2} | {:.2} |\n", ours / theirs);
    }
    publish("plants", &format!("{}\n\n{text}", head("rapier3d-f64 (Cargo.lock)", "one thread, not pinned, ordinary scheduler")))
}

/// The median that criterion left in a file `[ns]`.
fn median_ns(path: &Path) -> Result<f64, String> {
    let text = fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    median(&text).ok_or_else(|| format!("{}: no median", path.display()))
}

/// The point estimate of the median in criterion's JSON.
fn median(text: &str) -> Option<f64> {
    let (_, rest) = text.split_once("\"median\":")?;
    let (_, rest) = rest.split_once("\"point_estimate\":")?;
    rest.split([',', '}']).next()?.trim().parse().ok()
}

/// Builds and installs the wheel, optimised, lets other methods diagnose the cases of a folder that `pkm prove` made, and scores everything again; further
/// arguments are names of methods.
pub(crate) fn prove_baselines(rest: &[&str]) -> Result<(), String> {
    let folder = rest.first().ok_or("prove-baselines: which folder of `pkm prove`?")?;
    let programs = installed(&METHODS)?;
    python::python(&programs, &[&["benches/trials/baselines.py"], rest].concat())?;
    run(cargo("run --release --locked -p pkm -- prove --score-only --out").arg(folder))
}

/// The environment with the wheel, optimised, and with packages.
fn installed(packages: &[&str]) -> Result<PathBuf, String> {
    let programs = python::environment()?;
    let wheel = python::build(&programs, &["--release", "--auditwheel", "skip"])?.display().to_string();
    python::install(&programs, &["--force-reinstall", "--no-deps", &wheel])?;
    python::install(&programs, packages)?;
    Ok(programs)
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
pub(crate) fn head(peer: &str, how: &str) -> String {
    let first = |text: Option<String>| text.and_then(|t| t.lines().next().map(str::to_string)).unwrap_or_else(|| "unknown".to_string());
    let processor = fs::read_to_string("/proc/cpuinfo").ok().and_then(|text| {
        let line = text.lines().find(|l| l.starts_with("model name"))?.to_string();
        line.split_once(':').map(|(_, name)| name.trim().to_string())
    });
    format!(
        "{}, {how}; {}; {}; {peer}; commit {}, {}.",
        first(processor),
        first(answer(&mut program("rustc", &["--version"]))),
        first(answer(&mut program(compiler(), &["--version"]))),
        commit(),
        first(answer(&mut program("date", &["-u", "+%F"]))),
    )
}

/// The page of tables: benches/README.md, or the copy that `PKM_BENCH_TABLES` names, where a short run leaves the real one alone.
pub(crate) fn tables() -> PathBuf {
    std::env::var_os(TABLES).map_or_else(|| root().join("benches/README.md"), PathBuf::from)
}

/// Names another page of tables.
pub(crate) const TABLES: &str = "PKM_BENCH_TABLES";

/// Puts the text between the marks of a command in the page of tables.
pub(crate) fn publish(command: &str, text: &str) -> Result<(), String> {
    let path = tables();
    let old = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let begin = format!("<!-- cargo xtask {command} -->");
    let new = between(&old, &begin, text).ok_or_else(|| format!("{}: no {begin:?} and {END:?} after it", path.display()))?;
    fs::write(&path, new).map_err(|e| format!("{}: {e}", path.display()))
}

/// `old` with what stands between the marks replaced.
pub(crate) fn between(old: &str, begin: &str, text: &str) -> Option<String> {
    let (before, rest) = old.split_once(begin)?;
    let (_, after) = rest.split_once(END)?;
    Some(format!("{before}{begin}\n{}\n{END}{after}", text.trim_end()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_read_from_criterions_file() {
        let text = r#"{"mean":{"confidence_interval":{"lower_bound":1.0},"point_estimate":2.0},"median":{"confidence_interval":
            {"confidence_level":0.95,"lower_bound":3.0,"upper_bound":5.0},"point_estimate":4127.25,"standard_error":0.1},"slope":null}"#;
        assert_eq!(median(text), Some(4127.25));
        assert_eq!(median("{}"), None);
    }

    #[test]
    fn only_what_stands_between_the_marks_is_replaced() {
        let old = "a\n<!-- x -->\nother\n<!-- end -->\n<!-- y -->\nold\n<!-- end -->\nb\n";
        let new = "a\n<!-- x -->\nother\n<!-- end -->\n<!-- y -->\nnew\n<!-- end -->\nb\n";
        assert_eq!(between(old, "<!-- y -->", "new\n").as_deref(), Some(new));
        assert_eq!(between("<!-- end --> <!-- y -->", "<!-- y -->", "new"), None);
    }
}
