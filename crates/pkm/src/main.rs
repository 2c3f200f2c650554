//! The `pkm` command: one verb per file. Everything it computes is in the libraries; here are arguments, files and words.
//!
//! Exit codes: 0 done, 1 something was found that the caller asked to be told about, 2 bad usage or bad input, 70 internal error; those of
//! a daemon are in `daemon.rs`.

extern crate alloc;

mod check;
mod completions;
mod convert;
mod daemon;
mod demo;
mod diagnose;
mod diagnosis;
mod doctor;
mod driver_sim;
mod effects;
mod excite;
mod export;
mod identify;
mod man;
mod mu;
mod order;
mod out;
mod outputs;
mod plan;
mod progress;
mod prove;
mod random;
mod replay;
mod reproduce;
mod robot_file;
mod seal;
mod simulate;
mod status;
mod trial_null;
mod twin;
mod twins;
mod workspace;

use core::panic::AssertUnwindSafe;
use std::panic::catch_unwind;
use std::process::ExitCode;
use std::sync::Once;

use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

/// What this program is: its version, and the commit it was built from where that is known (build.rs).
pub(crate) const VERSION: &str = env!("PKM_VERSION");

/// Exit code of a mistake in pkm itself.
const INTERNAL: u8 = 70;

/// Exit code of bad usage and bad input.
const BAD_INPUT: u8 = 2;

const HELP: &str = "\
{about}

{usage-heading} {usage}

Look at a robot:
  check       Say what a robot file describes and whether it can be diagnosed
  workspace   Say where a robot can go, what limits it, and how near it is to a singularity
  effects     List the physics that a diagnosis can name
  export      Write a robot for Pinocchio or MuJoCo

Handle recordings:
  excite      Find a motion that shows a robot's parameters, or tells two effects apart
  simulate    Record a simulated robot, with or without concealed physics
  convert     Turn a CSV recording into MCAP, or back
  twin        Replay a recording in simulation and compare
  replay      Do every step of a recorded controller again, to the bit

Fit a robot:
  identify    Estimate masses, inertias and friction of a robot from recordings

Find missing physics:
  plan        Say before any recording what a motion could show, and what would be mistaken for what
  diagnose    Locate, name and size what a robot file leaves out of its recordings
  trial-null  Diagnose the same runs with nothing missing: how often is something found?
  prove       Make blind trials with sealed answers, diagnose them and score the verdicts

Analyse a control loop:
  mu          Bound the structured singular value: how much uncertainty a loop survives

Run a robot:
  doctor      Say whether this machine can run a control loop on time
  daemon      Run a controller on a robot in real time
  order       Tell a running daemon what to do
  status      Show what a running daemon does and how late it is
  driver-sim  Stand in for a robot's driver: simulated, in a process of its own

See it work:
  reproduce   Do a paper's experiments again and compare its numbers with ours
  demo        Conceal an effect in a simulated robot and find it again; needs no files

Settle in:
  completions Print a script that lets a shell complete verbs, flags and values
  man         Write manual pages

Options:
{options}

Examples:
  pkm demo                                  # the whole story, without any file
  pkm check prs3                            # do its loops close? what can recordings show?
  pkm simulate prs3 --out A.mcap --hide 'friction_coulomb@q1:coulomb=20'
  pkm diagnose robot.toml --recording A.csv --holdout B.csv --json out.json --html out.html
  pkm identify robot.toml --recording A.csv --holdout B.csv --out better.identified.toml
  pkm convert A.csv A.mcap --robot robot.toml
  pkm effects friction_stribeck
  pkm export prs3 --format mjcf --out prs3.xml
  pkm daemon daemon.toml

`pkm VERB --help` explains a verb and its flags. Shipped robots can be given by name wherever a
ROBOT is asked for. `--json` prints JSON; where it takes a file, `--json -` does. Colours are for
terminals, and NO_COLOR turns them off.
";

/// Models of parallel robots, and what their recordings say is missing from them.
#[derive(Debug, Parser)]
#[command(name = "pkm", version = VERSION, help_template = HELP, subcommand_value_name = "VERB")]
struct Cli {
    /// What to do.
    #[command(subcommand)]
    verb: Verb,
    /// Tell on standard error what is being done; twice for more.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Say what a robot file describes and whether it can be diagnosed.
    Check(check::Args),
    /// Say where a robot can go, what limits it, and how near it is to a singularity.
    Workspace(workspace::Args),
    /// List the physics that a diagnosis can name, or one entry in full.
    Effects(effects::Args),
    /// Write a robot for Pinocchio or MuJoCo.
    Export(export::Args),
    /// Find a motion that shows a robot's parameters, or tells two effects apart.
    Excite(excite::Args),
    /// Record a simulated robot, with or without concealed physics.
    Simulate(simulate::Args),
    /// Turn a CSV recording into MCAP, or back.
    Convert(convert::Args),
    /// Replay a recording in simulation and compare, joint by joint.
    Twin(twin::Args),
    /// Do every step of a recorded controller again, to the bit.
    Replay(replay::Args),
    /// Estimate masses, inertias and friction of a robot from recordings.
    Identify(identify::Args),
    /// Say before any recording what a motion could show, and what would be mistaken for what.
    Plan(plan::Args),
    /// Locate, name and size what a robot file leaves out of its recordings.
    Diagnose(diagnose::Args),
    /// Diagnose the same runs with nothing missing: how often is something found?
    TrialNull(trial_null::Args),
    /// Make blind trials with sealed answers, diagnose them and score the verdicts.
    Prove(prove::Args),
    /// Bound the structured singular value: how much uncertainty a loop survives.
    Mu(mu::Args),
    /// Say whether this machine can run a control loop on time.
    Doctor(doctor::Args),
    /// Run a controller on a robot in real time.
    Daemon(daemon::Args),
    /// Tell a running daemon what to do.
    Order(order::Args),
    /// Show what a running daemon does and how late it is.
    Status(status::Args),
    /// Stand in for a robot's driver: simulated, in a process of its own.
    DriverSim(driver_sim::Args),
    /// Do a paper's experiments again and compare its numbers with ours.
    Reproduce(reproduce::Args),
    /// Conceal an effect in a simulated robot and find it again.
    Demo(demo::Args),
    /// Print a script that lets a shell complete verbs, flags and values.
    Completions(completions::Args),
    /// Write manual pages.
    Man(man::Args),
}

fn main() -> ExitCode {
    install_panic_hook();
    let cli = match parse() {
        Ok(cli) => cli,
        Err(code) => return code,
    };
    start_log(cli.verbose);
    let result = catch_unwind(AssertUnwindSafe(|| match &cli.verb {
        Verb::Check(args) => check::run(args),
        Verb::Workspace(args) => workspace::run(args),
        Verb::Effects(args) => effects::run(args),
        Verb::Export(args) => export::run(args),
        Verb::Excite(args) => excite::run(args),
        Verb::Simulate(args) => simulate::run(args),
        Verb::Convert(args) => convert::run(args),
        Verb::Twin(args) => twin::run(args),
        Verb::Replay(args) => replay::run(args),
        Verb::Identify(args) => identify::run(args),
        Verb::Plan(args) => plan::run(args),
        Verb::Diagnose(args) => diagnose::run(args),
        Verb::TrialNull(args) => trial_null::run(args),
        Verb::Prove(args) => prove::run(args),
        Verb::Mu(args) => mu::run(args),
        Verb::Doctor(args) => doctor::run(args),
        Verb::Daemon(args) => daemon::run(args),
        Verb::Order(args) => order::run(args),
        Verb::Status(args) => status::run(args),
        Verb::DriverSim(args) => driver_sim::run(args),
        Verb::Reproduce(args) => reproduce::run(args),
        Verb::Demo(args) => demo::run(args),
        Verb::Completions(args) => completions::run(args, Cli::command()),
        Verb::Man(args) => man::run(args, Cli::command()),
    }));
    match result {
        Ok(Ok(code)) => code,
        Ok(Err(e)) => {
            out::error(&format!("{e:#}"));
            ExitCode::from(BAD_INPUT)
        }
        Err(_) => ExitCode::from(INTERNAL),
    }
}

/// Arguments, or the exit code of having said why there are none.
fn parse() -> Result<Cli, ExitCode> {
    let matches = Cli::command().try_get_matches();
    matches.and_then(|m| Cli::from_arg_matches(&m)).map_err(|e| {
        if !e.use_stderr() {
            // Help and version: wanted, not wrong. A closed pipe is no reason to complain.
            let _ = e.print();
            return ExitCode::SUCCESS;
        }
        if e.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
            // Nobody who asks nothing wants one line.
            let _ = e.print();
            return ExitCode::from(BAD_INPUT);
        }
        let given = std::env::args().nth(1);
        let verb = given.filter(|given| Cli::command().find_subcommand(given).is_some()).map_or(String::new(), |verb| format!("{verb} "));
        out::error(&format!("{} (see `pkm {verb}--help`)", one_line(&e.to_string())));
        ExitCode::from(BAD_INPUT)
    })
}

/// What is wrong with the arguments in one line, with the tip that there is.
fn one_line(text: &str) -> String {
    let told = text.lines().take_while(|l| !l.starts_with("Usage:") && !l.starts_with("For more information"));
    let mut out = String::new();
    for line in told.map(str::trim).filter(|l| !l.is_empty()) {
        let (between, said) = match line.strip_prefix("tip: ") {
            // The parser's own advice is for words, not for numbers of an option.
            Some(tip) if tip.starts_with("to pass '-") => ("; ", "a value that begins with a minus is written --OPTION=VALUE"),
            Some(tip) => ("; ", tip),
            None => (" ", line.strip_prefix("error: ").unwrap_or(line)),
        };
        out += if out.is_empty() { "" } else { between };
        out += said;
    }
    out
}

/// One line instead of a backtrace; several threads may panic at once, one speaks.
fn install_panic_hook() {
    static ONCE: Once = Once::new();
    std::panic::set_hook(Box::new(|info| {
        ONCE.call_once(|| {
            let payload = info.payload();
            let what = payload.downcast_ref::<&str>().copied().or_else(|| payload.downcast_ref::<String>().map(String::as_str));
            let place = info.location().map_or(String::new(), |l| format!(" ({}:{})", l.file(), l.line()));
            out::line_on_stderr(&format!("internal error: {}{place}; please report", what.unwrap_or("unknown")));
        });
    }));
}

fn start_log(verbose: u8) {
    let level = match verbose {
        0 => return,
        1 => "pkm=info,pkm_diagnose=info",
        _ => "pkm=debug,pkm_diagnose=debug",
    };
    tracing_subscriber::fmt()
        .with_env_filter(tracing_subscriber::EnvFilter::new(level))
        .with_writer(std::io::stderr)
        .with_ansi(out::takes_colour(&std::io::stderr()))
        .without_time()
        .with_target(false)
        .init();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn the_help_lists_every_verb_with_its_own_words() {
        for verb in Cli::command().get_subcommands() {
            let about = verb.get_about().unwrap().to_string();
            let first = about.split(',').next().unwrap().trim_end_matches('.').to_string();
            assert!(HELP.contains(&format!("  {}", verb.get_name())), "{}", verb.get_name());
            assert!(HELP.contains(&first), "{first}");
        }
    }

    /// What stands below the flags of a verb.
    fn below(verb: &clap::Command) -> String {
        verb.get_after_help().map(ToString::to_string).unwrap_or_default()
    }

    #[test]
    fn every_verb_shows_an_example_that_a_terminal_does_not_break() {
        // Help is wrapped here: a command that is broken cannot be copied.
        let columns = 100;
        for verb in Cli::command().get_subcommands() {
            let (name, text) = (verb.get_name(), below(verb));
            let examples = text.split_once("Example").map_or("", |(_, after)| after);
            assert!(examples.contains(&format!("\n  pkm {name}")), "{name}: {text}");
            let wide: Vec<&str> = text.lines().filter(|l| l.starts_with(' ') && l.chars().count() > columns).collect();
            assert!(wide.is_empty(), "{name}: {wide:?}");
        }
        assert!(HELP.lines().all(|l| l.chars().count() <= columns), "the list of verbs");
    }

    #[test]
    fn sentences_below_the_flags_are_wrapped_by_the_terminal_alone() {
        for verb in Cli::command().get_subcommands().filter(|v| v.get_name() != "order") {
            let text = below(verb);
            let is_sentence = |l: &str| !l.is_empty() && !l.starts_with(' ') && !l.ends_with(':');
            let lines: Vec<&str> = text.lines().collect();
            let broken = lines.windows(2).find(|w| w.iter().all(|l| is_sentence(l)));
            assert_eq!(broken, None, "{}", verb.get_name());
        }
    }

    #[test]
    fn every_verb_with_an_answer_gives_it_as_json() {
        let silent = ["completions", "man", "daemon", "driver-sim"];
        for verb in Cli::command().get_subcommands().filter(|v| !silent.contains(&v.get_name())) {
            assert!(verb.get_arguments().any(|a| a.get_long() == Some("json")), "{}", verb.get_name());
        }
    }

    #[test]
    fn many_flags_are_grouped() {
        for verb in Cli::command().get_subcommands() {
            let alone = verb.get_arguments().filter(|a| !a.is_positional() && a.get_help_heading().is_none()).count();
            assert!(alone <= 14, "{}: {alone} flags without a heading", verb.get_name());
        }
    }

    /// Words of a line as a shell would have them: quotes of one kind, up to a comment.
    fn words(line: &str) -> Vec<String> {
        let code = line.split(" #").next().unwrap_or(line);
        let mut out = Vec::new();
        for (i, part) in code.split('\'').enumerate() {
            if i % 2 == 0 {
                out.extend(part.split_whitespace().map(str::to_string));
            } else {
                out.push(part.to_string());
            }
        }
        out
    }

    #[test]
    fn commands_of_the_readme_are_understood() {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let text = std::fs::read_to_string(root.join("README.md")).unwrap();
        let commands: Vec<&str> = text.lines().filter(|l| l.starts_with("pkm ")).collect();
        assert!(commands.len() > 15, "{commands:?}");
        for line in commands {
            let wrong = Cli::command().try_get_matches_from(words(line)).err().map(|e| e.to_string());
            assert_eq!(wrong, None, "{line}");
        }
    }

    #[test]
    fn every_flag_is_explained() {
        for verb in Cli::command().get_subcommands() {
            for argument in verb.get_arguments() {
                assert!(argument.get_help().is_some(), "{} {}", verb.get_name(), argument.get_id());
            }
        }
    }
}
