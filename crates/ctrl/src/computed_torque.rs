//! Computed torque for trees and closed loops \[Valera2017, eq. 10-11\]: the model turns a commanded acceleration into efforts.
//!
//! `a_cmd = a_ref + kd·(v_ref − v̂) + kp·(q_ref − q)`, `tau = M·a_cmd + nle(q, v̂) + friction`, in the coordinates of the drives. The
//! velocity comes from any [`VelocityObserver`]; after saturation it is told the acceleration that the clipped efforts give.

use pkm_dyn::effects::Robot;

use crate::controller::{Command, ConfigError, Controller, Health, Input, clipped, must_be_finite, must_be_usable};
use crate::drive_model::{DriveModel, DriveModelState, NO_ACCELERATION};
use crate::fault::{Fault, FaultCode};
use crate::observer::{Gap, VelocityObserver};

/// Which velocity the friction that is compensated belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FrictionVelocity {
    /// Of the reference: no noise, and right as long as the robot follows.
    #[default]
    Reference,
    /// Of the observer: right also where the robot does not follow; noise about standstill switches dry friction.
    Estimate,
}

/// Numbers of a [`ComputedTorque`]; arrays have one entry per drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ComputedTorqueConfig<const N: usize> {
    /// Stiffness of the error dynamics `[1/s²]`.
    pub kp: [f64; N],
    /// Damping of the error dynamics `[1/s]`.
    pub kd: [f64; N],
    /// Largest effort of each drive `[N | N·m]`.
    pub tau_limit: [f64; N],
    /// Velocity at which friction is compensated.
    pub friction_velocity: FrictionVelocity,
    /// Speed below which compensated dry friction fades to zero `[m/s | rad/s]`; zero switches at standstill.
    pub creep: f64,
    /// Largest contradiction of the coordinates of surplus drives `[m | rad]`, beyond which an encoder must be wrong; may be infinite.
    pub misfit_limit: f64,
}

impl<const N: usize> ComputedTorqueConfig<N> {
    /// Error dynamics with both poles of every drive at `-bandwidth` `[1/s]`, efforts within `tau_limit` `[N | N·m]`.
    #[must_use]
    pub fn with_bandwidth(bandwidth: f64, tau_limit: [f64; N]) -> Self {
        Self {
            kp: [bandwidth * bandwidth; N],
            kd: [2.0 * bandwidth; N],
            tau_limit,
            friction_velocity: FrictionVelocity::Reference,
            creep: 0.0,
            misfit_limit: f64::INFINITY,
        }
    }

    fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_non_negative("kp", &self.kp)?;
        ConfigError::unless_non_negative("kd", &self.kd)?;
        ConfigError::unless_positive("tau_limit", &self.tau_limit)?;
        ConfigError::unless_non_negative("creep", &[self.creep])?;
        if self.misfit_limit.is_nan() || self.misfit_limit <= 0.0 {
            return Err(ConfigError { drive: 0, what: "misfit_limit", value: self.misfit_limit, limit: "must be > 0" });
        }
        Ok(())
    }
}

/// Computed torque with a velocity observer.
#[derive(Debug, Clone)]
pub struct ComputedTorque<const N: usize, O> {
    model: DriveModel<N>,
    observer: O,
    config: ComputedTorqueConfig<N>,
}

/// What a [`ComputedTorque`] remembers; `S` is its observer's state.
#[derive(Debug, Clone)]
pub struct ComputedTorqueState<const N: usize, S> {
    model: DriveModelState,
    observer: S,
    gap: Gap<N>,
    /// Velocity estimate `[m/s | rad/s]`.
    pub v_hat: [f64; N],
    /// Acceleration of the last command, after saturation `[m/s² | rad/s²]`.
    pub a_sent: [f64; N],
    tau_sent: [f64; N],
    tau_safe: [f64; N],
    has_started: bool,
    fault: Option<Fault>,
}

impl<const N: usize, O: VelocityObserver<N>> ComputedTorque<N, O> {
    /// On `robot`, velocities from `observer`.
    ///
    /// # Errors
    /// Gains that are negative, limits that are not positive, anything that is not finite, a robot without `N` drives, or one whose loops
    /// do not close at its assembly or leave a joint undriven.
    pub fn try_new(robot: Robot, observer: O, config: ComputedTorqueConfig<N>) -> Result<Self, ConfigError> {
        config.check()?;
        let model = DriveModel::try_new(robot)?.with_creep(config.creep).with_misfit_limit(config.misfit_limit);
        Ok(Self { model, observer, config })
    }

    /// The state of a controller that takes over a robot in motion: positions `q` `[m | rad]`, velocities `v` `[m/s | rad/s]`. Allocates.
    #[must_use]
    pub fn in_motion(&self, q: &[f64; N], v: &[f64; N]) -> ComputedTorqueState<N, O::State> {
        let mut state = self.at_rest();
        self.observer.reset_to(&mut state.observer, q, v);
        state.has_started = true;
        state
    }

    fn attempt(&self, state: &mut ComputedTorqueState<N, O::State>, input: &Input<N>) -> Result<Command<N>, Fault> {
        let signals = [&input.q_meas, &input.q_ref, &input.v_ref, &input.a_ref];
        must_be_usable(&signals, input.dt)?;
        if !state.has_started {
            self.observer.reset_to(&mut state.observer, &input.q_meas, &[0.0; N]);
            state.has_started = true;
        }
        state.v_hat = state.gap.observe(&self.observer, &mut state.observer, input, [state.a_sent, state.tau_sent]);
        let a: [f64; N] = core::array::from_fn(|k| {
            input.a_ref[k] + self.config.kd[k] * (input.v_ref[k] - state.v_hat[k]) + self.config.kp[k] * (input.q_ref[k] - input.q_meas[k])
        });
        must_be_finite(FaultCode::CommandNotFinite, &[&state.v_hat, &a])?;
        let v_friction = match self.config.friction_velocity {
            FrictionVelocity::Reference => input.v_ref,
            FrictionVelocity::Estimate => state.v_hat,
        };
        let wanted = self.model.effort(&mut state.model, [&input.q_meas, &state.v_hat, &a], &v_friction)?;
        let (tau, is_saturated) = clipped(&wanted, &self.config.tau_limit);
        state.a_sent = a;
        if is_saturated {
            // The linear observer's model is "what is sent is what happens": it must hear what the clipped efforts make of it.
            let lost = core::array::from_fn(|k| tau[k] - wanted[k]);
            let change = self.model.acceleration_of(&mut state.model, &lost).ok_or(NO_ACCELERATION)?;
            state.a_sent = core::array::from_fn(|k| a[k] + change[k]);
        }
        state.tau_sent = tau;
        Ok(Command { tau, health: Health { is_saturated, ..Health::default() } })
    }
}

impl<const N: usize, O: VelocityObserver<N>> Controller<N> for ComputedTorque<N, O> {
    type State = ComputedTorqueState<N, O::State>;

    fn at_rest(&self) -> Self::State {
        let zero = [0.0; N];
        ComputedTorqueState {
            model: self.model.at_rest(),
            observer: self.observer.at_rest(),
            gap: Gap::default(),
            v_hat: zero,
            a_sent: zero,
            tau_sent: zero,
            tau_safe: zero,
            has_started: false,
            fault: None,
        }
    }

    /// One period; the feed-forward effort is not used. The first one follows the model from its assembly to the measured pose, which
    /// takes some forty times as long as those after it.
    ///
    /// On a fault (a number that is not finite, loops that do not close, an encoder of a surplus drive that contradicts the others) the
    /// command is the weight at the last good pose, clipped: it carries the robot and pushes no further. Zero before any good pose.
    fn step(&self, state: &mut Self::State, input: &Input<N>) -> Command<N> {
        if state.fault.is_none() {
            match self.attempt(state, input) {
                Ok(command) => return command,
                Err(fault) => state.fault = Some(fault),
            }
            let weight = self.model.weight(&mut state.model).unwrap_or([0.0; N]);
            state.tau_safe = clipped(&weight, &self.config.tau_limit).0;
        }
        Command::faulted(state.tau_safe, state.fault)
    }
}
