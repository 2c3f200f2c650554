//! Explicit force control, drive by drive: `tau = tau_ref + PID(tau_ref − tau_meas)`, with `tau_ref` the effort that is wanted (`tau_ff`).

use crate::controller::{Command, ConfigError, Controller, Health, Input};
use crate::fault::{Acted, Limit};
use crate::force::pid::{ForcePid, ForcePidConfig, ForcePidState};

/// Numbers of an [`ExplicitForce`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExplicitForceConfig<const N: usize> {
    /// The loop around each drive's effort; its output is an effort `[N | N·m]`.
    pub pid: ForcePidConfig<N>,
    /// Largest effort of each drive `[N | N·m]`.
    pub tau_limit: [f64; N],
}

/// A PID loop around the measured effort of each drive. The wanted effort is `tau_ff`; positions are not looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExplicitForce<const N: usize> {
    pid: ForcePid<N>,
    tau_limit: [f64; N],
}

/// What an [`ExplicitForce`] remembers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExplicitForceState<const N: usize> {
    pid: ForcePidState<N>,
    tau_safe: [f64; N],
    is_faulted: bool,
}

/// Refuses efforts that are no limits.
pub(crate) fn check_limits(what: &'static str, limits: &[f64]) -> Result<(), ConfigError> {
    match limits.iter().position(|x| !(x.is_finite() && *x > 0.0)) {
        Some(drive) => Err(ConfigError { drive, what, value: limits[drive], limit: "must be finite and > 0" }),
        None => Ok(()),
    }
}

impl<const N: usize> ExplicitForce<N> {
    /// Checks the numbers.
    ///
    /// # Errors
    /// What [`ForcePid::try_new`] refuses; limits that are not finite and positive.
    pub fn try_new(config: ExplicitForceConfig<N>) -> Result<Self, ConfigError> {
        check_limits("tau_limit", &config.tau_limit)?;
        Ok(Self { pid: ForcePid::try_new(config.pid)?, tau_limit: config.tau_limit })
    }
}

/// `tau` inside `limit`, and what was clipped in `health`.
pub(crate) fn clipped<const N: usize>(tau: &[f64; N], limit: &[f64; N], health: &mut Health) -> [f64; N] {
    core::array::from_fn(|k| {
        if tau[k].abs() > limit[k] {
            health.is_saturated = true;
            health.acted.note(Limit::Effort, k);
        }
        tau[k].clamp(-limit[k], limit[k])
    })
}

/// The answer of a controller that has stopped.
pub(crate) fn stopped<const N: usize>(tau: [f64; N]) -> Command<N> {
    Command { tau, health: Health { is_faulted: true, is_saturated: false, acted: Acted::default(), fault: None } }
}

impl<const N: usize> Controller<N> for ExplicitForce<N> {
    type State = ExplicitForceState<N>;

    const FOLLOWS_REFERENCE: bool = false;

    fn at_rest(&self) -> Self::State {
        ExplicitForceState { pid: ForcePidState::default(), tau_safe: [0.0; N], is_faulted: false }
    }

    /// One period. On a fault the command is the last finite wanted effort, without feedback.
    fn step(&self, state: &mut Self::State, input: &Input<N>) -> Command<N> {
        state.is_faulted |= [&input.tau_meas, &input.tau_ff].into_iter().flatten().any(|x| !x.is_finite());
        if state.is_faulted {
            return stopped(state.tau_safe);
        }
        let mut health = Health::default();
        let error = core::array::from_fn(|k| input.tau_ff[k] - input.tau_meas[k]);
        let (correction, _) = self.pid.step(&mut state.pid, &error, input.dt);
        let tau = core::array::from_fn(|k| input.tau_ff[k] + correction[k]);
        let tau = clipped(&tau, &self.tau_limit, &mut health);
        state.tau_safe = core::array::from_fn(|k| input.tau_ff[k].clamp(-self.tau_limit[k], self.tau_limit[k]));
        Command { tau, health }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn controller() -> ExplicitForce<2> {
        let two = |x| [x; 2];
        let pid = ForcePidConfig {
            kp: two(0.5),
            ki: two(20.0),
            kd: two(0.0),
            output_limit: two(40.0),
            rate_limit: two(1e4),
            filter_s: 0.0,
            dt: 1e-3,
        };
        ExplicitForce::try_new(ExplicitForceConfig { pid, tau_limit: [100.0, 30.0] }).unwrap()
    }

    #[test]
    fn friction_in_the_drive_is_found_and_made_up_for() {
        let (controller, friction) = (controller(), [12.0, -5.0]);
        let mut state = controller.at_rest();
        let (mut measured, wanted) = ([0.0; 2], [50.0, -20.0]);
        for _ in 0..2000 {
            let input = Input { tau_meas: measured, tau_ff: wanted, ..Input::standing([0.0; 2], 1e-3) };
            let command = controller.step(&mut state, &input);
            assert!(!command.health.is_faulted);
            for k in 0..2 {
                measured[k] += 0.2 * (command.tau[k] - friction[k] - measured[k]);
            }
        }
        assert!((measured[0] - 50.0).abs() < 1e-3 && (measured[1] + 20.0).abs() < 1e-3, "{measured:?}");
    }

    #[test]
    fn limits_are_kept_and_a_sensor_that_says_nothing_latches_a_fault() {
        let controller = controller();
        let mut state = controller.at_rest();
        let mut input = Input { tau_ff: [20.0, 500.0], ..Input::standing([0.0; 2], 1e-3) };
        let command = controller.step(&mut state, &input);
        assert!((command.tau[1] - 30.0).abs() < 1e-15 && command.health.is_saturated && command.health.acted.at(Limit::Effort, 1));
        input.tau_meas[0] = f64::NAN;
        for _ in 0..2 {
            let command = controller.step(&mut state, &input);
            assert_eq!((command.tau, command.health.is_faulted), ([20.0, 30.0], true));
            input.tau_meas[0] = 0.0;
        }
    }
}
