//! Velocity of drives that control it themselves \[Arceo2021, eq. 10\]: the integral of the accelerations sent, no position needed.
//!
//! With `v = b1·u` and `a_cmd` of the clipped voltage it is exactly the commanded velocity: no noise, and blind for what the drive does not
//! follow.

use super::{Estimate, Sample, VelocityObserver};

/// Integral of the accelerations sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CommandedVelocity;

impl<const N: usize> VelocityObserver<N> for CommandedVelocity {
    type State = Estimate<N>;

    fn at_rest(&self) -> Self::State {
        Estimate::default()
    }

    fn reset_to(&self, state: &mut Self::State, q: &[f64; N], v: &[f64; N]) {
        *state = Estimate::moving(q, v);
    }

    /// As if there had been no gap: it never looks at positions.
    fn resume(&self, state: &mut Self::State, sample: &Sample<N>, _v: &[f64; N]) -> [f64; N] {
        self.step(state, sample)
    }

    fn step(&self, state: &mut Self::State, sample: &Sample<N>) -> [f64; N] {
        if state.has_started {
            state.v = core::array::from_fn(|k| state.v[k] + sample.dt * sample.a_cmd[k]);
        }
        *state = Estimate::moving(&sample.q_meas, &state.v);
        state.v
    }
}
