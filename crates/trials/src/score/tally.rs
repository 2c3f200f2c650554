//! Marks counted, with intervals.

use serde::Serialize;

use super::judge::Marks;
use crate::case::Level;

/// So many of so many.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Count {
    /// Of which it is true.
    pub yes: usize,
    /// All.
    pub all: usize,
}

impl Count {
    /// Counts what is true.
    pub fn of(items: impl IntoIterator<Item = bool>) -> Self {
        items.into_iter().fold(Self { yes: 0, all: 0 }, |c, x| Self { yes: c.yes + usize::from(x), all: c.all + 1 })
    }

    /// Share and its interval of 95 %; none of nothing.
    #[must_use]
    pub fn share(self) -> Option<[f64; 3]> {
        let p = self.yes as f64 / self.all as f64;
        wilson(self.yes, self.all).map(|[low, high]| [p, low, high])
    }
}

/// Wilson's interval of 95 % for `yes` of `all`; none for nothing.
#[must_use]
pub fn wilson(yes: usize, all: usize) -> Option<[f64; 2]> {
    // The 97.5 % quantile of the normal distribution.
    const Z: f64 = 1.959_963_984_540_054;
    if all == 0 {
        return None;
    }
    let (n, p) = (all as f64, yes as f64 / all as f64);
    let z2 = Z * Z;
    let middle = p + z2 / (2.0 * n);
    let half = Z * (p * (1.0 - p) / n + z2 / (4.0 * n * n)).sqrt();
    let scale = 1.0 + z2 / n;
    // Exact at the ends, where rounding would leave a trace.
    let low = if yes == 0 { 0.0 } else { (middle - half) / scale };
    let high = if yes == all { 1.0 } else { (middle + half) / scale };
    Some([low, high])
}

/// All counts of some cases.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tally {
    /// What the cases have in common.
    pub label: String,
    /// Cases.
    pub cases: usize,
    /// Diagnoses that ended with a verdict.
    pub ran: Count,
    /// Levels 0 to 4: anything was said.
    pub detected: Count,
    /// The first finding is right in name and place.
    pub first: Count,
    /// It or one it cannot be told from is.
    pub in_set: Count,
    /// Mean size of that set.
    pub set: Option<f64>,
    /// The first finding is at the right place.
    pub place: Count,
    /// Right names with a right regime.
    pub regime: Count,
    /// Level 4: both found, at least one found.
    pub both: Count,
    /// Level 4: at least one found.
    pub either: Count,
    /// Levels 6 and 7: false alarms.
    pub alarms: Count,
    /// Level 5: said to be unexplained.
    pub flagged: Count,
    /// Level 5: given a name.
    pub impostors: Count,
    /// Median of |estimate/truth − 1|.
    pub size_error: Option<f64>,
    /// Intervals that hold the truth.
    pub covered: Count,
    /// Median of the explained share on the holdout over the oracle's.
    pub explained: Option<f64>,
    /// Median time `[s]`.
    pub seconds: Option<f64>,
    /// Bins of stated confidence: from, to, mean stated, and how many were right.
    pub calibration: Vec<(f64, f64, f64, Count)>,
}

/// Middle of the finite numbers; none of nothing.
pub(crate) fn median(mut x: Vec<f64>) -> Option<f64> {
    x.retain(|v| v.is_finite());
    x.sort_by(f64::total_cmp);
    let n = x.len();
    match n {
        0 => None,
        n if n % 2 == 1 => Some(x[n / 2]),
        n => Some(0.5 * (x[n / 2 - 1] + x[n / 2])),
    }
}

const BINS: [f64; 7] = [0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0];

/// Counts the marks that `is_of` takes.
pub fn tally(label: &str, marks: &[Marks], is_of: impl Fn(&Marks) -> bool) -> Tally {
    let all: Vec<&Marks> = marks.iter().filter(|m| is_of(m)).collect();
    let concealing: Vec<&Marks> = all.iter().copied().filter(|m| m.level <= Level::L4).collect();
    let of = |level: Level| all.iter().copied().filter(move |m| m.level == level);
    let sets: Vec<f64> = concealing.iter().filter_map(|m| m.set).map(|n| n as f64).collect();
    let stated: Vec<(f64, bool)> = all.iter().flat_map(|m| m.stated.iter().copied()).collect();
    Tally {
        label: label.to_string(),
        cases: all.len(),
        ran: Count::of(all.iter().map(|m| m.ran)),
        detected: Count::of(concealing.iter().map(|m| m.is_detected)),
        first: Count::of(concealing.iter().map(|m| m.is_first_right)),
        in_set: Count::of(concealing.iter().map(|m| m.is_in_set)),
        set: (!sets.is_empty()).then(|| sets.iter().sum::<f64>() / sets.len() as f64),
        place: Count::of(concealing.iter().map(|m| m.is_place_right)),
        regime: Count::of(concealing.iter().filter_map(|m| m.is_regime_right)),
        both: Count::of(of(Level::L4).map(|m| m.found >= 2)),
        either: Count::of(of(Level::L4).map(|m| m.found >= 1)),
        alarms: Count::of(all.iter().filter(|m| m.level.is_healthy()).map(|m| m.is_alarm)),
        flagged: Count::of(of(Level::L5).map(|m| m.is_flagged)),
        impostors: Count::of(of(Level::L5).map(|m| m.is_impostor)),
        size_error: median(concealing.iter().flat_map(|m| m.size_errors.iter().map(|(_, e)| e.abs())).collect()),
        covered: Count::of(concealing.iter().flat_map(|m| m.covered.iter().copied())),
        explained: median(concealing.iter().filter_map(|m| m.explained).collect()),
        seconds: median(all.iter().map(|m| m.seconds).collect()),
        calibration: BINS.windows(2).filter_map(|w| bin(&stated, w[0], w[1])).collect(),
    }
}

fn bin(stated: &[(f64, bool)], from: f64, to: f64) -> Option<(f64, f64, f64, Count)> {
    let is_last = to >= 1.0;
    let inside: Vec<&(f64, bool)> = stated.iter().filter(|(c, _)| *c >= from && (*c < to || is_last)).collect();
    let mean = inside.iter().map(|(c, _)| c).sum::<f64>() / inside.len() as f64;
    (!inside.is_empty()).then(|| (from, to, mean, Count::of(inside.iter().map(|(_, right)| *right))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_those_of_newcombe() {
        // Newcombe 1998, table I, method 3 (Wilson's score without continuity correction).
        for (yes, all, low, high) in [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)] {
            let [l, h] = wilson(yes, all).unwrap();
            assert!((l - low).abs() < 5e-5 && (h - high).abs() < 5e-5, "{yes}/{all}: {l} {h}");
        }
        assert_eq!(wilson(0, 0), None);
        assert_eq!(wilson(7, 7).map(|w| w[1]), Some(1.0));
    }

    #[test]
    fn confidences_fall_into_bins() {
        let stated = [(0.95, true), (1.0, false), (0.6, true), (0.5, false)];
        assert_eq!(bin(&stated, 0.95, 1.0).map(|b| b.3), Some(Count { yes: 1, all: 2 }));
        assert_eq!(bin(&stated, 0.5, 0.7).map(|b| b.3), Some(Count { yes: 1, all: 2 }));
        assert!(bin(&stated, 0.7, 0.8).is_none());
    }

    #[test]
    fn medians_pass_over_what_is_no_number() {
        assert_eq!(median(vec![3.0, f64::NAN, 1.0]), Some(2.0));
        assert_eq!(median(vec![]), None);
    }
}
