//! When samples are taken, and which of them arrive: a clock that jitters, a wire that loses frames, singly or in bursts.

use crate::error::SimError;
use crate::random::{Random, Stream};

/// Numbers of a sampling clock and its wire; the default is perfect.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SamplingConfig {
    /// Largest jitter `[s]`: samples are taken up to so much before their time, evenly spread, while their stamps say otherwise.
    pub jitter: f64,
    /// Probability that a frame is lost after one that arrived.
    pub loss_begins: f64,
    /// Probability that a frame is lost after one that was lost: bursts are 1/(1 − this) frames long in the mean.
    pub loss_goes_on: f64,
}

/// One sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampled {
    /// How much before its time it is taken `[s]`.
    pub early: f64,
    /// Whether it never arrives.
    pub is_lost: bool,
}

/// A sampling clock.
#[derive(Debug, Clone)]
pub struct Sampling {
    config: SamplingConfig,
    was_lost: bool,
    random: Random,
}

impl Sampling {
    /// The clock of a loop of this period `[s]`.
    ///
    /// # Errors
    /// A jitter that is not within the period, or probabilities that are none; frames that never come again are not a simulation.
    pub fn try_new(config: SamplingConfig, period: f64, seed: u64) -> Result<Self, SimError> {
        let SamplingConfig { jitter, loss_begins, loss_goes_on } = config;
        if !(0.0..period).contains(&jitter) {
            return Err(SimError::Scenario { what: "jitter", value: jitter, limit: "must be at least 0 s and below the period" });
        }
        for (what, value) in [("loss_begins", loss_begins), ("loss_goes_on", loss_goes_on)] {
            if !(0.0..1.0).contains(&value) {
                return Err(SimError::Scenario { what, value, limit: "must be at least 0 and below 1" });
            }
        }
        Ok(Self { config, was_lost: false, random: Random::new(seed, Stream::Sampling) })
    }

    /// The next sample.
    pub fn advance(&mut self) -> Sampled {
        let SamplingConfig { jitter, loss_begins, loss_goes_on } = self.config;
        // Both are drawn for every sample, so that one of them does not shift the other.
        let early = self.random.uniform(0.0, jitter);
        let chance = self.random.uniform(0.0, 1.0);
        self.was_lost = chance < if self.was_lost { loss_goes_on } else { loss_begins };
        Sampled { early, is_lost: self.was_lost }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jitter_has_the_mean_and_variance_of_an_even_spread() {
        let config = SamplingConfig { jitter: 2e-4, ..SamplingConfig::default() };
        let mut sampling = Sampling::try_new(config, 1e-3, 3).unwrap();
        let n = 40_000;
        let x: Vec<f64> = (0..n).map(|_| sampling.advance().early / 2e-4).collect();
        let mean = x.iter().sum::<f64>() / f64::from(n);
        let variance = x.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / f64::from(n);
        // Five standard errors: sqrt(1/12/n) of the mean, sqrt((1/80 − 1/144)/n) of the variance.
        assert!((mean - 0.5).abs() < 5.0 * 0.2887 / 200.0 && (variance - 1.0 / 12.0).abs() < 5.0 * 0.0746 / 200.0, "{mean} {variance}");
        assert!(x.iter().all(|x| (0.0..1.0).contains(x)));
    }

    #[test]
    fn losses_have_their_share_and_bursts_their_length() {
        let config = SamplingConfig { jitter: 0.0, loss_begins: 0.02, loss_goes_on: 0.75 };
        let mut sampling = Sampling::try_new(config, 1e-3, 3).unwrap();
        let (mut lost, mut bursts, mut before, n) = (0, 0, false, 200_000);
        for _ in 0..n {
            let is_lost = sampling.advance().is_lost;
            lost += i32::from(is_lost);
            bursts += i32::from(is_lost && !before);
            before = is_lost;
        }
        // Stationary share 0.02/(0.02 + 0.25); its samples are correlated over (1 + r)/(1 − r) with r = 0.73; bursts are geometric.
        let share = 0.02 / 0.27;
        let error = f64::sqrt(share * (1.0 - share) * 1.73 / 0.27 / f64::from(n));
        assert!((f64::from(lost) / f64::from(n) - share).abs() < 5.0 * error, "{lost} of {n}");
        let length = f64::from(lost) / f64::from(bursts);
        assert!((length - 4.0).abs() < 5.0 * f64::sqrt(0.75 / 0.0625 / f64::from(bursts)), "{length}");
    }

    #[test]
    fn the_perfect_clock_is_perfect_and_nonsense_is_refused() {
        let mut sampling = Sampling::try_new(SamplingConfig::default(), 1e-3, 3).unwrap();
        assert!((0..100).all(|_| sampling.advance() == Sampled { early: 0.0, is_lost: false }));
        for bad in [[1e-3, 0.0, 0.0], [-1e-9, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, f64::NAN]] {
            let config = SamplingConfig { jitter: bad[0], loss_begins: bad[1], loss_goes_on: bad[2] };
            assert!(Sampling::try_new(config, 1e-3, 1).is_err());
        }
    }
}
