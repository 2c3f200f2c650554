//! `cargo xtask test`: the steps of CI in order, stopping at the first failure.

use core::time::Duration;

use crate::shell::{cargo, run, timed};
use crate::{nostd, prerequisites, python};

/// One step: what it is called, what it is for, what it does.
struct Step {
    name: &'static str,
    says: &'static str,
    work: fn() -> Result<(), String>,
}

const STEPS: [Step; 8] = [
    Step { name: "prerequisites", says: "Rust, a C compiler, Python with venv", work: prerequisites::check },
    Step { name: "fmt", says: "formatting", work: fmt },
    Step { name: "clippy", says: "lints, warnings are errors", work: clippy },
    Step { name: "tests", says: "unit and cross-crate tests", work: tests },
    Step { name: "doctests", says: "examples in the documentation", work: doctests },
    Step { name: "doc", says: "documentation, warnings are errors", work: doc },
    Step {
        name: "nostd",
        says: "crates of the control loop without std, and run without an operating system's library",
        work: nostd::check,
    },
    Step { name: "python", says: "wheel, installed in a virtual environment, and its tests", work: python::check },
];

/// Prints the steps, one per line.
pub(crate) fn list() {
    for step in &STEPS {
        println!("  {:14} {}", step.name, step.says);
    }
}

/// Runs the named steps of CI, or all of them.
pub(crate) fn run_steps(only: &[&str]) -> Result<(), String> {
    run_in_order(only, &STEPS)
}

fn run_in_order(only: &[&str], steps: &[Step]) -> Result<(), String> {
    if let Some(unknown) = only.iter().find(|name| !steps.iter().any(|s| s.name == **name)) {
        return Err(format!("no step {unknown:?}; `cargo xtask` alone lists them"));
    }
    let chosen: Vec<&Step> = steps.iter().filter(|s| only.is_empty() || only.contains(&s.name)).collect();
    let mut done: Vec<(&str, Duration)> = Vec::new();
    for (i, step) in chosen.iter().enumerate() {
        println!("== {}/{} {}: {}", i + 1, chosen.len(), step.name, step.says);
        let (outcome, duration) = timed(step.work);
        println!("   {}: {:.1} s", step.name, duration.as_secs_f64());
        outcome.map_err(|reason| format!("step {} failed: {reason}", step.name))?;
        done.push((step.name, duration));
    }
    println!();
    for (name, duration) in &done {
        println!("{name:14} {:8.1} s", duration.as_secs_f64());
    }
    println!("{:14} {:8.1} s", "total", done.iter().map(|d| d.1.as_secs_f64()).sum::<f64>());
    println!("{}", if only.is_empty() { "all steps passed" } else { "the named steps passed" });
    Ok(())
}

fn fmt() -> Result<(), String> {
    run(&mut cargo("fmt --all --check"))?;
    // Its own workspace, so `--all` passes it by.
    run(&mut cargo("fmt --check --manifest-path tools/nostd-proof/Cargo.toml"))
}

fn clippy() -> Result<(), String> {
    run(&mut cargo("clippy --workspace --all-targets --all-features --locked -- -D warnings"))
}

/// The plant in a foreign engine is behind a feature. The same features for both steps: dependencies compile once.
const TESTED: &str = "test --workspace --exclude pkm-python --exclude pkm-benches --features pkm-sim/rapier --locked";

// One profile for everything that runs: dev, whose dependencies are optimised. They compile once.
fn tests() -> Result<(), String> {
    run(&mut cargo(&format!("{TESTED} --lib --bins --tests")))
}

fn doctests() -> Result<(), String> {
    run(&mut cargo(&format!("{TESTED} --doc")))
}

fn doc() -> Result<(), String> {
    // The same features as clippy: what it checked is used again.
    run(cargo("doc --workspace --no-deps --all-features --locked").env("RUSTDOCFLAGS", "-D warnings"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(name: &'static str, work: fn() -> Result<(), String>) -> Step {
        Step { name, says: "", work }
    }

    #[test]
    fn the_first_failure_stops_the_run_and_is_named() {
        let steps =
            [step("one", || Ok(())), step("two", || Err("out of cheese".to_string())), step("three", || panic!("a step after a failure"))];
        assert_eq!(run_in_order(&[], &steps), Err("step two failed: out of cheese".to_string()));
    }

    #[test]
    fn named_steps_run_alone_and_a_misspelt_one_is_refused() {
        let steps = [step("one", || Ok(())), step("two", || panic!("not asked for"))];
        assert_eq!(run_in_order(&["one"], &steps), Ok(()));
        assert!(run_in_order(&["oen"], &steps).is_err());
    }
}
