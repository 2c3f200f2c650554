//! Berghuis and Nijmeijer's velocity observer in its linear form \[Berghuis1993; Valera2017, eq. 14\]: the robot under computed torque is a double
//! integrator of the acceleration sent, and that is all the model there is.
//!
//! `q̂' = z + l_d·q̃`, `z' = a_cmd + l_p·q̃`, `q̃ = q_meas − q̂`; the estimate of the velocity is q̂', not z, and `a_cmd` is what the drives
//! were *let* have: eq. 14 holds only while no effort is clipped. With a wrong model the missing acceleration is a disturbance.

use pkm_dyn::math;

use super::{Sample, VelocityObserver};
use crate::controller::ConfigError;

/// How the observer is brought to samples; both put the two poles of a drive together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Discretisation {
    /// Forward differences, poles at `1 − bandwidth·dt`: the paper's. Unstable from `bandwidth·dt = 2`.
    Euler,
    /// Exact for an acceleration that is constant over a period, poles at `exp(−bandwidth·dt)`.
    #[default]
    ZeroOrderHold,
}

/// Linear model-based velocity observer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CommandedAcceleration<const N: usize> {
    bandwidth: [f64; N],
    discretisation: Discretisation,
}

impl<const N: usize> CommandedAcceleration<N> {
    /// With `l_d = 2·bandwidth` and `l_p = bandwidth²`, `bandwidth` `[1/s]` one per drive.
    ///
    /// # Errors
    /// Bandwidths that are not positive and finite.
    pub fn try_new(bandwidth: [f64; N], discretisation: Discretisation) -> Result<Self, ConfigError> {
        ConfigError::unless_positive("bandwidth", &bandwidth)?;
        Ok(Self { bandwidth, discretisation })
    }

    /// One period of every drive at the accelerations that acted `[m/s² | rad/s²]`; the velocities `[m/s | rad/s]`.
    pub(super) fn advance(&self, state: &mut Prediction<N>, sample: &Sample<N>, a: &[f64; N]) -> [f64; N] {
        let dt = sample.dt;
        core::array::from_fn(|k| {
            // Poles at p of forward differences: 1 − p = bandwidth·dt there, 1 − exp(−bandwidth·dt) here.
            let (rate, half) = match self.discretisation {
                Discretisation::Euler => (self.bandwidth[k], 0.0),
                Discretisation::ZeroOrderHold => ((1.0 - math::exp(-self.bandwidth[k] * dt)) / dt, 0.5 * dt * dt),
            };
            let (l_d, l_p) = (2.0 * rate, rate * rate);
            if state.has_started {
                let gap = state.gap[k];
                state.q[k] += dt * (state.z[k] + l_d * gap) + half * a[k];
                state.z[k] += dt * (a[k] + l_p * gap);
            } else {
                state.q[k] = sample.q_meas[k];
            }
            state.gap[k] = sample.q_meas[k] - state.q[k];
            state.z[k] + l_d * state.gap[k]
        })
    }
}

/// What a [`CommandedAcceleration`] remembers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction<const N: usize> {
    /// Position foretold for the last sample, q̂ `[m | rad]`.
    pub q: [f64; N],
    /// Second state, z `[m/s | rad/s]`.
    pub z: [f64; N],
    /// Measured minus foretold position at the last sample, q̃ `[m | rad]`.
    pub gap: [f64; N],
    /// Whether there was a sample, or a start from known motion.
    pub has_started: bool,
}

impl<const N: usize> Default for Prediction<N> {
    fn default() -> Self {
        Self { q: [0.0; N], z: [0.0; N], gap: [0.0; N], has_started: false }
    }
}

impl<const N: usize> VelocityObserver<N> for CommandedAcceleration<N> {
    type State = Prediction<N>;

    fn at_rest(&self) -> Self::State {
        Prediction::default()
    }

    fn reset_to(&self, state: &mut Self::State, q: &[f64; N], v: &[f64; N]) {
        *state = Prediction { q: *q, z: *v, gap: [0.0; N], has_started: true };
    }

    fn step(&self, state: &mut Self::State, sample: &Sample<N>) -> [f64; N] {
        let v_hat = self.advance(state, sample, &sample.a_cmd);
        state.has_started = true;
        v_hat
    }
}
