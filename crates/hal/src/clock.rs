//! Time, as the loop sees it: nanoseconds since an origin of the clock's own choice.

use core::cell::Cell;

/// A source of time that never runs backwards.
pub trait Clock {
    /// Time since the clock's origin `[ns]`.
    fn now_ns(&self) -> u64;
}

impl<C: Clock + ?Sized> Clock for &C {
    fn now_ns(&self) -> u64 {
        (**self).now_ns()
    }
}

/// A clock that moves only when told to: for tests and for replay.
#[derive(Debug, Default)]
pub struct ManualClock {
    now_ns: Cell<u64>,
}

impl ManualClock {
    /// A clock that reads `now_ns` `[ns]`.
    #[must_use]
    pub const fn new(now_ns: u64) -> Self {
        Self { now_ns: Cell::new(now_ns) }
    }

    /// Moves time forward by `step_ns` `[ns]`; it stops at the end of its range (585 years) rather than wrap to zero.
    pub fn advance(&self, step_ns: u64) {
        self.now_ns.set(self.now_ns.get().saturating_add(step_ns));
    }
}

impl Clock for ManualClock {
    fn now_ns(&self) -> u64 {
        self.now_ns.get()
    }
}

/// The operating system's monotonic clock, counted from its creation.
#[cfg(feature = "std")]
#[derive(Debug, Clone, Copy)]
pub struct MonotonicClock {
    origin: std::time::Instant,
}

#[cfg(feature = "std")]
impl MonotonicClock {
    /// A clock that reads zero now.
    #[must_use]
    #[expect(clippy::disallowed_methods, reason = "the one place where the operating system's time enters the workspace")]
    pub fn start() -> Self {
        Self { origin: std::time::Instant::now() }
    }
}

#[cfg(feature = "std")]
impl Clock for MonotonicClock {
    fn now_ns(&self) -> u64 {
        // A u64 of nanoseconds lasts 585 years; a clock that old has stopped rather than wrapped.
        u64::try_from(self.origin.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }
}

/// The operating system's monotonic clock as every process of the machine sees it: for stamps that pass from one to another.
#[cfg(feature = "system-clock")]
#[derive(Debug, Clone, Copy, Default)]
pub struct SystemClock;

#[cfg(feature = "system-clock")]
impl Clock for SystemClock {
    fn now_ns(&self) -> u64 {
        let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
        // It counts from the machine's start, so neither part is negative.
        let seconds = u64::try_from(now.tv_sec).unwrap_or(0);
        seconds.saturating_mul(1_000_000_000).saturating_add(u64::try_from(now.tv_nsec).unwrap_or(0))
    }
}

/// What to add to `clock` to have the time of day that `day_ns` tells since 1970, as it is now `[ns]`.
///
/// Asked for once: the time of day is set, backwards too, and stamps that add to one offset stay in order and as far apart as they were.
#[must_use]
pub fn epoch_offset_of(clock: &dyn Clock, day_ns: &dyn Fn() -> u64) -> u64 {
    day_ns().saturating_sub(clock.now_ns())
}

/// What to add to [`SystemClock`] to have the time of day, as it is now `[ns]`: for stamps that people read, not for control.
#[cfg(feature = "system-clock")]
#[must_use]
pub fn epoch_offset_ns() -> u64 {
    epoch_offset_of(&SystemClock, &|| {
        let day = rustix::time::clock_gettime(rustix::time::ClockId::Realtime);
        // A clock that is set before 1970 counts as 1970.
        let seconds = u64::try_from(day.tv_sec).unwrap_or(0);
        seconds.saturating_mul(1_000_000_000).saturating_add(u64::try_from(day.tv_nsec).unwrap_or(0))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_manual_clock_moves_only_when_told_to() {
        let clock = ManualClock::new(5);
        assert_eq!(clock.now_ns(), 5);
        clock.advance(7);
        assert_eq!(clock.now_ns(), 12);
        clock.advance(u64::MAX);
        assert_eq!(clock.now_ns(), u64::MAX);
    }

    #[cfg(feature = "system-clock")]
    #[test]
    fn the_system_clock_counts_as_the_kernel_says() {
        // The first number of /proc/uptime counts suspended time as well, so it can only be ahead.
        let uptime = std::fs::read_to_string("/proc/uptime").expect("Linux");
        let seconds: f64 = uptime.split(' ').next().and_then(|x| x.parse().ok()).expect("a number");
        let now = SystemClock.now_ns() as f64 * 1e-9;
        assert!(now > 0.0 && now <= seconds + 1.0, "{now} against {seconds}");
    }

    #[cfg(feature = "std")]
    #[test]
    fn the_monotonic_clock_never_runs_backwards() {
        let clock = MonotonicClock::start();
        let mut last = clock.now_ns();
        for _ in 0..1000 {
            let now = clock.now_ns();
            assert!(now >= last);
            last = now;
        }
    }
}
