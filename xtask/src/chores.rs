//! The commands besides `test`: long runs, benches, the wheel to publish, golden files.

use std::fs;
use std::path::Path;

use crate::shell::{answer, cargo, program, root, run};
use crate::{guide, python};

/// Version of Pinocchio the golden files are made with, and the one that is measured against.
pub(crate) const PINOCCHIO: &str = "pin==4.1.0";

/// Name of the notebooks among the files of `long`.
const NOTEBOOKS: &str = "notebooks";

/// Name of the tests of the binary's processes among them.
const DAEMON: &str = "daemon";

/// Runs the cross-crate tests with many seeds, or those of the files named; they read `PKM_LONG`, and write tables into the folder
/// `PKM_RESULTS`, each under the commit in `PKM_COMMIT`.
///
/// `notebooks` among the names are those of python/notebooks/; without names they run as well.
pub(crate) fn long(only: &[&str]) -> Result<(), String> {
    let files: Vec<&str> = only.iter().copied().filter(|name| *name != NOTEBOOKS).collect();
    if files.len() < only.len() {
        python::notebooks()?;
        if files.is_empty() {
            return Ok(());
        }
    }
    let results = root().join("docs/results");
    fs::create_dir_all(&results).map_err(|e| format!("{}: {e}", results.display()))?;
    let commit = commit();
    println!("   commit {commit}, tables go to docs/results/");
    let mut command = cargo("test --release --locked -p pkm-tests --no-fail-fast");
    let of_tests: Vec<&&str> = files.iter().filter(|name| **name != DAEMON).collect();
    of_tests.iter().for_each(|name| {
        command.args(["--test", name]);
    });
    if only.is_empty() || !of_tests.is_empty() {
        run(command.env("PKM_LONG", "1").env("PKM_RESULTS", &results).env("PKM_COMMIT", &commit))?;
    }
    if only.is_empty() || files.contains(&DAEMON) {
        // Two hundred killed starts, a hundred armings, ten minutes at 1 kHz.
        let mut command = cargo("test --release --locked -p pkm --test daemon");
        run(command.env("PKM_LONG", "1").env("PKM_RESULTS", &results).env("PKM_COMMIT", &commit))?;
    }
    if !only.is_empty() {
        return Ok(());
    }
    python::notebooks()?;
    guide::run_commands(&[])?;
    prove(&results, &commit)
}

/// The blind trials of docs/PROOF.md in full; a run that was stopped goes on when the commit is the same.
fn prove(results: &Path, commit: &str) -> Result<(), String> {
    let out = root().join("target/proof").join(commit);
    let mut command = cargo("run --release --locked -p pkm -- prove --cases 1200 --seed 1 --jobs 2 --resume --quiet --out");
    run(command.arg(&out))?;
    let table = fs::read_to_string(out.join("results.md")).map_err(|e| format!("{}: {e}", out.display()))?;
    let path = results.join("prove.md");
    fs::write(&path, format!("commit {commit}\n\n{table}")).map_err(|e| format!("{}: {e}", path.display()))
}

/// Short id of the commit, marked when files differ from it.
pub(crate) fn commit() -> String {
    let git = |arguments: &[&str]| answer(&mut program("git", arguments));
    let Some(id) = git(&["rev-parse", "--short=12", "HEAD"]) else { return "unknown".to_string() };
    let is_clean = git(&["status", "--porcelain"]).is_some_and(|lines| lines.is_empty());
    if is_clean { id } else { format!("{id}+changes") }
}

/// Runs the benches.
pub(crate) fn bench(rest: &[&str]) -> Result<(), String> {
    run(cargo("bench --locked -p pkm-benches").args(rest))
}

/// Builds the wheel to publish.
pub(crate) fn wheel() -> Result<(), String> {
    let programs = python::environment()?;
    let wheel = python::build(&programs, &["--release"])?;
    println!("   {}", wheel.display());
    Ok(())
}

/// Writes the golden files anew.
pub(crate) fn golden() -> Result<(), String> {
    let programs = python::environment()?;
    python::install(&programs, &[PINOCCHIO, "numpy"])?;
    // The last reads what the first writes.
    for script in ["make_golden.py", "make_dynamics.py", "make_loops.py"] {
        python::python(&programs, &[&format!("tests/golden/pinocchio/{script}")])?;
    }
    Ok(())
}
