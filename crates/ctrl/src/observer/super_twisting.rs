//! Robust exact differentiator by super-twisting \[Levant1998\]: exact in finite time for signals whose second derivative is bounded.

use pkm_dyn::math;

use super::{Estimate, Sample, VelocityObserver};
use crate::controller::ConfigError;

/// Gains over the root of the bound and over the bound: the usual choice \[Levant1998\].
const ROOT_GAIN: f64 = 1.5;
const SIGN_GAIN: f64 = 1.1;

/// Sliding-mode differentiator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SuperTwisting<const N: usize> {
    a_bound: [f64; N],
}

impl<const N: usize> SuperTwisting<N> {
    /// For accelerations within plus and minus `a_bound` `[m/s² | rad/s²]`; a bound too large costs noise, one too small costs convergence.
    ///
    /// # Errors
    /// Bounds that are not positive and finite.
    pub fn try_new(a_bound: [f64; N]) -> Result<Self, ConfigError> {
        ConfigError::unless_positive("a_bound", &a_bound)?;
        Ok(Self { a_bound })
    }
}

impl<const N: usize> VelocityObserver<N> for SuperTwisting<N> {
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
            // Predict to now, then let the error there act for one period: the error of the last sample is known nowhere else.
            state.q[k] += sample.dt * state.v[k];
            let (bound, error) = (self.a_bound[k], state.q[k] - sample.q_meas[k]);
            let side = math::sign(error);
            state.q[k] -= sample.dt * ROOT_GAIN * math::sqrt(bound * error.abs()) * side;
            state.v[k] -= sample.dt * SIGN_GAIN * bound * side;
        }
        state.v
    }
}
