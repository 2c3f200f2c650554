//! Side by side with Pinocchio's C++: same robots, same states, same numbers, times taken in turn. Run it with `cargo xtask peers`,
//! which compiles the other side; alone it measures pkm-dyn only.
#![expect(clippy::print_stdout, clippy::print_stderr, reason = "a command for the terminal")]

mod case;
mod ours;
mod peer;
mod table;

use std::path::PathBuf;
use std::process::ExitCode;

use pkm_benches::shipped;
use pkm_dyn::Data;

use crate::case::{BEFORE_S, Case};
use crate::ours::{ALGORITHMS, Algorithm, PARTS};
use crate::peer::Peer;
use crate::table::{Budget, Row};

/// Largest difference between the two sides, relative to the largest number of that state's result.
const SAME: f64 = 1e-9;

const USAGE: &str = "--folder DIR [--rounds N] [--peer NAME=PROGRAM ...] [--table FILE]";

/// What the command line says.
struct Options {
    folder: PathBuf,
    rounds: usize,
    peers: Vec<Peer>,
    table: Option<PathBuf>,
}

fn options() -> Result<Options, String> {
    let mut out = Options { folder: std::env::temp_dir().join("pkm-peers"), rounds: 40, peers: Vec::new(), table: None };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value = words.next().ok_or_else(|| format!("{word:?} without a value; {USAGE}"))?;
        match word.as_str() {
            "--folder" => out.folder = value.into(),
            "--table" => out.table = Some(value.into()),
            "--rounds" => out.rounds = value.parse().map_err(|e| format!("--rounds {value:?}: {e}"))?,
            "--peer" => {
                let (name, program) = value.rsplit_once('=').ok_or_else(|| format!("--peer {value:?}: NAME=PROGRAM"))?;
                out.peers.push(Peer::start(name, program)?);
            }
            _ => return Err(format!("unknown {word:?}; {USAGE}")),
        }
    }
    Ok(out)
}

fn cases() -> Vec<Case> {
    ["serial_arm", "serial_arm7", "prs3", "ups3_rpu1", "ups4"].iter().map(|name| Case::new(name, shipped(name).bare)).collect()
}

/// Largest relative difference over the states.
fn difference(ours: &[f64], theirs: &[f64], states: usize) -> Result<f64, String> {
    if ours.len() != theirs.len() || states == 0 || ours.is_empty() {
        return Err(format!("{} numbers here, {} there", ours.len(), theirs.len()));
    }
    let width = ours.len() / states;
    let of_state = |(a, b): (&[f64], &[f64])| {
        let size = a.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let apart = a.iter().zip(b).map(|(x, y)| (x - y).abs());
        // A difference that is not a number must not pass for none.
        apart.fold(0.0_f64, |m, x| if x.is_nan() { f64::INFINITY } else { m.max(x) }) / size.max(f64::MIN_POSITIVE)
    };
    Ok(ours.chunks(width).zip(theirs.chunks(width)).map(of_state).fold(0.0, f64::max))
}

/// Compares the numbers of one algorithm with every way of every peer.
fn compare(case: &Case, data: &mut Data, algorithm: &Algorithm, options: &mut Options) -> Result<f64, String> {
    let ours = ours::results(case, data, algorithm);
    let mut worst = 0.0_f64;
    for peer in &mut options.peers {
        for way in algorithm.theirs {
            let theirs = peer.results(way, &options.folder)?;
            let apart = difference(&ours, &theirs, case.states.len())?;
            if apart > SAME {
                let (robot, name) = (&case.name, algorithm.name);
                return Err(format!("{robot}, {name}: {way} of {} differs by {apart:e} (limit {SAME:e})", peer.name));
            }
            worst = worst.max(apart);
        }
    }
    Ok(worst)
}

/// Times one algorithm on all sides in turn, so that other work on the machine hits all alike; the best round counts.
fn measure(case: &Case, data: &mut Data, algorithm: &Algorithm, options: &mut Options) -> Result<Row, String> {
    let apart = compare(case, data, algorithm, options)?;
    let mut ours = f64::INFINITY;
    let mut theirs = vec![(f64::INFINITY, ""); options.peers.len()];
    for _ in 0..options.rounds {
        ours = ours.min(ours::time(case, data, algorithm.call));
        for (peer, best) in options.peers.iter_mut().zip(&mut theirs) {
            for way in algorithm.theirs {
                let took = peer.time(way)?;
                if took < best.0 {
                    *best = (took, way);
                }
            }
        }
    }
    Ok(Row { robot: case.name.clone(), algorithm: algorithm.name, ours, theirs, apart })
}

/// Times the parts of one step of a computed-torque controller.
fn budget(case: &Case, data: &mut Data, options: &mut Options) -> Result<Vec<Budget>, String> {
    let mut out = Vec::new();
    for (before, seconds) in BEFORE_S.iter().enumerate() {
        let mut parts = [f64::INFINITY; PARTS.len()];
        for _ in 0..options.rounds {
            for (best, (_, call)) in parts.iter_mut().zip(PARTS) {
                *best = best.min(ours::time(case, data, |c, d, s| call(c, d, s, before)));
            }
        }
        let way = ["step_1ms", "step_10ms"][before];
        let theirs = options.peers.first_mut().map(|p| p.mean_steps(way)).transpose()?;
        let steps = ours::mean_steps(case, data, before);
        out.push(Budget { robot: case.name.clone(), before_ms: seconds * 1e3, steps, their_steps: theirs, parts });
    }
    Ok(out)
}

fn run() -> Result<(), String> {
    let mut options = options()?;
    let (mut rows, mut budgets) = (Vec::new(), Vec::new());
    for case in cases() {
        let folder = case.write(&options.folder)?;
        for peer in &mut options.peers {
            peer.load(&folder)?;
        }
        let mut data = Data::new(&case.model);
        for algorithm in ALGORITHMS.iter().filter(|a| !a.is_closed_loop || case.has_ball_loops()) {
            let row = measure(&case, &mut data, algorithm, &mut options)?;
            println!("   {}", row.short());
            rows.push(row);
        }
        if case.has_ball_loops() {
            budgets.extend(budget(&case, &mut data, &mut options)?);
        }
    }
    let names: Vec<&str> = options.peers.iter().map(|p| p.name.as_str()).collect();
    let text = table::markdown(&names, &rows, &budgets);
    println!("\n{text}");
    let Some(path) = &options.table else { return Ok(()) };
    std::fs::write(path, text).map_err(|e| format!("{}: {e}", path.display()))
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(reason) => {
            eprintln!("peers: {reason}");
            ExitCode::FAILURE
        }
    }
}
