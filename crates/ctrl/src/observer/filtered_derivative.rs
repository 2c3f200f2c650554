//! First difference through a first-order low-pass, discretised exactly.

use super::{Estimate, Sample, VelocityObserver};
use crate::controller::ConfigError;
use crate::filter::low_pass_share;

/// Difference of positions, low-passed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilteredDerivative<const N: usize> {
    time_s: [f64; N],
}

impl<const N: usize> FilteredDerivative<N> {
    /// With time constants `time_s` `[s]`, one per drive; zero is the plain difference.
    ///
    /// # Errors
    /// Time constants that are negative or not finite.
    pub fn try_new(time_s: [f64; N]) -> Result<Self, ConfigError> {
        ConfigError::unless_non_negative("time_s", &time_s)?;
        Ok(Self { time_s })
    }
}

impl<const N: usize> VelocityObserver<N> for FilteredDerivative<N> {
    type State = Estimate<N>;

    fn at_rest(&self) -> Self::State {
        Estimate::default()
    }

    fn reset_to(&self, state: &mut Self::State, q: &[f64; N], v: &[f64; N]) {
        *state = Estimate::moving(q, v);
    }

    fn step(&self, state: &mut Self::State, sample: &Sample<N>) -> [f64; N] {
        if state.has_started {
            for k in 0..N {
                let difference = (sample.q_meas[k] - state.q[k]) / sample.dt;
                state.v[k] += low_pass_share(self.time_s[k], sample.dt) * (difference - state.v[k]);
            }
        }
        *state = Estimate::moving(&sample.q_meas, &state.v);
        state.v
    }
}
