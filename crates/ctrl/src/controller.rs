//! What every controller is: numbers in `self`, state outside, a step that always answers.

/// What a controller sees in one period; one entry per drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Input<const N: usize> {
    /// Measured positions `[m | rad]`.
    pub q_meas: [f64; N],
    /// Wanted positions `[m | rad]`.
    pub q_ref: [f64; N],
    /// Wanted velocities `[m/s | rad/s]`.
    pub v_ref: [f64; N],
    /// Effort the model asks for, weight at least `[N | N·m]`.
    pub tau_ff: [f64; N],
}

/// How a step went.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Health {
    /// A number that was not finite came in, now or earlier: the command is the safe one until the state is made anew.
    pub is_faulted: bool,
    /// At least one effort was clipped at its limit.
    pub is_saturated: bool,
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
    /// What changes from step to step; its default is a controller at rest.
    type State: Default;

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
