//! `pkm status`: what a running daemon does, how late it is, and why it did what it did.

use core::time::Duration;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use pkm_daemon::control;
use pkm_daemon::histogram::Summary;
use pkm_daemon::status::Status;

use crate::daemon::setup::directory_of;
use crate::daemon::{CONFIGURATION, IO, refuse};
use crate::out;

/// Time between two looks with `--watch`.
const EVERY: Duration = Duration::from_millis(500);

/// Transitions that are shown.
const SHOWN: usize = 8;

/// Arguments of `pkm status`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Exit codes: 0 done, 74 no daemon answers, 78 the configuration is wrong.

Examples:
  pkm status
  pkm status --json
  pkm status --watch --config daemon.toml")]
pub(crate) struct Args {
    /// The daemon's own daemon.toml [default: the shipped example].
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Print JSON, one line a look.
    #[arg(long)]
    json: bool,
    /// Look again and again, until the daemon ends.
    #[arg(long)]
    watch: bool,
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let directory = match directory_of(args.config.as_deref()) {
        Ok(directory) => directory,
        Err(e) => return Ok(refuse(CONFIGURATION, &format!("{e:#}"))),
    };
    let mut has_looked = false;
    loop {
        let answer = match control::ask(&directory, "status") {
            Ok(answer) => answer,
            Err(_) if has_looked => return Ok(ExitCode::SUCCESS),
            Err(e) => {
                return Ok(refuse(
                    IO,
                    &format!("{}: no daemon answers: {e} (`pkm daemon` starts one)", directory.join(control::SOCKET).display()),
                ));
            }
        };
        if args.json {
            out::say(&answer)?;
        } else {
            out::say(&text(&serde_json::from_str(&answer).context("the daemon's answer")?))?;
        }
        if !args.watch {
            return Ok(ExitCode::SUCCESS);
        }
        has_looked = true;
        std::thread::sleep(EVERY);
    }
}

/// A status for people.
fn text(status: &Status) -> String {
    let numbers = |x: &[f64]| x.iter().map(|x| out::number(*x)).collect::<Vec<_>>().join(" ");
    let mut lines = vec![format!("{}: {} ({}), process {}", status.robot, status.phase, status.cause, status.pid)];
    let realtime = match (status.realtime.fifo_priority, status.realtime.cpu) {
        (0, _) => "not real time".to_string(),
        (priority, None) => format!("FIFO {priority}"),
        (priority, Some(cpu)) => format!("FIFO {priority} on core {cpu}"),
    };
    lines.push(format!(
        "law {}, {} Hz, {realtime}; {} periods, {} skipped, {} ended late",
        status.law,
        out::number(1.0 / status.period_s),
        status.periods,
        status.skipped,
        status.overruns
    ));
    let row = |name: &str, s: &Summary| {
        let mut row = vec![name.to_string()];
        row.extend([s.p50_us, s.p99_us, s.p999_us, s.max_us].map(out::number));
        row
    };
    let head = ["µs", "p50", "p99", "p99.9", "max"].map(str::to_string).to_vec();
    let latency = &status.latency;
    let rows = [head, row("wake-up", &latency.wake), row("compute", &latency.compute), row("end to end", &latency.end_to_end)];
    lines.push(out::table(&rows));
    lines.push(format!("q     {}", numbers(&status.q)));
    lines.push(format!("q_ref {}", numbers(&status.q_ref)));
    lines.push(format!("tau   {}", numbers(&status.tau)));
    let from = status.transitions.len().saturating_sub(SHOWN);
    lines.extend(status.transitions[from..].iter().map(ToString::to_string));
    lines.extend(status.black_boxes.last().map(|file| format!("black box: {file}")));
    out::clean(&lines.join("\n"))
}
