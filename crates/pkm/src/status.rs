//! `pkm status`: what a running daemon does, how late it is, and why it did what it did.

use alloc::sync::Arc;
use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::io::ErrorKind;
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

/// Parts of it after each of which Ctrl-C is looked for.
const PARTS: u32 = 25;

/// Transitions that are shown.
const SHOWN: usize = 8;

/// Arguments of `pkm status`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
`--watch` looks twice a second, a block a look, until the daemon ends, Ctrl-C, or the reader of the pipe goes away: all of that is exit 0.

Exit codes: 0 done, 74 no daemon answers, 78 the configuration is wrong.

Examples:
  pkm status
  pkm status --json
  pkm status --watch --config daemon.toml
  pkm status --watch --json | jq -c '[.phase, .overruns]'")]
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
    // Only who watches has an end of its own to come to.
    let is_over = if args.watch { listen().context("signals")? } else { Arc::default() };
    let mut looks = 0_u64;
    loop {
        let answer = match control::ask(&directory, "status") {
            Ok(answer) => answer,
            // It has ended; one that is there and silent has not.
            Err(e) if looks > 0 && !is_silence(&e) => return Ok(ExitCode::SUCCESS),
            Err(e) => {
                let socket = directory.join(control::SOCKET);
                return Ok(refuse(IO, &format!("{}: no daemon answers: {e} (`pkm daemon` starts one)", socket.display())));
            }
        };
        let is_read = if args.json {
            out::show(&answer)?
        } else {
            let gap = if looks > 0 { "\n" } else { "" };
            out::show(&format!("{gap}{}", text(&serde_json::from_str(&answer).context("the daemon's answer")?)))?
        };
        looks += 1;
        if !args.watch || !is_read || !wait(&is_over) {
            return Ok(ExitCode::SUCCESS);
        }
    }
}

/// A flag that Ctrl-C and SIGTERM set.
fn listen() -> std::io::Result<Arc<AtomicBool>> {
    let is_over = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&is_over))?;
    }
    Ok(is_over)
}

/// Waits for the next look; whether there is to be one.
fn wait(is_over: &AtomicBool) -> bool {
    for _ in 0..PARTS {
        if is_over.load(Ordering::Relaxed) {
            return false;
        }
        std::thread::sleep(EVERY / PARTS);
    }
    !is_over.load(Ordering::Relaxed)
}

/// Whether somebody took the request and said nothing.
fn is_silence(e: &std::io::Error) -> bool {
    matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut)
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
    lines.extend(status.recording.iter().map(ToString::to_string));
    let from = status.transitions.len().saturating_sub(SHOWN);
    lines.extend(status.transitions[from..].iter().map(ToString::to_string));
    lines.extend(status.black_boxes.last().map(|file| format!("black box: {file}")));
    out::clean(&lines.join("\n"))
}
