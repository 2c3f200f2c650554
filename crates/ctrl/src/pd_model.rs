//! Joint PD that finds the weight itself: `tau = weight(q) + kp·(q_ref − q) + kd·(v_ref − v̂)`, the weight from the robot's model at the
//! measured pose, loops closed, springs and other effects at rest included.

use pkm_dyn::effects::Robot;

use crate::controller::{Command, ConfigError, Controller, Health, Input, clipped, must_be_finite, must_be_usable};
use crate::drive_model::{DriveModel, DriveModelState};
use crate::fault::{Fault, FaultCode};
use crate::observer::{Gap, VelocityObserver};

/// Numbers of a [`PdModel`]; arrays have one entry per drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PdModelConfig<const N: usize> {
    /// Stiffness of the position loop `[N/m | N·m/rad]`.
    pub kp: [f64; N],
    /// Damping of the position loop `[N·s/m | N·m·s/rad]`.
    pub kd: [f64; N],
    /// Largest effort of each drive `[N | N·m]`.
    pub tau_limit: [f64; N],
}

/// Joint PD with the weight of the model.
#[derive(Debug, Clone)]
pub struct PdModel<const N: usize, O> {
    model: DriveModel<N>,
    observer: O,
    config: PdModelConfig<N>,
}

/// What a [`PdModel`] remembers; `S` is its observer's state.
#[derive(Debug, Clone)]
pub struct PdModelState<const N: usize, S> {
    model: DriveModelState,
    observer: S,
    gap: Gap<N>,
    tau_sent: [f64; N],
    a_ref_last: [f64; N],
    tau_safe: [f64; N],
    has_started: bool,
    fault: Option<Fault>,
}

impl<const N: usize, O: VelocityObserver<N>> PdModel<N, O> {
    /// On `robot`, velocities from `observer`.
    ///
    /// # Errors
    /// Gains that are negative, limits that are not positive, anything that is not finite, a robot without `N` drives, or one whose loops
    /// do not close at its assembly or leave a joint undriven.
    pub fn try_new(robot: Robot, observer: O, config: PdModelConfig<N>) -> Result<Self, ConfigError> {
        ConfigError::unless_non_negative("kp", &config.kp)?;
        ConfigError::unless_non_negative("kd", &config.kd)?;
        ConfigError::unless_positive("tau_limit", &config.tau_limit)?;
        Ok(Self { model: DriveModel::try_new(robot)?, observer, config })
    }

    fn attempt(&self, state: &mut PdModelState<N, O::State>, input: &Input<N>) -> Result<Command<N>, Fault> {
        must_be_usable(&[&input.q_meas, &input.q_ref, &input.v_ref, &input.a_ref], input.dt)?;
        if !state.has_started {
            self.observer.reset_to(&mut state.observer, &input.q_meas, &[0.0; N]);
            state.has_started = true;
        }
        // No acceleration is commanded; the reference's is the best guess of what was sent.
        let v_hat = state.gap.observe(&self.observer, &mut state.observer, input, [state.a_ref_last, state.tau_sent]);
        let zero = [0.0; N];
        let weight = self.model.effort(&mut state.model, [&input.q_meas, &zero, &zero], &zero)?;
        let wanted: [f64; N] = core::array::from_fn(|k| {
            weight[k] + self.config.kp[k] * (input.q_ref[k] - input.q_meas[k]) + self.config.kd[k] * (input.v_ref[k] - v_hat[k])
        });
        must_be_finite(FaultCode::CommandNotFinite, &[&wanted])?;
        let (tau, is_saturated) = clipped(&wanted, &self.config.tau_limit);
        (state.tau_sent, state.a_ref_last) = (tau, input.a_ref);
        state.tau_safe = clipped(&weight, &self.config.tau_limit).0;
        Ok(Command { tau, health: Health { is_saturated, ..Health::default() } })
    }
}

impl<const N: usize, O: VelocityObserver<N>> Controller<N> for PdModel<N, O> {
    type State = PdModelState<N, O::State>;

    fn at_rest(&self) -> Self::State {
        let zero = [0.0; N];
        PdModelState {
            model: self.model.at_rest(),
            observer: self.observer.at_rest(),
            gap: Gap::default(),
            tau_sent: zero,
            a_ref_last: zero,
            tau_safe: zero,
            has_started: false,
            fault: None,
        }
    }

    /// One period; the feed-forward effort is not used. On a fault the command is the weight at the last good pose; zero before any.
    fn step(&self, state: &mut Self::State, input: &Input<N>) -> Command<N> {
        if state.fault.is_none() {
            match self.attempt(state, input) {
                Ok(command) => return command,
                Err(fault) => state.fault = Some(fault),
            }
        }
        Command::faulted(state.tau_safe, state.fault)
    }
}
