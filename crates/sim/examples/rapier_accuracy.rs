//! The table of accuracy in the documentation of `pkm_sim::rapier`: `cargo run --release -p pkm-sim --features rapier --example
//! rapier_accuracy`.

#[path = "../tests/rapier/pd_run.rs"]
mod pd_run;

use pd_run::{Loop, REFERENCE_PARTS, apart, foreign, frictionless, loops_open, own, play_back, shipped};
use pkm_dyn::effects::Robot;
use pkm_dyn::model::Model;
use pkm_hal::{Clock, MonotonicClock};
use pkm_sim::{RapierOptions, SimError};

/// Length of the runs `[s]`.
const SECONDS: u32 = 10;

const ROBOTS: [&str; 4] = ["five_bar", "serial_arm", "prs3", "ups3_rpu1"];

/// Substep `[s]` and sweeps.
const SETTINGS: [(f64, usize); 6] = [(1e-3, 8), (5e-4, 8), (2.5e-4, 2), (2.5e-4, 8), (2.5e-4, 32), (1.25e-4, 8)];

#[expect(clippy::print_stdout, reason = "an example's output is its text")]
fn main() -> Result<(), SimError> {
    println!(
        "| robot | friction | plant | error under PD | error of playback, 1 s | widest gap | µs per ms |\n|---|---|---|---|---|---|---|"
    );
    for name in ROBOTS {
        for (friction, model) in [("none", frictionless(name)), ("as shipped", shipped(name))] {
            for row in rows(&model)? {
                println!("| {name} | {friction} | {row} |");
            }
        }
    }
    Ok(())
}

/// One per plant: the own one in steps of 0.5 ms, then the engine's.
fn rows(model: &Model) -> Result<Vec<String>, SimError> {
    let (robot, at) = (Robot::new(model.clone(), Vec::new()), Loop::new(model));
    let reference = at.run(&mut own(&robot, &at), SECONDS, REFERENCE_PARTS);
    let mut out = Vec::new();
    let clock = MonotonicClock::start();
    let mut plant = own(&robot, &at);
    let start = clock.now_ns();
    let run = at.run(&mut plant, SECONDS, 2);
    let per_ms = (clock.now_ns() - start) as f64 * 1e-6 / f64::from(SECONDS);
    out.push(format!("own, 0.5 ms | {:.1e} | | | {per_ms:.0}", apart(&run, &reference)));
    for (substep, sweeps) in SETTINGS {
        let options = RapierOptions { substep, sweeps, ..RapierOptions::default() };
        let mut plant = foreign(&robot, &at, options);
        let start = clock.now_ns();
        let run = at.run(&mut plant, SECONDS, 1);
        let per_ms = (clock.now_ns() - start) as f64 * 1e-6 / f64::from(SECONDS);
        let gap = plant.widest_gap().max(loops_open(model, plant.tree_position()));
        let played = play_back(&mut foreign(&robot, &at, options), &reference, 1);
        let errors = [apart(&run, &reference), apart(&played, &reference)];
        let substep_ms = 1e3 * substep;
        out.push(format!("{substep_ms} ms, {sweeps} sweeps | {:.1e} | {:.1e} | {gap:.1e} | {per_ms:.0}", errors[0], errors[1]));
    }
    Ok(out)
}
