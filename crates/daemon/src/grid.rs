//! Periods at absolute times: a late one skips whole periods and keeps the phase.

/// When one period begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Beat {
    /// Number of the period on the grid.
    pub cycle: u64,
    /// When it is to begin `[ns]`.
    pub planned_ns: u64,
    /// Periods that were skipped before it.
    pub skipped: u64,
}

/// Times `start + n·period`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grid {
    period_ns: u64,
    beat: Beat,
}

impl Grid {
    /// A grid of `period_ns` (at least 1) whose first period begins at `start_ns` `[ns]`.
    #[must_use]
    pub const fn new(start_ns: u64, period_ns: u64) -> Self {
        let period_ns = if period_ns == 0 { 1 } else { period_ns };
        Self { period_ns, beat: Beat { cycle: 0, planned_ns: start_ns, skipped: 0 } }
    }

    /// The period that is planned.
    #[must_use]
    pub const fn beat(&self) -> Beat {
        self.beat
    }

    /// Passes over periods that can no longer begin in time: `now_ns` is when the loop woke for the planned one.
    ///
    /// A loop that slept for whole periods starts in the period it woke in, not in all of those it missed.
    pub const fn woken(&mut self, now_ns: u64) -> Beat {
        self.skip(now_ns.saturating_sub(self.beat.planned_ns) / self.period_ns);
        self.beat
    }

    /// Plans the next period after one that ended at `now_ns`, and says whether that was an overrun: the next had begun already.
    pub const fn done(&mut self, now_ns: u64) -> bool {
        self.beat =
            Beat { cycle: self.beat.cycle.saturating_add(1), planned_ns: self.beat.planned_ns.saturating_add(self.period_ns), skipped: 0 };
        let is_overrun = now_ns > self.beat.planned_ns;
        if is_overrun {
            self.skip((now_ns - self.beat.planned_ns).div_ceil(self.period_ns));
        }
        is_overrun
    }

    const fn skip(&mut self, periods: u64) {
        self.beat = Beat {
            cycle: self.beat.cycle.saturating_add(periods),
            planned_ns: self.beat.planned_ns.saturating_add(periods.saturating_mul(self.period_ns)),
            skipped: self.beat.skipped.saturating_add(periods),
        };
    }
}

/// Fastest loop `[Hz]`.
pub const FASTEST_HZ: u32 = 4000;

/// Room for the periods of a second of it.
const WORDS: usize = (FASTEST_HZ as usize).div_ceil(64);

/// Share of the last second's periods that ended late, one bit each.
#[derive(Debug, Clone, Copy)]
pub struct LateShare {
    bits: [u64; WORDS],
    length: usize,
    at: usize,
    late: usize,
}

impl LateShare {
    /// Of a loop with this period `[ns]`.
    #[must_use]
    pub fn new(period_ns: u64) -> Self {
        let periods = usize::try_from(1_000_000_000 / period_ns.max(1)).unwrap_or(usize::MAX);
        Self { bits: [0; WORDS], length: periods.clamp(1, 64 * WORDS), at: 0, late: 0 }
    }

    /// Notes a period; the one of a second ago is forgotten.
    pub fn note(&mut self, is_late: bool) {
        let (word, bit) = (self.at / 64, 1_u64 << (self.at % 64));
        self.late -= usize::from(self.bits[word] & bit != 0);
        self.late += usize::from(is_late);
        self.bits[word] = if is_late { self.bits[word] | bit } else { self.bits[word] & !bit };
        self.at = (self.at + 1) % self.length;
    }

    /// The share, 0 to 1.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.late as f64 / self.length as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beat(cycle: u64, planned_ns: u64, skipped: u64) -> Beat {
        Beat { cycle, planned_ns, skipped }
    }

    #[test]
    fn a_loop_in_time_walks_the_grid() {
        let mut grid = Grid::new(1000, 100);
        for k in 0..5 {
            assert_eq!(grid.woken(1000 + 100 * k + 20), beat(k, 1000 + 100 * k, 0));
            assert!(!grid.done(1000 + 100 * k + 100));
        }
    }

    #[test]
    fn an_overrun_skips_whole_periods_and_keeps_the_phase() {
        let mut grid = Grid::new(0, 100);
        grid.woken(3);
        assert!(grid.done(101));
        assert_eq!(grid.beat(), beat(2, 200, 1));
        grid.woken(205);
        assert!(grid.done(730));
        assert_eq!(grid.beat(), beat(8, 800, 5));
        assert_eq!(grid.beat().planned_ns % 100, 0);
    }

    #[test]
    fn a_long_sleep_is_no_licence_for_a_burst() {
        let mut grid = Grid::new(0, 100);
        assert_eq!(grid.woken(1250), beat(12, 1200, 12));
        assert!(!grid.done(1260));
        assert_eq!(grid.woken(1300), beat(13, 1300, 0));
    }

    #[test]
    fn a_share_is_that_of_the_last_second_whenever_it_began() {
        let mut late = LateShare::new(10_000_000);
        (0..37).for_each(|_| late.note(false));
        (0..200).for_each(|i| late.note(i % 4 == 0));
        assert!((late.share() - 0.25).abs() < 1e-12);
        (0..60).for_each(|_| late.note(false));
        assert!((late.share() - 0.10).abs() < 1e-12);
        (0..40).for_each(|_| late.note(false));
        assert!(late.share() <= 0.0);
        let mut fast = LateShare::new(1);
        (0..100_000).for_each(|_| fast.note(true));
        assert!((fast.share() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn counters_at_their_end_stop_rather_than_wrap() {
        let mut grid = Grid::new(u64::MAX - 50, 100);
        grid.woken(u64::MAX);
        grid.done(u64::MAX);
        assert_eq!(grid.beat().planned_ns, u64::MAX);
        assert_eq!(Grid::new(0, 0).woken(7).cycle, 7);
    }
}
