//! What every controller is: numbers in `self`, state outside, a step that always answers.

use crate::fault::{Acted, Fault};

/// What a controller sees in one period; one entry per drive. A controller reads what its law needs and nothing else.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Input<const N: usize> {
    /// Time since the last step `[s]`: the control period, or several of them after an overrun.
    pub dt: f64,
    /// Measured positions `[m | rad]`.
    pub q_meas: [f64; N],
    /// Measured efforts of the drives `[N | N·m]`; zero where there is no sensor.
    pub tau_meas: [f64; N],
    /// Measured wrench of the environment on the robot, force first `[N, N·m]`; zero where there is no sensor.
    pub wrench_meas: [f64; 6],
    /// Wanted positions `[m | rad]`.
    pub q_ref: [f64; N],
    /// Wanted velocities `[m/s | rad/s]`.
    pub v_ref: [f64; N],
    /// Wanted accelerations `[m/s² | rad/s²]`.
    pub a_ref: [f64; N],
    /// Wanted wrench of the environment on the robot, force first `[N, N·m]`.
    pub wrench_ref: [f64; 6],
    /// Effort the model asks for, weight at least `[N | N·m]`.
    pub tau_ff: [f64; N],
}

impl<const N: usize> Input<N> {
    /// Standing at `q` `[m | rad]` and wanting to, no forces, after a period of `dt` `[s]`.
    #[must_use]
    pub fn standing(q: [f64; N], dt: f64) -> Self {
        let zero = [0.0; N];
        Self {
            dt,
            q_meas: q,
            tau_meas: zero,
            wrench_meas: [0.0; 6],
            q_ref: q,
            v_ref: zero,
            a_ref: zero,
            wrench_ref: [0.0; 6],
            tau_ff: zero,
        }
    }
}

/// How a step went.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Health {
    /// A number that was not finite came in, now or earlier: the command is the safe one until the state is made anew.
    pub is_faulted: bool,
    /// At least one effort was clipped at its limit.
    pub is_saturated: bool,
    /// Which limits acted at which drive; empty for a controller that does not say.
    pub acted: Acted,
    /// The fault that stopped the robot, where the controller says which.
    pub fault: Option<Fault>,
}

/// What a controller answers.
#[derive(Debug, Clone, Copy, PartialEq)]
#[must_use]
pub struct Command<const N: usize> {
    /// Efforts for the drives `[N | N·m]`; always finite and inside their limits.
    pub tau: [f64; N],
    /// How the step went.
    pub health: Health,
}

/// A controller of `N` drives.
pub trait Controller<const N: usize> {
    /// What changes from step to step.
    type State;

    /// The state of a controller at rest, before its first step. The one place that may allocate.
    fn at_rest(&self) -> Self::State;

    /// One period: never fails, never allocates, never blocks.
    fn step(&self, state: &mut Self::State, input: &Input<N>) -> Command<N>;
}

/// A number in a controller's configuration that cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("drive {drive}: {what} = {value} ({limit})")]
pub struct ConfigError {
    /// Which drive, from zero; zero for a number of the whole controller.
    pub drive: usize,
    /// Which number.
    pub what: &'static str,
    /// Its value.
    pub value: f64,
    /// What is allowed.
    pub limit: &'static str,
}
