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
        self.beat = Beat {
            cycle: self.beat.cycle.saturating_add(1),
            planned_ns: self.beat.planned_ns.saturating_add(self.period_ns),
            skipped: 0,
        };
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
    fn counters_at_their_end_stop_rather_than_wrap() {
        let mut grid = Grid::new(u64::MAX - 50, 100);
        grid.woken(u64::MAX);
        grid.done(u64::MAX);
        assert_eq!(grid.beat().planned_ns, u64::MAX);
        assert_eq!(Grid::new(0, 0).woken(7).cycle, 7);
    }
}
