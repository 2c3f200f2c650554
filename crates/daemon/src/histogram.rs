//! How long things take: fixed histograms, and the exact extremes beside them.

use hdrhistogram::Histogram;
use pkm_hal::CycleRecord;
use serde::{Deserialize, Serialize};

/// Longest time told apart `[ns]`; a longer one counts as this in the histogram, and as itself in the maximum.
const LONGEST_NS: u64 = 10_000_000_000;

/// One quantity.
#[derive(Debug, Clone)]
pub struct Times {
    histogram: Option<Histogram<u64>>,
    max_ns: u64,
    count: u64,
}

/// Shares and extremes of one quantity.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Summary {
    /// How many there were.
    pub count: u64,
    /// Half are no longer `[µs]`.
    pub p50_us: f64,
    /// 99 of a hundred are no longer `[µs]`.
    pub p99_us: f64,
    /// 999 of a thousand are no longer `[µs]`.
    pub p999_us: f64,
    /// The longest, exactly `[µs]`.
    pub max_us: f64,
}

impl Default for Times {
    fn default() -> Self {
        Self { histogram: Histogram::new_with_bounds(1, LONGEST_NS, 3).ok(), max_ns: 0, count: 0 }
    }
}

impl Times {
    /// Notes a time `[ns]`.
    pub fn note(&mut self, ns: u64) {
        (self.max_ns, self.count) = (self.max_ns.max(ns), self.count + 1);
        if let Some(histogram) = &mut self.histogram {
            histogram.saturating_record(ns);
        }
    }

    /// Its shares.
    #[must_use]
    pub fn summary(&self) -> Summary {
        let share = |p: f64| self.histogram.as_ref().map_or(0.0, |h| h.value_at_quantile(p) as f64 * 1e-3);
        let max_us = self.max_ns as f64 * 1e-3;
        // A bucket's end may lie beyond the largest value in it.
        let [p50_us, p99_us, p999_us] = [0.5, 0.99, 0.999].map(|p| share(p).min(max_us));
        Summary { count: self.count, p50_us, p99_us, p999_us, max_us }
    }
}

/// Latencies of a loop.
#[derive(Debug, Clone, Default)]
pub struct Latencies {
    wake: Times,
    compute: Times,
    end_to_end: Times,
}

/// Their summaries.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct LatencySummary {
    /// How late the loop wakes.
    pub wake: Summary,
    /// How long it computes.
    pub compute: Summary,
    /// Age of a state when the command that answers it is handed over.
    pub end_to_end: Summary,
}

impl Latencies {
    /// Notes one period; the last only where something was commanded.
    pub fn note(&mut self, record: &CycleRecord) {
        self.wake.note(record.wake_late_ns());
        self.compute.note(record.compute_ns());
        if record.flags & pkm_hal::cycle::flags::COMMANDED != 0 {
            self.end_to_end.note(record.end_to_end_ns());
        }
    }

    /// What there is to say.
    #[must_use]
    pub fn summary(&self) -> LatencySummary {
        LatencySummary { wake: self.wake.summary(), compute: self.compute.summary(), end_to_end: self.end_to_end.summary() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_a_known_distribution_and_the_extreme_is_exact() {
        let mut latencies = Latencies::default();
        for i in 1..=1000_u64 {
            let mut record = CycleRecord::new(1, 0);
            (record.planned_ns, record.woken_ns) = (1, 1 + i * 1000);
            latencies.note(&record);
        }
        let mut record = CycleRecord::new(1, 0);
        record.woken_ns = 30_000_000_007;
        latencies.note(&record);
        let wake = latencies.summary().wake;
        for (got, want) in [(wake.p50_us, 501.0), (wake.p99_us, 991.0), (wake.p999_us, 1000.0)] {
            assert!((got - want).abs() < 2e-3 * want, "{wake:?}");
        }
        assert!((wake.max_us - 30_000_000.007).abs() < 1e-6);
        assert_eq!((wake.count, latencies.summary().end_to_end.count), (1001, 0));
    }
}
