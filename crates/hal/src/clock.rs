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
