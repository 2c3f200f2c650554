//! A reading that wanders: a bias, a rate, and a random walk.

use pkm_dyn::math;

use crate::random::{Random, Stream};

/// The error of a sensor that drifts.
#[derive(Debug, Clone)]
pub struct Drift {
    /// At time 0, in the sensor's own unit.
    pub bias: f64,
    /// Per second.
    pub rate: f64,
    /// Standard deviation of the random walk after one second; it grows with the root of time.
    pub walk: f64,
    time: f64,
    walked: f64,
    random: Random,
}

impl Drift {
    /// A drift of sensor number `sensor`, at time 0.
    #[must_use]
    pub fn new([bias, rate, walk]: [f64; 3], seed: u64, sensor: usize) -> Self {
        Self { bias, rate, walk, time: 0.0, walked: 0.0, random: Random::nth(seed, Stream::Drift, sensor) }
    }

    /// No drift.
    #[must_use]
    pub fn none() -> Self {
        Self::new([0.0; 3], 0, 0)
    }

    /// The error `h` `[s]` later.
    pub fn advance(&mut self, h: f64) -> f64 {
        self.time += h;
        if self.walk > 0.0 {
            self.walked += self.walk * math::sqrt(h) * self.random.normal();
        }
        self.bias + self.rate * self.time + self.walked
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_is_a_line() {
        let mut drift = Drift::new([0.5, -0.1, 0.0], 1, 0);
        for k in 1..=1000 {
            let error = drift.advance(0.01);
            assert!((error - (0.5 - 0.1 * 0.01 * f64::from(k))).abs() < 1e-12);
        }
    }

    #[test]
    fn a_walk_has_the_variance_of_its_time_in_steps_of_any_length() {
        for (steps, h) in [(1, 4.0), (16, 0.25)] {
            let n = 4000;
            let sum: f64 = (0..n)
                .map(|sensor| {
                    let mut drift = Drift::new([0.0, 0.0, 0.3], 9, sensor);
                    let walked = (0..steps).map(|_| drift.advance(h)).last().unwrap_or(0.0);
                    walked * walked
                })
                .sum();
            // 0.3²·4 s; five standard errors of a variance.
            let variance = sum / n as f64 / (0.09 * 4.0);
            assert!((variance - 1.0).abs() < 5.0 * math::sqrt(2.0 / n as f64), "{steps} steps: {variance}");
        }
    }
}
