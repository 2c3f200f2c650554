//! From real time stamps to a uniform grid.

/// Samples whose neighbours are further apart than this many median periods are a gap, not jitter.
pub const GAP_PERIODS: f64 = 5.5;

/// A uniform time grid laid over a recording's stamps.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// First time `[s]`.
    pub start: f64,
    /// Period `[s]`: the median of the recorded ones.
    pub dt: f64,
    /// Number of points.
    pub n: usize,
    /// Largest deviation of a stamp from the grid, in periods.
    pub jitter: f64,
    /// For each point, the recorded sample at or before it.
    left: Vec<usize>,
}

impl Grid {
    /// Over stamps `[s]` that increase strictly; `None` with fewer than three.
    #[must_use]
    pub fn over(time: &[f64]) -> Option<Self> {
        if time.len() < 3 {
            return None;
        }
        let mut steps: Vec<f64> = time.windows(2).map(|w| w[1] - w[0]).collect();
        steps.sort_by(f64::total_cmp);
        let dt = steps[steps.len() / 2];
        let start = time[0];
        let span = time[time.len() - 1] - start;
        let mean = span / (time.len() - 1) as f64;
        // Stamps rounded to a microsecond accumulate in a median period: where the mean agrees, it is the truer one.
        let dt = if (mean - dt).abs() < 1e-3 * dt { mean } else { dt };
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the quotient of two positive times")]
        let n = (span / dt + 1e-6).floor() as usize + 1;
        let mut left = Vec::with_capacity(n);
        let mut k = 0;
        for i in 0..n {
            let t = start + dt * i as f64;
            while k + 2 < time.len() && time[k + 1] <= t {
                k += 1;
            }
            left.push(k);
        }
        let jitter = if n == time.len() {
            time.iter().enumerate().map(|(i, t)| (t - start - dt * i as f64).abs() / dt).fold(0.0, f64::max)
        } else {
            f64::INFINITY
        };
        Some(Self { start, dt, n, jitter, left })
    }

    /// Time of point `i` `[s]`.
    #[must_use]
    pub fn time(&self, i: usize) -> f64 {
        self.start + self.dt * i as f64
    }

    /// A recorded signal on the grid by linear interpolation; stamps within 1 % of a period of the grid are taken as they are.
    ///
    /// Missing samples (NaN) are bridged linearly; [`Grid::missing`] tells where.
    #[must_use]
    pub fn resample(&self, time: &[f64], signal: &[f64]) -> Vec<f64> {
        let bridged = bridge(time, signal);
        if self.jitter < 0.01 {
            return bridged;
        }
        (0..self.n)
            .map(|i| {
                let k = self.left[i];
                let share = ((self.time(i) - time[k]) / (time[k + 1] - time[k])).clamp(0.0, 1.0);
                bridged[k] + share * (bridged[k + 1] - bridged[k])
            })
            .collect()
    }

    /// Points where the signal was missing, or where stamps lie further apart than a gap.
    #[must_use]
    pub fn missing(&self, time: &[f64], signal: &[f64]) -> Vec<bool> {
        (0..self.n)
            .map(|i| {
                let k = self.left[i];
                let next = (k + 1).min(signal.len() - 1);
                signal[k].is_nan() || signal[next].is_nan() || time[next] - time[k] > GAP_PERIODS * self.dt
            })
            .collect()
    }
}

pub(crate) fn bridge(time: &[f64], signal: &[f64]) -> Vec<f64> {
    let known: Vec<usize> = (0..signal.len()).filter(|&i| !signal[i].is_nan()).collect();
    let mut out = signal.to_vec();
    let Some((&first, &last)) = known.first().zip(known.last()) else { return vec![0.0; signal.len()] };
    out[..first].fill(signal[first]);
    out[last..].fill(signal[last]);
    for pair in known.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        for i in a + 1..b {
            let share = (time[i] - time[a]) / (time[b] - time[a]);
            out[i] = signal[a] + share * (signal[b] - signal[a]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jittered_stamps_are_resampled_and_gaps_are_marked() {
        let time = [0.0, 0.0101, 0.0199, 0.03, 0.04, 0.1, 0.11, 0.12, 0.13];
        let signal: Vec<f64> = time.iter().map(|t| 2.0 * t).collect();
        let grid = Grid::over(&time).unwrap();
        let x = grid.resample(&time, &signal);
        for (i, x) in x.iter().enumerate() {
            assert!((x - 2.0 * grid.time(i)).abs() < 1e-12);
        }
        let missing = grid.missing(&time, &signal);
        assert!(!missing[1] && missing[6], "{missing:?}");
    }

    #[test]
    fn missing_samples_are_bridged() {
        let time: Vec<f64> = (0..6).map(f64::from).collect();
        let signal = [f64::NAN, 1.0, f64::NAN, f64::NAN, 4.0, 5.0];
        let grid = Grid::over(&time).unwrap();
        assert_eq!(grid.resample(&time, &signal), [1.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    }
}
