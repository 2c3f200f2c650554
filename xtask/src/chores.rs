//! The commands besides `test`: long runs, benches, the wheel to publish, golden files.

use std::fs;
use std::path::Path;

use crate::shell::{answer, cargo, program, root, run};
use crate::{guide, python};

/// Version of Pinocchio the golden files are made with, and the one that is measured against.
pub(crate) const PINOCCHIO: &str = "pin==4.1.0";

/// What measurements write, as git leaves it out.
const TABLES: [&str; 3] = [":(exclude)benches/README.md", ":(exclude)docs/BENCHES.md", ":(exclude)docs/results"];

/// Names among those of `long` that are no test files: the notebooks, the tests of the binary's processes, the blind trials.
const OTHERS: [&str; 3] = [NOTEBOOKS, DAEMON, PROVE];
const NOTEBOOKS: &str = "notebooks";
const DAEMON: &str = "daemon";
const PROVE: &str = "prove";

/// Runs the cross-crate tests with many seeds, the notebooks, every command of the guide and of README.md and the blind trials, and
/// builds the book; or what is named. Tests read `PKM_LONG`, and write tables into the folder `PKM_RESULTS`, each under the commit in
/// `PKM_COMMIT`.
pub(crate) fn long(only: &[&str]) -> Result<(), String> {
    let wants = |name: &str| only.is_empty() || only.contains(&name);
    let results = root().join("docs/results");
    fs::create_dir_all(&results).map_err(|e| format!("{}: {e}", results.display()))?;
    if only.is_empty() {
        // Not after hours.
        guide::needs_book()?;
    }
    let commit = commit();
    println!("   commit {commit}, tables go to docs/results/");
    let tests: Vec<&str> = only.iter().copied().filter(|name| !OTHERS.contains(name)).collect();
    if only.is_empty() || !tests.is_empty() {
        let mut command = cargo("test --release --locked -p pkm-tests --no-fail-fast");
        tests.iter().for_each(|name| {
            command.args(["--test", name]);
        });
        run(command.env("PKM_LONG", "1").env("PKM_RESULTS", &results).env("PKM_COMMIT", &commit))?;
    }
    if wants(DAEMON) {
        // Two hundred killed starts, a hundred armings, ten minutes at 1 kHz.
        let mut command = cargo("test --release --locked -p pkm --test daemon");
        run(command.env("PKM_LONG", "1").env("PKM_RESULTS", &results).env("PKM_COMMIT", &commit))?;
    }
    if wants(NOTEBOOKS) {
        python::notebooks()?;
    }
    if only.is_empty() {
        guide::guide(&[])?;
    }
    if wants(PROVE) {
        prove(&results, &commit)?;
    }
    Ok(())
}

/// Seed of the blind trials; a run that is to be published has one that nobody has looked at.
const SEED: &str = "9309";

/// The blind trials of docs/PROOF.md in full: 300 healthy robots, 100 with two effects, 100 with physics outside the catalogue, 500 at L2 and L3 of
/// which 200 have size 2. A run that was stopped goes on; cases stay when the commit is another, verdicts do not.
fn prove(results: &Path, commit: &str) -> Result<(), String> {
    let out = root().join("target/proof").join(SEED);
    let failed = |e: std::io::Error| format!("{}: {e}", out.display());
    let judged_by = out.join("commit");
    if fs::read_to_string(&judged_by).ok().as_deref() != Some(commit) {
        for old in ["runs", "verdicts"].map(|name| out.join(name)).iter().filter(|old| old.exists()) {
            fs::remove_dir_all(old).map_err(failed)?;
        }
        fs::create_dir_all(&out).and_then(|()| fs::write(&judged_by, commit)).map_err(failed)?;
    }
    let mut command = cargo("run --release --locked -p pkm -- prove --cases 1200 --jobs 2 --resume --quiet --seed");
    let sizes = ["0.5", "1", "2", "2", "4"].map(|size| ["--size", size]);
    run(command.arg(SEED).args(sizes.as_flattened()).arg("--out").arg(&out))?;
    let table = fs::read_to_string(out.join("results.md")).map_err(failed)?;
    let pictures = results.join("prove.html");
    fs::copy(out.join("results.html"), &pictures).map_err(|e| format!("{}: {e}", pictures.display()))?;
    let path = results.join("prove.md");
    fs::write(&path, format!("commit {commit}\n\n{table}")).map_err(|e| format!("{}: {e}", path.display()))
}

/// Short id of the commit, marked when files differ from it; the tables that measurements themselves write are no difference.
pub(crate) fn commit() -> String {
    let git = |arguments: &[&str]| answer(&mut program("git", arguments));
    let Some(id) = git(&["rev-parse", "--short=12", "HEAD"]) else { return "unknown".to_string() };
    let is_clean = git(&[&["status", "--porcelain", "--", "."], &TABLES[..]].concat()).is_some_and(|lines| lines.is_empty());
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
