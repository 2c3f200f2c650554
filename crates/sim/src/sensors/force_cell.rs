//! A force cell or a current sensor: lag, gain, drift, noise, a ceiling, and whole steps of its converter.

use pkm_dyn::math;

use crate::actuators::FirstOrderLag;
use crate::random::{Random, Stream};
use crate::sensors::Drift;

/// Numbers of a force cell; [`ForceCell::ideal`] has none that matter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForceCellConfig {
    /// Reading over true value.
    pub gain: f64,
    /// Time constant of its amplifier `[s]`.
    pub lag: f64,
    /// Bias, rate and random walk, as in [`Drift`] `[N | N·m]`, per second, per root of a second.
    pub drift: [f64; 3],
    /// Standard deviation of white noise of a sample `[N | N·m]`.
    pub noise: f64,
    /// Most it shows either way `[N | N·m]`.
    pub ceiling: f64,
    /// Step of its converter `[N | N·m]`; 0 does not round.
    pub step: f64,
}

impl Default for ForceCellConfig {
    fn default() -> Self {
        Self { gain: 1.0, lag: 0.0, drift: [0.0; 3], noise: 0.0, ceiling: f64::INFINITY, step: 0.0 }
    }
}

/// A force cell.
#[derive(Debug, Clone)]
pub struct ForceCell {
    config: ForceCellConfig,
    lag: FirstOrderLag,
    drift: Drift,
    error: f64,
    random: Random,
}

impl ForceCell {
    /// Cell number `cell` of those that share `seed`.
    #[must_use]
    pub fn new(config: ForceCellConfig, seed: u64, cell: usize) -> Self {
        Self {
            config,
            lag: FirstOrderLag::new(config.lag),
            drift: Drift::new(config.drift, seed, cell),
            error: config.drift[0],
            random: Random::nth(seed, Stream::ForceCells, cell),
        }
    }

    /// A cell that shows what is there.
    #[must_use]
    pub fn ideal() -> Self {
        Self::new(ForceCellConfig::default(), 0, 0)
    }

    /// Brings its amplifier to rest at a value that has been there for ever.
    pub fn settle(&mut self, value: f64) {
        self.lag.settle(value);
    }

    /// Lets `h` `[s]` pass under a value that is `mean` meanwhile.
    pub fn follow(&mut self, mean: f64, h: f64) {
        self.lag.advance(mean, h);
        self.error = self.drift.advance(h);
    }

    /// What it shows now.
    pub fn read(&mut self) -> f64 {
        let ForceCellConfig { gain, noise, ceiling, step, .. } = self.config;
        let noise = if noise > 0.0 { noise * self.random.normal() } else { 0.0 };
        let shown = (gain * self.lag.output() + self.error + noise).max(-ceiling).min(ceiling);
        if step > 0.0 { math::round(shown / step) * step } else { shown }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gain_lag_drift_ceiling_and_steps_are_their_equations() {
        let config = ForceCellConfig { gain: 1.1, lag: 0.02, drift: [0.5, 0.25, 0.0], ..ForceCellConfig::default() };
        let mut cell = ForceCell::new(config, 1, 0);
        let mut clipped = ForceCell::new(ForceCellConfig { ceiling: 2.0, step: 0.75, ..config }, 1, 0);
        for k in 1..=200 {
            cell.follow(3.0, 1e-3);
            clipped.follow(3.0, 1e-3);
            let t = 1e-3 * f64::from(k);
            let want = 1.1 * 3.0 * (1.0 - math::exp(-t / 0.02)) + 0.5 + 0.25 * t;
            assert!((cell.read() - want).abs() < 1e-12, "{t} s");
            let steps = clipped.read() / 0.75;
            assert!((steps - math::round(want.min(2.0) / 0.75)).abs() < 1e-12, "{t} s: {steps} steps");
        }
    }

    #[test]
    fn an_ideal_cell_shows_what_is_there_and_noise_has_its_width() {
        let mut ideal = ForceCell::ideal();
        ideal.follow(-7.5, 1e-3);
        assert_eq!(ideal.read().to_bits(), (-7.5_f64).to_bits());
        let mut cell = ForceCell::new(ForceCellConfig { noise: 0.3, ..ForceCellConfig::default() }, 4, 2);
        let sum: f64 = (0..10_000).map(|_| cell.read()).map(|x| x * x).sum();
        assert!((math::sqrt(sum / 10_000.0) / 0.3 - 1.0).abs() < 5.0 / 141.0);
    }
}
