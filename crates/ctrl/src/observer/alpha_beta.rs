//! Alpha-beta filter: constant velocity, corrected by shares of the innovation, both poles at the bandwidth.

use pkm_dyn::math;

use super::{Estimate, Sample, VelocityObserver};
use crate::controller::ConfigError;

/// Constant-velocity filter, critically damped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AlphaBeta<const N: usize> {
    bandwidth: [f64; N],
}

impl<const N: usize> AlphaBeta<N> {
    /// With both poles of drive k at `-bandwidth[k]` `[1/s]`.
    ///
    /// # Errors
    /// Bandwidths that are not positive and finite.
    pub fn try_new(bandwidth: [f64; N]) -> Result<Self, ConfigError> {
        ConfigError::unless_positive("bandwidth", &bandwidth)?;
        Ok(Self { bandwidth })
    }
}

impl<const N: usize> VelocityObserver<N> for AlphaBeta<N> {
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
            // z² − (2 − α − β)·z + (1 − α) = (z − p)².
            let p = math::exp(-self.bandwidth[k] * sample.dt);
            let (alpha, beta) = (1.0 - p * p, (1.0 - p) * (1.0 - p));
            correct(state, k, sample, [alpha, beta], 0.0);
        }
        state.v
    }
}

/// One drive's prediction at acceleration `a` and its correction by `alpha` and `beta` of the innovation.
pub(super) fn correct<const N: usize>(state: &mut Estimate<N>, k: usize, sample: &Sample<N>, [alpha, beta]: [f64; 2], a: f64) {
    let t = sample.dt;
    let q = state.q[k] + t * state.v[k] + 0.5 * t * t * a;
    let innovation = sample.q_meas[k] - q;
    state.q[k] = q + alpha * innovation;
    state.v[k] += t * a + beta / t * innovation;
}
