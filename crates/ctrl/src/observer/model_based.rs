//! Berghuis and Nijmeijer's velocity observer with the robot in it \[Berghuis1993; Valera2017, eq. 10\]:
//! `z' = M⁻¹·(tau − C(q, q̂')·q̂' − g − friction) + l_p·q̃`.
//!
//! It needs the efforts that acted, whoever computed them, and no acceleration: for robots under PID or PD.

use pkm_dyn::effects::Robot;

use super::{CommandedAcceleration, Discretisation, Prediction, Sample, VelocityObserver};
use crate::controller::ConfigError;
use crate::drive_model::{DriveModel, DriveModelState};

/// Nonlinear model-based velocity observer.
#[derive(Debug, Clone)]
pub struct ModelBased<const N: usize> {
    model: DriveModel<N>,
    linear: CommandedAcceleration<N>,
}

/// What a [`ModelBased`] remembers.
#[derive(Debug, Clone)]
pub struct ModelBasedState<const N: usize> {
    model: DriveModelState,
    prediction: Prediction<N>,
    q_last: [f64; N],
    v_hat: [f64; N],
}

impl<const N: usize> ModelBased<N> {
    /// On `robot`, with `l_d = 2·bandwidth` and `l_p = bandwidth²`, `bandwidth` `[1/s]` one per drive.
    ///
    /// # Errors
    /// Bandwidths that are not positive and finite, a robot without `N` drives, or one whose loops do not close.
    pub fn try_new(robot: Robot, bandwidth: [f64; N], discretisation: Discretisation) -> Result<Self, ConfigError> {
        Ok(Self { model: DriveModel::try_new(robot)?, linear: CommandedAcceleration::try_new(bandwidth, discretisation)? })
    }

    /// Acceleration of the drives under `tau` at the pose and velocity of the last sample; `None` where the model has none.
    fn acceleration(&self, state: &mut ModelBasedState<N>, tau: &[f64; N]) -> Option<[f64; N]> {
        let v = state.v_hat;
        let at_rest = self.model.effort(&mut state.model, [&state.q_last, &v, &[0.0; N]], &v).ok()?;
        let left = core::array::from_fn(|k| tau[k] - at_rest[k]);
        self.model.acceleration_of(&mut state.model, &left)
    }
}

impl<const N: usize> VelocityObserver<N> for ModelBased<N> {
    type State = ModelBasedState<N>;

    fn at_rest(&self) -> Self::State {
        let prediction = Prediction::default();
        ModelBasedState { model: self.model.at_rest(), prediction, q_last: [0.0; N], v_hat: [0.0; N] }
    }

    fn reset_to(&self, state: &mut Self::State, q: &[f64; N], v: &[f64; N]) {
        self.linear.reset_to(&mut state.prediction, q, v);
        (state.q_last, state.v_hat) = (*q, *v);
    }

    /// Where the model's loops do not close the acceleration counts as zero for that period.
    fn step(&self, state: &mut Self::State, sample: &Sample<N>) -> [f64; N] {
        let a = if state.prediction.has_started { self.acceleration(state, &sample.tau).unwrap_or([0.0; N]) } else { [0.0; N] };
        state.v_hat = self.linear.advance(&mut state.prediction, sample, &a);
        state.prediction.has_started = true;
        state.q_last = sample.q_meas;
        state.v_hat
    }
}
