//! One full step of every controller, each step timed alone: median, 99th percentile, largest. Tracking controllers on every shipped robot
//! that has no surplus drives; controllers of contact on the platform of their tests.
//!
//! `cargo bench -p pkm-benches --bench loop_latency`; not criterion, which reports means, and a control loop is as good as its worst step.
#![expect(clippy::print_stdout, reason = "a table is what this program is for")]

#[path = "../tests/contact/controllers.rs"]
mod contact;

use core::hint::black_box;
use std::time::Instant;

use pkm_benches::{motion, shipped};
use pkm_ctrl::catalogue::{Entry, Tuning, Visit, every};
use pkm_ctrl::{Controller, Input};
use pkm_dyn::Data;
use pkm_dyn::effects::Robot;
use pkm_dyn::inverse_dynamics::closed_loop_motion;
use pkm_dyn::loops::assemble;

/// Steps before the clock counts: caches, branch predictors, the walk from the assembly.
const WARM_UP: usize = 2_000;

/// Steps that are timed.
const STEPS: usize = 100_000;

/// Times every controller it visits along a motion there and back.
struct Clock<'r, const N: usize> {
    robot: &'r str,
    rows: Vec<Input<N>>,
}

impl<const N: usize> Visit<N> for Clock<'_, N> {
    fn visit<C: Controller<N>>(&mut self, entry: &'static Entry, controller: &C) {
        let mut state = controller.at_rest();
        let last = self.rows.len() - 1;
        let mut times: Vec<f64> = Vec::with_capacity(STEPS);
        let mut is_faulted = false;
        for k in 0..WARM_UP + STEPS {
            let place = k % (2 * last);
            let row = &self.rows[place.min(2 * last - place)];
            let time = now();
            let command = black_box(controller.step(&mut state, black_box(row)));
            let taken = time.elapsed().as_secs_f64();
            is_faulted |= command.health.is_faulted;
            if k >= WARM_UP {
                times.push(1e6 * taken);
            }
        }
        assert!(!is_faulted, "{} {}", self.robot, entry.name);
        tell(self.robot, entry.name, times);
    }
}

fn tell(robot: &str, controller: &str, mut times: Vec<f64>) {
    times.sort_by(f64::total_cmp);
    let percent = |share: usize| times[(times.len() - 1) * share / 100];
    println!("| {robot} | {controller} | {:.2} | {:.2} | {:.1} |", percent(50), percent(99), percent(100));
}

/// Every controller of contact in the loop of its platform, a minute again and again.
fn on_the_platform() {
    for (name, mut controller) in contact::all() {
        let (mut platform, mut times) = (contact::Platform::new(), Vec::with_capacity(STEPS));
        for k in 0..WARM_UP + STEPS {
            let input = platform.input(contact::DT * (k % 6000) as f64);
            let time = now();
            let command = black_box(controller.step(black_box(&input)));
            let taken = time.elapsed().as_secs_f64();
            platform.step(&command.tau);
            if k >= WARM_UP {
                times.push(1e6 * taken);
            }
        }
        tell("platform", name, times);
    }
}

#[expect(clippy::disallowed_methods, reason = "a bench times; nothing of it runs in a loop")]
fn now() -> Instant {
    Instant::now()
}

#[expect(clippy::expect_used, reason = "a bench has no caller to report to")]
fn on<const N: usize>(name: &str) {
    let description = shipped(name);
    let robot: Robot = description.robot;
    let tuning = Tuning { bandwidth: 20.0, dt: 0.01, tau_limit: [1e5; N], b0: [1.0; N], u_limit: [1e12; N] };
    let mut data = Data::new(&robot.model);
    assert!(assemble(&robot.model, &mut data).is_closed);
    let mut rows = Vec::new();
    for [q, v, a] in motion(&robot.model, 512) {
        assert!(closed_loop_motion(&robot.model, &mut data, &q, &v, &a).is_closed, "{name}");
        let [q, v, a] = [q, v, a].map(|x| core::array::from_fn(|k| x[k]));
        rows.push(Input { q_ref: q, v_ref: v, a_ref: a, ..Input::standing(q, tuning.dt) });
    }
    every(&robot, &tuning, &mut Clock { robot: name, rows }).expect("all can be built");
}

/// What the machine takes from a loop that does nothing but read the clock for a second: gaps of more than a microsecond.
fn floor() {
    let (start, mut gaps) = (now(), Vec::new());
    let mut last = start;
    while last.duration_since(start).as_secs_f64() < 1.0 {
        let time = now();
        let gap = 1e6 * time.duration_since(last).as_secs_f64();
        if gap > 1.0 {
            gaps.push(gap);
        }
        last = time;
    }
    gaps.sort_by(f64::total_cmp);
    let median = gaps.get(gaps.len() / 2).copied().unwrap_or(0.0);
    println!("A loop that only reads the clock loses {median:.1} us (median) {} times a second.\n", gaps.len());
}

fn main() {
    floor();
    println!("| robot | controller | median, us | p99, us | largest, us |\n|---|---|---|---|---|");
    on::<1>("motobotte");
    on::<2>("five_bar");
    on::<3>("prs3");
    on::<4>("ups3_rpu1");
    on::<6>("serial_arm");
    on::<7>("serial_arm7");
    on_the_platform();
}
