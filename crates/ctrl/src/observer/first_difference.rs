//! First difference of the position over the period: no lag but half a period, and all the noise, `√2/dt` of it.

use super::{Estimate, Sample, VelocityObserver};

/// Difference of the last two positions over the time between them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FirstDifference;

impl<const N: usize> VelocityObserver<N> for FirstDifference {
    type State = Estimate<N>;

    fn at_rest(&self) -> Self::State {
        Estimate::default()
    }

    fn reset_to(&self, state: &mut Self::State, q: &[f64; N], v: &[f64; N]) {
        *state = Estimate::moving(q, v);
    }

    fn step(&self, state: &mut Self::State, sample: &Sample<N>) -> [f64; N] {
        if state.has_started {
            state.v = core::array::from_fn(|k| (sample.q_meas[k] - state.q[k]) / sample.dt);
        }
        *state = Estimate::moving(&sample.q_meas, &state.v);
        state.v
    }
}
