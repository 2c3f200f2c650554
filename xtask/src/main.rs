//! `cargo xtask`: everything CI runs, and the other chores of the repository. Needs nothing beyond the standard library.
#![expect(clippy::print_stdout, clippy::print_stderr, reason = "a command for the terminal")]

extern crate alloc;

mod atlas;
mod benches;
mod blocks;
mod checks;
mod chores;
mod guide;
mod latency;
mod nostd;
mod package;
mod peers;
mod picture;
mod prerequisites;
mod python;
mod screen;
mod shell;
mod times;
mod viewers;

use std::process::ExitCode;

const USAGE: &str = "\
cargo xtask test [STEP ...]   everything CI runs, in order, up to the first failure; or only the steps named
cargo xtask long [TEST ...]   the long tier: PKM_LONG=1, the notebooks, every command of the guide and of README.md, the book, 1200 blind trials, tables into docs/results/; or only what is named (a test file such as `fuzz`; `daemon`, `notebooks`, `prove`)
cargo xtask bench [ARGS ...]  the benches; arguments go to criterion (`-- --quick`, a name)
cargo xtask peers [ARGS ...]  pkm-dyn and Pinocchio's C++ in one run, into benches/README.md (`--rounds N`)
cargo xtask slicot [N]        μ beside SLICOT's AB13MD on N problems in one run, into benches/README.md
cargo xtask identify-peers [N]  identification beside Pinocchio, scipy and cvxpy, best of N rounds, into benches/README.md
cargo xtask plants [ARGS ...] a millisecond of simulation beside the engine rapier, into benches/README.md; arguments go to criterion
cargo xtask fleet [N [ROUNDS]]  N diagnoses in one process and on a cluster of this machine, into benches/README.md
cargo xtask benches [--table | --short]  all of these and `latency` in turn, their ratios into docs/BENCHES.md; the ratios alone; or a try that writes neither
cargo xtask diagnose-times [S ...]  a diagnosis of a six-axis arm over recordings of so many seconds: time and memory, into benches/README.md
cargo xtask prove-baselines DIR [NAME ...]  other methods on the blind trials that `pkm prove` made in DIR, scored beside the diagnosis
cargo xtask package [--no-verify] [--no-wheel]  all that publishing does but the upload: every crate in order, and the wheel
cargo xtask atlas [EFFECT ...]  numbers and pictures of the guide's pages on effects
cargo xtask guide [--write] [PAGE ...]  every command of the guide and of README.md, each text in a folder of its own, and the book; or of the texts named; --write puts what they print into the pages, and their pictures
cargo xtask latency [S]       wake-ups, computing, shared memory there and back, idle and loaded, into benches/README.md
cargo xtask wheel             the Python wheel, optimised, into target/wheels/
cargo xtask golden            the golden files of tests/, anew, with Pinocchio

steps of `test`, in order:";

/// What is asked for before a command's own arguments are read.
const HELP: [&str; 2] = ["--help", "-h"];

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let rest: Vec<&str> = arguments.iter().skip(1).map(String::as_str).collect();
    let outcome = match arguments.first().map(String::as_str) {
        // Further on it may be another program's: `bench -- --help`.
        Some(command) if rest.first().is_some_and(|first| HELP.contains(first)) => help(command),
        Some("test") => checks::run_steps(&rest),
        Some("bench") => chores::bench(&rest),
        Some("peers") => peers::peers(&rest),
        Some("slicot") => peers::slicot(&rest),
        Some("identify-peers") => peers::identify(&rest),
        Some("plants") => peers::plants(&rest),
        Some("fleet") => peers::fleet(&rest),
        Some("diagnose-times") => times::diagnosis(&rest),
        Some("prove-baselines") => peers::prove_baselines(&rest),
        Some("latency") => latency::latency(&rest),
        Some("long") => chores::long(&rest),
        Some("benches") => benches::benches(&rest),
        Some("package") => package::package(&rest),
        Some("atlas") => atlas::atlas(&rest),
        Some("guide") => guide::guide(&rest),
        Some("wheel") => none(&rest).and_then(|()| chores::wheel()),
        Some("golden") => none(&rest).and_then(|()| chores::golden()),
        None | Some("help" | "--help" | "-h") => {
            println!("{USAGE}");
            checks::list();
            Ok(())
        }
        Some(other) => Err(unknown(other)),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(reason) => {
            eprintln!("xtask: {reason}");
            ExitCode::FAILURE
        }
    }
}

/// Prints what there is to say of one command.
fn help(command: &str) -> Result<(), String> {
    let about = USAGE.lines().find(|line| named(line) == Some(command));
    println!("{}", about.ok_or_else(|| unknown(command))?);
    if command == "test" {
        checks::list();
    }
    Ok(())
}

/// The command that a line of the usage is about.
fn named(line: &str) -> Option<&str> {
    line.strip_prefix("cargo xtask ")?.split_whitespace().next()
}

fn unknown(command: &str) -> String {
    format!("no command {command:?}; `cargo xtask` alone lists them")
}

fn none(rest: &[&str]) -> Result<(), String> {
    rest.first().map_or(Ok(()), |extra| Err(format!("unexpected argument {extra:?}; this command takes none")))
}
