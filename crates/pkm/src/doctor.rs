//! `pkm doctor`: can this machine run a control loop on time? What the kernel and its settings say, and what waking up really takes.

mod facts;
mod jitter;
mod logging;
mod rights;
mod shared;

use core::time::Duration;
use std::path::Path;
use std::process::ExitCode;

use serde_json::{Value, json};

use crate::out;
use facts::{Finding, State};
use jitter::{Jitter, Measured};
use logging::Logging;
use pkm_daemon::histogram::Summary;
use shared::Shared;

/// Arguments of `pkm doctor`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Every line says what was found and, where something can be better, what to do about it. A loop of pkm (a record of every period, sealed and \
put into a ring) and beside it a bare one that does nothing but clock_nanosleep wake up every period, first with ordinary rights, then with \
those of a control loop (SCHED_FIFO, memory locked, processor kept awake) as far as they are granted. Then a sample goes through shared memory \
there and back, between threads that never sleep: of iceoryx2 alone, and as a sealed command and the state that answers it. At last periods of \
twelve axes are recorded among the temporary files, as fast as it goes and at 4 kHz. Take minutes, and load the machine as it will be \
loaded, before the largest number is believed.

Exit status: 0 nothing is in the way of a control loop, 1 something is.

Examples:
  pkm doctor
  pkm doctor --seconds 600 --rate 4000
  pkm doctor --json")]
pub(crate) struct Args {
    /// Length of each measurement; 0 measures nothing.
    #[arg(long, value_name = "S", default_value_t = 5, value_parser = clap::value_parser!(u64).range(0..=86_400))]
    seconds: u64,
    /// Wake-ups per second.
    #[arg(long, value_name = "HZ", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..=20_000))]
    rate: u64,
    /// Priority of a first-in-first-out real-time thread.
    #[arg(long, value_name = "N", default_value_t = 80, value_parser = clap::value_parser!(u8).range(1..=98))]
    priority: u8,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What passes between processes, and to the disk.
struct Passing {
    shared: Shared,
    logging: Logging,
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    anyhow::ensure!(cfg!(target_os = "linux"), "pkm doctor looks at Linux; this is another system");
    let mut findings = facts::look(Path::new("/"));
    let period_ns = 1_000_000_000 / args.rate;
    let length = Duration::from_secs(args.seconds);
    let mut measured = Vec::new();
    // Before rights are asked for: locked memory stays locked.
    if args.seconds > 0 {
        measured.push(jitter::measure(length, period_ns, None));
    }
    findings.extend(rights::look(args.priority));
    if args.seconds > 0 {
        measured.push(jitter::measure(length, period_ns, Some(args.priority)));
        findings.push(judged(&measured, period_ns));
    }
    let passing =
        if args.seconds > 0 { Some(Passing { shared: shared::measure(length)?, logging: logging::measure(length)? }) } else { None };
    let is_bad = findings.iter().any(|finding| finding.state == State::Bad);
    let text = if args.json {
        serde_json::to_string_pretty(&as_json(&findings, (&measured, passing.as_ref()), period_ns))?
    } else {
        as_text(&findings, (&measured, passing.as_ref()), period_ns, args.seconds)
    };
    out::say(&out::clean(&text))?;
    Ok(if is_bad { ExitCode::from(1) } else { ExitCode::SUCCESS })
}

/// The wake-ups of the loop with the best rights that were granted: how many came more than a period late.
fn judged(measured: &[Measured], period_ns: u64) -> Finding {
    let Some(last) = measured.last() else { return Finding::new("wake-ups", "not measured", State::Note, "measure for some seconds") };
    let (missed, wakes) = (last.own.missed, last.own.wakes);
    let share = missed as f64 / wakes.max(1) as f64;
    let found = format!("{missed} of {wakes} more than a period late, latest {:.1} us", last.own.max_ns as f64 * 1e-3);
    let is_slow = last.own.p99_ns > period_ns / 5;
    let state = match (missed, is_slow) {
        _ if share > 1e-3 => State::Bad,
        (0, false) => State::Good,
        _ => State::Note,
    };
    let advice = match state {
        State::Good => "",
        _ => {
            "give the loop a core of its own (isolcpus=, nohz_full=) and a PREEMPT_RT kernel; look for virtual machines, power saving and SMIs"
        }
    };
    Finding::new("wake-ups", &found, state, advice)
}

fn as_text(findings: &[Finding], (measured, passing): (&[Measured], Option<&Passing>), period_ns: u64, seconds: u64) -> String {
    let mut lines = Vec::new();
    for finding in findings {
        lines.push(format!("{}  {:<18} {}", finding.state.mark(), finding.what, finding.found));
        if !finding.advice.is_empty() {
            lines.push(format!("      {:<16}-> {}", "", finding.advice));
        }
    }
    if !measured.is_empty() {
        lines.push(format!("\nWake-ups every {} us for {seconds} s, microseconds late:", out::number(period_ns as f64 * 1e-3)));
        let head = ["", "median", "99 %", "99.9 %", "largest", "over a period"].map(str::to_string).to_vec();
        let us = |ns: u64| format!("{:.1}", ns as f64 * 1e-3);
        let mut rows = vec![head];
        for run in measured {
            for (name, jitter) in [("bare loop", &run.bare), ("pkm's loop", &run.own)] {
                let Jitter { p50_ns, p99_ns, p999_ns, max_ns, missed, wakes } = *jitter;
                let last = format!("{missed} of {wakes}");
                rows.push(vec![format!("{name}, {}", run.rights), us(p50_ns), us(p99_ns), us(p999_ns), us(max_ns), last]);
            }
        }
        lines.push(out::table(&rows));
    }
    if let Some(Passing { shared, logging }) = passing {
        lines.push(format!("\nShared memory, there and back for {seconds} s, microseconds:"));
        let row = |name: &str, s: &Summary| {
            let shares = [s.p50_us, s.p99_us, s.p999_us, s.max_us].map(|us| format!("{us:.1}"));
            [&[name.to_string()][..], &shares, &[s.count.to_string()]].concat()
        };
        let head = ["", "median", "99 %", "99.9 %", "largest", "times"].map(str::to_string).to_vec();
        lines.push(out::table(&[head, row("iceoryx2 alone", &shared.bare), row("command and state", &shared.own)]));
        let Logging { periods_per_s, bytes_per_s, paced, lost } = *logging;
        lines.push(format!(
            "\nRecording twelve axes: {periods_per_s:.0} periods a second as fast as it goes, {:.0} MB/s; at 4 kHz {lost} of {paced} lost.",
            bytes_per_s * 1e-6
        ));
    }
    lines.join("\n")
}

fn as_json(findings: &[Finding], (measured, passing): (&[Measured], Option<&Passing>), period_ns: u64) -> Value {
    let finding = |f: &Finding| json!({"what": f.what, "found": f.found, "state": f.state.name(), "advice": f.advice});
    let jitter = |j: &Jitter| {
        json!({
            "wakes": j.wakes, "missed": j.missed, "p50_us": j.p50_ns as f64 * 1e-3, "p99_us": j.p99_ns as f64 * 1e-3,
            "p999_us": j.p999_ns as f64 * 1e-3, "max_us": j.max_ns as f64 * 1e-3,
        })
    };
    let run = |m: &Measured| json!({"rights": m.rights, "granted": m.is_granted, "bare": jitter(&m.bare), "loop": jitter(&m.own)});
    let shared = passing.map(|passing| json!({"bare": passing.shared.bare, "own": passing.shared.own}));
    let logging = passing.map(|Passing { logging: l, .. }| {
        json!({"periods_per_s": l.periods_per_s, "bytes_per_s": l.bytes_per_s, "periods_at_4_khz": l.paced, "lost_at_4_khz": l.lost})
    });
    json!({
        "schema": "pkm.doctor/1",
        "shared_memory": shared,
        "logging": logging,
        "findings": findings.iter().map(finding).collect::<Vec<_>>(),
        "period_us": period_ns as f64 * 1e-3,
        "jitter": measured.iter().map(run).collect::<Vec<_>>(),
        "fit": findings.iter().all(|f| f.state != State::Bad),
    })
}
