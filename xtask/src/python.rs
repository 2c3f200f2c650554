//! The wheel and its tests, in a virtual environment below the folder of build products.

use std::fs;
use std::path::{Path, PathBuf};

use crate::prerequisites::PYTHON_PROGRAM;
use crate::shell::{answer, cargo, program, root, run, target};

/// The build tool of the wheel.
const MATURIN: &str = "maturin>=1.9,<2";

/// Folder of the programs of the virtual environment, which is made if it is not there.
pub(crate) fn environment() -> Result<PathBuf, String> {
    let folder = target().join("venv");
    let programs = folder.join(if cfg!(windows) { "Scripts" } else { "bin" });
    if !programs.join(name("python")).is_file() {
        run(program(PYTHON_PROGRAM, &["-m", "venv"]).arg(&folder))?;
    }
    Ok(programs)
}

pub(crate) fn name(stem: &str) -> String {
    format!("{stem}{}", std::env::consts::EXE_SUFFIX)
}

/// Runs the environment's Python.
pub(crate) fn python(programs: &Path, arguments: &[&str]) -> Result<(), String> {
    run(&mut program(programs.join(name("python")), arguments))
}

/// What a line of Python prints.
pub(crate) fn printed(programs: &Path, code: &str) -> Result<String, String> {
    answer(&mut program(programs.join(name("python")), &["-c", code])).ok_or_else(|| format!("Python cannot run {code:?}"))
}

/// Installs packages into the environment.
pub(crate) fn install(programs: &Path, packages: &[&str]) -> Result<(), String> {
    let quiet = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
    python(programs, &[&quiet, packages].concat())
}

/// Builds the wheel with a cargo profile; its path.
pub(crate) fn build(programs: &Path, options: &[&str]) -> Result<PathBuf, String> {
    let manifest = root().join("python/pyproject.toml");
    if !manifest.is_file() {
        return Err("python/pyproject.toml is not there: the wheel cannot be built".to_string());
    }
    install(programs, &[MATURIN])?;
    let wheels = target().join("wheels");
    // An older version's wheel must not be mistaken for the new one.
    for old in wheels_in(&wheels) {
        fs::remove_file(&old).map_err(|e| format!("{}: {e}", old.display()))?;
    }
    let mut command = program(programs.join(name("maturin")), &["build", "--locked", "--manifest-path", "python/Cargo.toml", "--out"]);
    run(command.arg(&wheels).arg("--interpreter").arg(programs.join(name("python"))).args(options))?;
    wheels_in(&wheels).pop().ok_or_else(|| format!("maturin left no wheel in {}", wheels.display()))
}

fn wheels_in(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path());
    entries.filter(|p| p.extension().is_some_and(|e| e == "whl")).collect()
}

/// Builds the wheel, installs it with what its tests need.
fn installed(options: &[&str]) -> Result<PathBuf, String> {
    let programs = environment()?;
    let wheel = build(&programs, options)?.display().to_string();
    install(&programs, &["--force-reinstall", "--no-deps", &wheel])?;
    install(&programs, &[&format!("{wheel}[test]"), "pytest", "numpy"])?;
    Ok(programs)
}

/// Builds the wheel in the profile of the tests, installs it, runs its tests.
pub(crate) fn check() -> Result<(), String> {
    // The dev profile shares its compiled dependencies with the other tests; auditwheel is for wheels that travel.
    let programs = installed(&["--profile", "dev", "--auditwheel", "skip"])?;
    // What the wheel runs as a program of its own: the one that the other tests have built.
    run(&mut cargo("build --workspace --exclude pkm-python --exclude pkm-benches --features pkm-sim/rapier --locked --bin pkm"))?;
    let mut tests = program(programs.join(name("python")), &["-m", "pytest", "-q", "python/tests"]);
    run(tests.env("PKM_PROGRAM", target().join("debug").join(name("pkm"))))
}

/// Runs the notebooks, each from a clean kernel, with the optimised wheel; with their outputs they go into target/notebooks/.
pub(crate) fn notebooks() -> Result<(), String> {
    let programs = installed(&["--release", "--auditwheel", "skip"])?;
    let out = target().join("notebooks");
    python(&programs, &["python/notebooks/execute.py", "--out", &out.display().to_string()])
}
