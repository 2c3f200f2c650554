//! Linear extended state observer: position, velocity, and the acceleration that what was sent does not explain.
//!
//! `q'' = u + f`, `f` unknown and slow. Discretised exactly for held inputs, in the form that corrects with the newest sample before it
//! answers, all three poles at the bandwidth \[Gao2003; Herbst2013\].

use pkm_dyn::math;

use super::{Sample, VelocityObserver};
use crate::controller::ConfigError;

/// One drive of an extended state observer: `[position, velocity, missing acceleration]`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LinearEso {
    /// Estimates `[m | rad]`, `[m/s | rad/s]`, `[m/s² | rad/s²]`.
    pub z: [f64; 3],
}

impl LinearEso {
    /// Shares of the innovation with all three poles at `exp(−bandwidth·dt)`; `bandwidth` `[1/s]`, `dt` `[s]`.
    #[must_use]
    pub fn gains(bandwidth: f64, dt: f64) -> [f64; 3] {
        let p = math::exp(-bandwidth * dt);
        let left = 1.0 - p;
        [1.0 - p * p * p, 1.5 * left * left * (1.0 + p) / dt, left * left * left / (dt * dt)]
    }

    /// Moves on by `dt` `[s]` at the known acceleration `u` `[m/s² | rad/s²]` and corrects with the position `q_meas` `[m | rad]` there.
    pub fn step(&mut self, u: f64, q_meas: f64, bandwidth: f64, dt: f64) {
        let [q, v, f] = self.z;
        let a = u + f;
        let foretold = [q + dt * v + 0.5 * dt * dt * a, v + dt * a, f];
        let innovation = q_meas - foretold[0];
        let gains = Self::gains(bandwidth, dt);
        self.z = core::array::from_fn(|i| foretold[i] + gains[i] * innovation);
    }
}

/// Linear extended state observer of every drive, used for its velocities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExtendedState<const N: usize> {
    bandwidth: [f64; N],
}

/// What an [`ExtendedState`] remembers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExtendedStateEstimate<const N: usize> {
    /// One observer per drive.
    pub drives: [LinearEso; N],
    has_started: bool,
}

impl<const N: usize> Default for ExtendedStateEstimate<N> {
    fn default() -> Self {
        Self { drives: [LinearEso::default(); N], has_started: false }
    }
}

impl<const N: usize> ExtendedState<N> {
    /// With the three poles of drive k at `-bandwidth[k]` `[1/s]`.
    ///
    /// # Errors
    /// Bandwidths that are not positive and finite.
    pub fn try_new(bandwidth: [f64; N]) -> Result<Self, ConfigError> {
        ConfigError::unless_positive("bandwidth", &bandwidth)?;
        Ok(Self { bandwidth })
    }
}

impl<const N: usize> VelocityObserver<N> for ExtendedState<N> {
    type State = ExtendedStateEstimate<N>;

    fn at_rest(&self) -> Self::State {
        ExtendedStateEstimate::default()
    }

    fn reset_to(&self, state: &mut Self::State, q: &[f64; N], v: &[f64; N]) {
        let drives = core::array::from_fn(|k| LinearEso { z: [q[k], v[k], 0.0] });
        *state = ExtendedStateEstimate { drives, has_started: true };
    }

    /// What was missing in the acceleration is still missing.
    fn resume(&self, state: &mut Self::State, sample: &Sample<N>, v: &[f64; N]) -> [f64; N] {
        for (k, drive) in state.drives.iter_mut().enumerate() {
            drive.z = [sample.q_meas[k], v[k], drive.z[2]];
        }
        state.has_started = true;
        *v
    }

    fn step(&self, state: &mut Self::State, sample: &Sample<N>) -> [f64; N] {
        if !state.has_started {
            self.reset_to(state, &sample.q_meas, &[0.0; N]);
            return [0.0; N];
        }
        for (k, drive) in state.drives.iter_mut().enumerate() {
            drive.step(sample.a_cmd[k], sample.q_meas[k], self.bandwidth[k], sample.dt);
        }
        state.drives.map(|drive| drive.z[1])
    }
}
