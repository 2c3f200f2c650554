//! Kalman filter of a drive in steady state: gains in closed form from the noise of the position and of the acceleration.

use pkm_dyn::math;

use super::alpha_beta::correct;
use super::{Estimate, Sample, VelocityObserver};
use crate::controller::ConfigError;

/// Steady-state Kalman filter: the acceleration sent is known up to a random error that is constant over a period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kalman<const N: usize> {
    sigma_q: [f64; N],
    sigma_a: [f64; N],
}

impl<const N: usize> Kalman<N> {
    /// With the standard deviation of the measured positions, `sigma_q` `[m | rad]`, and of the acceleration's error, `sigma_a`
    /// `[m/s² | rad/s²]`.
    ///
    /// # Errors
    /// Deviations that are not positive and finite.
    pub fn try_new(sigma_q: [f64; N], sigma_a: [f64; N]) -> Result<Self, ConfigError> {
        ConfigError::unless_positive("sigma_q", &sigma_q)?;
        ConfigError::unless_positive("sigma_a", &sigma_a)?;
        Ok(Self { sigma_q, sigma_a })
    }

    /// Shares of the innovation for drive `k` and period `dt` `[s]`: `[alpha, beta]`, the solution of the Riccati equation
    /// \[Kalata1984\].
    #[must_use]
    pub fn gains(&self, k: usize, dt: f64) -> [f64; 2] {
        let index = self.sigma_a[k] * dt * dt / self.sigma_q[k];
        let r = (4.0 + index - math::sqrt(8.0 * index + index * index)) / 4.0;
        // 1 − alpha = r², and r is above zero.
        [1.0 - r * r, 2.0 * (1.0 + r * r) - 4.0 * r]
    }
}

impl<const N: usize> VelocityObserver<N> for Kalman<N> {
    type State = Estimate<N>;

    fn at_rest(&self) -> Self::State {
        Estimate::default()
    }

    fn reset_to(&self, state: &mut Self::State, q: &[f64; N], v: &[f64; N]) {
        *state = Estimate::moving(q, v);
    }

    fn step(&self, state: &mut Self::State, sample: &Sample<N>) -> [f64; N] {
        if !state.has_started {
            self.reset_to(state, &sample.q_meas, &[0.0; N]);
            return state.v;
        }
        for k in 0..N {
            let gains = self.gains(k, sample.dt);
            correct(state, k, sample, gains, sample.a_cmd[k]);
        }
        state.v
    }
}
