//! What a person adds to his passive limb: nothing, resistance, assistance, and tremor.
//!
//! No two exercises are the same: strength and tremor are random processes. The seed makes a simulation repeatable all the same.

use pkm_dyn::math;

use crate::error::SimError;
use crate::random::{Random, Stream};

/// What the person wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Will {
    /// Nothing: the limb is moved.
    Passive,
    /// To brake whatever motion there is.
    Resists,
    /// To help the motion that is wanted.
    Assists,
}

/// Numbers of a person; one entry per coordinate of the limb, or per joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PatientConfig {
    /// What he wants.
    pub will: Will,
    /// Mean effort of his will `[N | N·m]`.
    pub strength: [f64; 6],
    /// Speed at which it is 71 % of that: below, it fades to nothing `[m/s | rad/s]`.
    pub speed: f64,
    /// Standard deviation of his strength over its mean. It is never negative: beyond that he lets go.
    pub variation: f64,
    /// Time over which his strength changes `[s]`.
    pub variation_time: f64,
    /// Root mean square of his tremor `[N | N·m]`.
    pub tremor: [f64; 6],
    /// Centre of the tremor's spectrum `[Hz]`: 4 to 8.
    pub tremor_frequency: f64,
    /// Half width of the spectrum at half its height `[Hz]`.
    pub tremor_width: f64,
}

impl Default for PatientConfig {
    fn default() -> Self {
        Self {
            will: Will::Passive,
            strength: [0.0; 6],
            speed: 0.05,
            variation: 0.3,
            variation_time: 1.0,
            tremor: [0.0; 6],
            tremor_frequency: 6.0,
            tremor_width: 0.5,
        }
    }
}

/// A person.
#[derive(Debug, Clone)]
pub struct Patient {
    config: PatientConfig,
    /// Strength less its mean, over its standard deviation.
    mood: f64,
    /// Tremor of each coordinate and its quadrature, each of variance 1.
    tremor: [[f64; 2]; 6],
    will_noise: Random,
    tremor_noise: Random,
}

impl Patient {
    /// A person of this seed, in the midst of it: all processes are stationary from the start.
    ///
    /// # Errors
    /// A number that is negative or none, or no time or speed where there must be one.
    pub fn try_new(config: PatientConfig, seed: u64) -> Result<Self, SimError> {
        let positive = [("speed of a will", config.speed), ("variation_time", config.variation_time)];
        let others =
            [("variation", config.variation), ("tremor_frequency", config.tremor_frequency), ("tremor_width", config.tremor_width)];
        let rows = config.strength.iter().map(|x| ("strength", *x)).chain(config.tremor.iter().map(|x| ("tremor", *x)));
        for (what, value) in rows.chain(others) {
            if !(value.is_finite() && value >= 0.0) {
                return Err(SimError::Scenario { what, value, limit: "must be finite and not negative" });
            }
        }
        for (what, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(SimError::Scenario { what, value, limit: "must be finite and positive" });
            }
        }
        let (mut will_noise, mut tremor_noise) = (Random::new(seed, Stream::Will), Random::new(seed, Stream::Tremor));
        let mood = will_noise.normal();
        let mut tremor = [[0.0; 2]; 6];
        for x in tremor.iter_mut().flatten() {
            *x = tremor_noise.normal();
        }
        Ok(Self { config, mood, tremor, will_noise, tremor_noise })
    }

    /// Whether he needs to know which motion is wanted.
    #[must_use]
    pub fn is_helpful(&self) -> bool {
        self.config.will == Will::Assists
    }

    /// Lets `h` `[s]` pass. Exact for any step: what a spectrum is does not depend on how finely it is simulated.
    pub fn advance(&mut self, h: f64) {
        let fade = math::exp(-h / self.config.variation_time);
        self.mood = fade * self.mood + math::sqrt(1.0 - fade * fade) * self.will_noise.normal();
        // Two Ornstein-Uhlenbeck processes in a frame that turns at the centre frequency: a Lorentz line at either side of zero.
        let turn = 2.0 * core::f64::consts::PI * h;
        let fade = math::exp(-turn * self.config.tremor_width);
        let kick = math::sqrt(1.0 - fade * fade);
        let (s, c) = math::sin_cos(turn * self.config.tremor_frequency);
        for [x, y] in &mut self.tremor {
            let (a, b) = (fade * (c * *x - s * *y), fade * (s * *x + c * *y));
            *x = a + kick * self.tremor_noise.normal();
            *y = b + kick * self.tremor_noise.normal();
        }
    }

    /// His effort on the robot in each coordinate `[N | N·m]`, at its rate `v` and the wanted rate `v_ref` `[m/s | rad/s]`.
    #[must_use]
    pub fn efforts(&self, v: &[f64; 6], v_ref: &[f64; 6]) -> [f64; 6] {
        core::array::from_fn(|i| self.will(i, v[i], v_ref[i]) + self.config.tremor[i] * self.tremor[i][0])
    }

    fn will(&self, i: usize, v: f64, v_ref: f64) -> f64 {
        let PatientConfig { will, strength, speed, variation, .. } = self.config;
        let strength = strength[i] * (1.0 + variation * self.mood).max(0.0);
        let along = |v: f64| v / math::hypot(v, speed);
        match will {
            Will::Passive => 0.0,
            Will::Resists => -strength * along(v),
            Will::Assists => strength * along(v_ref),
        }
    }
}
