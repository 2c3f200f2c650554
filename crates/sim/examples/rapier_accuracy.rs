//! The table of accuracy in the documentation of `pkm_sim::rapier`: `cargo run --release -p pkm-sim --features rapier --example
//! rapier_accuracy`.

#[path = "../tests/rapier/pd_run.rs"]
mod pd_run;

use pd_run::{Loop, REFERENCE_PARTS, apart, foreign, frictionless, loops_open, own, play_back, shipped};
use pkm_dyn::effects::Robot;
use pkm_dyn::model::Model;
use pkm_hal::{Clock, MonotonicClock};
use pkm_sim::{Plant, RapierOptions, SimError};

/// Length of the runs `[s]`.
const SECONDS: u32 = 10;

/// Unless others are named in the arguments.
const ROBOTS: [&str; 4] = ["five_bar", "serial_arm", "prs3", "ups3_rpu1"];

/// Substep `[s]` and sweeps.
const SETTINGS: [(f64, usize); 5] = [(1e-3, 32), (5e-4, 32), (2.5e-4, 8), (2.5e-4, 32), (1.25e-4, 32)];

#[expect(clippy::print_stdout, reason = "an example's output is its text")]
fn main() {
    println!(
        "| robot | friction | plant | error under PD | error of playback, 1 s | widest gap | µs per ms |\n|---|---|---|---|---|---|---|"
    );
    let mut names: Vec<String> = std::env::args().skip(1).collect();
    if names.is_empty() {
        names = ROBOTS.map(str::to_string).to_vec();
    }
    for name in &names {
        for (friction, model) in [("none", frictionless(name)), ("as shipped", shipped(name))] {
            for row in rows(&model) {
                println!("| `{name}` | {friction} | {row} |");
            }
        }
    }
}

/// One per plant: the own one in steps of 0.5 ms, then the engine's.
fn rows(model: &Model) -> Vec<String> {
    let (robot, at) = (Robot::new(model.clone(), Vec::new()), Loop::new(model));
    let reference = at.run(&mut own(&robot, &at), SECONDS, REFERENCE_PARTS);
    let mut plant = own(&robot, &at);
    let mut timed = Timed::new(&mut plant);
    let error = apart(&at.run(&mut timed, SECONDS, 2), &reference);
    let mut out = vec![format!("own, 0.5 ms | {error:.1e} | | | {:.0}", 2.0 * timed.median_us())];
    for (substep, sweeps) in SETTINGS {
        let options = RapierOptions { substep, sweeps, ..RapierOptions::default() };
        let mut plant = foreign(&robot, &at, options);
        let mut timed = Timed::new(&mut plant);
        let error = apart(&at.run(&mut timed, SECONDS, 1), &reference);
        let median = timed.median_us();
        let gap = plant.widest_gap().max(loops_open(model, plant.tree_position()));
        let played = apart(&play_back(&mut foreign(&robot, &at, options), &reference, 1), &reference);
        out.push(format!("{} ms, {sweeps} sweeps | {error:.1e} | {played:.1e} | {gap:.1e} | {median:.0}", 1e3 * substep));
    }
    out
}

/// A plant whose steps are timed one by one: their median does not mind what else the machine does now and then.
struct Timed<'p> {
    plant: &'p mut dyn Plant,
    clock: MonotonicClock,
    spent_ns: Vec<u64>,
}

impl<'p> Timed<'p> {
    fn new(plant: &'p mut dyn Plant) -> Self {
        Self { plant, clock: MonotonicClock::start(), spent_ns: Vec::new() }
    }

    /// Of a step `[µs]`.
    fn median_us(&mut self) -> f64 {
        self.spent_ns.sort_unstable();
        1e-3 * self.spent_ns[self.spent_ns.len() / 2] as f64
    }
}

impl Plant for Timed<'_> {
    fn position(&self) -> &[f64] {
        self.plant.position()
    }

    fn velocity(&self) -> &[f64] {
        self.plant.velocity()
    }

    fn step(&mut self, tau: &[f64], h: f64) -> Result<(), SimError> {
        let start = self.clock.now_ns();
        let outcome = self.plant.step(tau, h);
        self.spent_ns.push(self.clock.now_ns() - start);
        outcome
    }
}
