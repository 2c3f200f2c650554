//! How late a loop wakes up: a bare one and one of pkm side by side, so that what the machine does is told from what pkm does.

use core::time::Duration;

use hdrhistogram::Histogram;
use pkm_daemon::realtime::{Awake, Policy, claim};
use pkm_hal::cycle::ring::{RingSink, RingSource, ring};
use pkm_hal::cycle::{CycleRecord, CycleSink, CycleSource};
use pkm_hal::{Clock, MAX_AXES, MonotonicClock};
use rustix::thread::{ClockId, Timespec, clock_nanosleep_absolute};

/// Largest lateness that is told apart `[ns]`: ten seconds.
const LARGEST_NS: u64 = 10_000_000_000;

/// Lateness of the wake-ups of one loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Jitter {
    pub(super) wakes: u64,
    /// Wake-ups more than a period late.
    pub(super) missed: u64,
    pub(super) p50_ns: u64,
    pub(super) p99_ns: u64,
    pub(super) p999_ns: u64,
    /// The largest, exactly.
    pub(super) max_ns: u64,
}

/// Both loops under the same rights.
#[derive(Debug)]
pub(super) struct Measured {
    pub(super) rights: &'static str,
    pub(super) is_granted: bool,
    pub(super) bare: Jitter,
    pub(super) own: Jitter,
}

/// Runs both loops for `length`, under `SCHED_FIFO` where a priority is given and it is granted.
pub(super) fn measure(length: Duration, period_ns: u64, priority: Option<u8>) -> Measured {
    let (sink, source) = ring(4096);
    let drain = std::thread::spawn(move || empty(source));
    let bare = std::thread::spawn(move || {
        let (is_granted, _awake) = ask(priority);
        (wake(length, period_ns, &mut |_| {}), is_granted)
    });
    let own = std::thread::spawn(move || {
        let (is_granted, _awake) = ask(priority);
        let mut period = Period { sink, record: CycleRecord::new(MAX_AXES, 0) };
        (wake(length, period_ns, &mut |late_ns| period.pass(late_ns)), is_granted)
    });
    // A panic of a measuring thread is a mistake here, and is told as one.
    let (bare, is_granted) = bare.join().unwrap_or_else(|e| std::panic::resume_unwind(e));
    let (own, _) = own.join().unwrap_or_else(|e| std::panic::resume_unwind(e));
    let _ = drain.join();
    let rights = match (priority, is_granted) {
        (None, _) => "ordinary rights",
        (Some(_), true) => "SCHED_FIFO",
        (Some(_), false) => "SCHED_FIFO refused",
    };
    Measured { rights, is_granted, bare, own }
}

/// Asks for what a control loop asks for; the thread keeps it until it ends.
fn ask(priority: Option<u8>) -> (bool, Option<Awake>) {
    match priority.map(|priority| claim(Policy::Prefer, None, priority)) {
        Some(Ok((grants, awake))) => (grants.fifo_priority > 0, Some(awake)),
        _ => (false, None),
    }
}

/// What pkm does in a period besides control.
struct Period {
    sink: RingSink,
    record: CycleRecord,
}

impl Period {
    fn pass(&mut self, late_ns: u64) {
        self.record.cycle += 1;
        self.record.woken_ns = self.record.planned_ns + late_ns;
        self.record.state.sequence = self.record.cycle;
        self.record.state = self.record.state.sealed();
        self.record.command.sequence = self.record.cycle;
        self.record.command = self.record.command.sealed();
        self.sink.put(&self.record);
    }
}

/// Takes the records away, as a recorder does.
fn empty(mut source: RingSource) {
    loop {
        let is_last = source.is_closed();
        while source.take().is_some() {}
        if is_last {
            return;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Wakes up at absolute times until `length` is over; `each` is told how late.
fn wake(length: Duration, period_ns: u64, each: &mut dyn FnMut(u64)) -> Jitter {
    let Ok(mut histogram) = Histogram::<u64>::new_with_bounds(1, LARGEST_NS, 3) else { return summary(None, 0, 0) };
    let clock = MonotonicClock::start();
    // The sleep is by the kernel's clock; what it reads now and what ours reads now are one moment.
    let kernel_ns = kernel_now_ns();
    let end_ns = u64::try_from(length.as_nanos()).unwrap_or(u64::MAX);
    let (mut planned_ns, mut missed, mut largest) = (period_ns, 0, 0);
    while planned_ns <= end_ns {
        sleep_until(kernel_ns + planned_ns);
        let late_ns = clock.now_ns().saturating_sub(planned_ns);
        histogram.saturating_record(late_ns);
        largest = largest.max(late_ns);
        missed += u64::from(late_ns > period_ns);
        each(late_ns);
        // Periods that are over are skipped, not caught up with.
        planned_ns += period_ns * (1 + late_ns / period_ns);
    }
    summary(Some(&histogram), missed, largest)
}

fn summary(histogram: Option<&Histogram<u64>>, missed: u64, max_ns: u64) -> Jitter {
    let at = |share: f64| histogram.map_or(0, |h| h.value_at_quantile(share).min(max_ns));
    Jitter { wakes: histogram.map_or(0, Histogram::len), missed, p50_ns: at(0.5), p99_ns: at(0.99), p999_ns: at(0.999), max_ns }
}

fn kernel_now_ns() -> u64 {
    let now = rustix::time::clock_gettime(ClockId::Monotonic);
    let part = |x: i64| u64::try_from(x).unwrap_or(0);
    part(now.tv_sec) * 1_000_000_000 + part(now.tv_nsec)
}

/// Sleeps; a signal does not end it early.
fn sleep_until(at_ns: u64) {
    let whole = |ns: u64| i64::try_from(ns).unwrap_or(i64::MAX);
    let at = Timespec { tv_sec: whole(at_ns / 1_000_000_000), tv_nsec: whole(at_ns % 1_000_000_000) };
    while clock_nanosleep_absolute(ClockId::Monotonic, &at) == Err(rustix::io::Errno::INTR) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loop_wakes_once_per_period_and_one_that_is_held_up_skips() {
        let jitter = wake(Duration::from_millis(200), 1_000_000, &mut |_| {});
        assert!(jitter.wakes <= 200 && jitter.wakes + jitter.missed * 200 >= 150, "{jitter:?}");
        assert!(jitter.p50_ns <= jitter.p99_ns && jitter.p99_ns <= jitter.p999_ns && jitter.p999_ns <= jitter.max_ns, "{jitter:?}");
        let mut calls = 0;
        let held = wake(Duration::from_millis(200), 1_000_000, &mut |_| {
            calls += 1;
            std::thread::sleep(Duration::from_millis(10));
        });
        assert_eq!(held.wakes, calls);
        // Ten periods pass in every one: the wake-up after it is nine late, and the next period is the one after now.
        assert!(held.wakes <= 21 && held.missed + 1 >= held.wakes.min(15) && held.p50_ns > 8_000_000, "{held:?}");
    }
}
