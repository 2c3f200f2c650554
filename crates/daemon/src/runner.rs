//! A [`Machine`] on a grid of absolute times, on a thread of its own.

use core::panic::AssertUnwindSafe;
use core::sync::atomic::{AtomicBool, Ordering};
use std::panic::catch_unwind;

use pkm_hal::{Backend, Clock, CycleSink, SystemClock};
use rustix::thread::{Timespec, clock_nanosleep_absolute};

use crate::grid::Grid;
use crate::machine::{Machine, Tick};

/// A clock that one can sleep by.
pub trait Pace: Clock {
    /// Returns when it is `at_ns` `[ns]` by this clock, or later.
    fn sleep_until(&self, at_ns: u64);
}

impl Pace for SystemClock {
    fn sleep_until(&self, at_ns: u64) {
        let second = 1_000_000_000;
        let (tv_sec, tv_nsec) = (i64::try_from(at_ns / second).unwrap_or(i64::MAX), i64::try_from(at_ns % second).unwrap_or(0));
        let at = Timespec { tv_sec, tv_nsec };
        // A signal wakes early: the time is absolute, so sleeping on loses nothing.
        while clock_nanosleep_absolute(rustix::thread::ClockId::Monotonic, &at).is_err() && self.now_ns() < at_ns {}
    }
}

/// The program failed inside the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the loop failed; the safe action was sent")]
pub struct Failed;

/// Runs `machine` until `stop` is set, then leaves the robot to its own safe action; `each` is told of every period that has passed.
///
/// # Errors
/// It panicked: the safe action has been sent once more, and expires by itself.
pub fn run<B: Backend, S: CycleSink>(
    machine: &mut Machine<B, S>,
    pace: &dyn Pace,
    period_ns: u64,
    stop: &AtomicBool,
    each: &mut dyn FnMut(u64),
) -> Result<(), Failed> {
    let outcome = catch_unwind(AssertUnwindSafe(|| {
        let mut grid = Grid::new(pace.now_ns().saturating_add(period_ns), period_ns);
        let mut is_overrun = false;
        while !stop.load(Ordering::Relaxed) {
            pace.sleep_until(grid.beat().planned_ns);
            let woken_ns = pace.now_ns();
            let tick = Tick { beat: grid.woken(woken_ns), woken_ns, is_overrun };
            machine.step(&tick, pace_clock(pace));
            is_overrun = grid.done(pace.now_ns());
            each(tick.beat.cycle);
        }
        machine.leave(pace.now_ns());
    }));
    outcome.map_err(|_| {
        machine.abandon(pace.now_ns());
        Failed
    })
}

fn pace_clock(pace: &dyn Pace) -> &dyn Clock {
    pace
}
