//! What every controller is: numbers in `self`, state outside, a step that always answers.

use crate::fault::{Acted, Fault, FaultCode};

/// What a controller sees in one period; one entry per drive. A controller reads what its law needs and nothing else.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Input<const N: usize> {
    /// Time since the last step `[s]`: the control period, or several of them after an overrun.
    pub dt: f64,
    /// Time from the last measured positions to these, by the stamps of both `[s]`; zero where these are not new: repeated, or carried on over
    /// a gap. The loop vouches that it is no longer than what has passed since by a clock of its own.
    pub q_dt: f64,
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
    /// Standing at `q` `[m | rad]` and wanting to, no forces, measured a period of `dt` `[s]` after the last time.
    #[must_use]
    pub fn standing(q: [f64; N], dt: f64) -> Self {
        let zero = [0.0; N];
        Self {
            dt,
            q_dt: dt,
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
    /// A number that was not finite came in, or the model's loops did not close, now or earlier: the command is the safe one until the
    /// state is made anew.
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
    /// Efforts for the drives `[N | N·m]`, or voltages `[V]` where the controller says so; always finite and inside their limits.
    pub tau: [f64; N],
    /// How the step went.
    pub health: Health,
}

/// A controller of `N` drives.
pub trait Controller<const N: usize> {
    /// Whether it goes where `q_ref` says: one that does not cannot be led by its reference.
    const FOLLOWS_REFERENCE: bool = true;

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

impl ConfigError {
    /// Refuses the first of `values` that is not finite or below zero.
    pub(crate) fn unless_non_negative(what: &'static str, values: &[f64]) -> Result<(), Self> {
        Self::unless(what, values, "must be finite and >= 0", |x| x.is_finite() && x >= 0.0)
    }

    /// Refuses the first of `values` that is not finite or not above zero.
    pub(crate) fn unless_positive(what: &'static str, values: &[f64]) -> Result<(), Self> {
        Self::unless(what, values, "must be finite and > 0", |x| x.is_finite() && x > 0.0)
    }

    fn unless(what: &'static str, values: &[f64], limit: &'static str, is_good: impl Fn(f64) -> bool) -> Result<(), Self> {
        match values.iter().position(|&x| !is_good(x)) {
            Some(drive) => Err(Self { drive, what, value: values[drive], limit }),
            None => Ok(()),
        }
    }
}

impl<const N: usize> Command<N> {
    /// The safe command of a controller whose fault has latched.
    pub(crate) fn faulted(tau: [f64; N], fault: Option<Fault>) -> Self {
        Self { tau, health: Health { is_faulted: true, fault, ..Health::default() } }
    }
}

/// The first number of the first signal that is not finite.
pub(crate) fn first_not_finite(signals: &[(FaultCode, &[f64])]) -> Option<Fault> {
    let in_one = |(code, values): &(FaultCode, &[f64])| {
        let drive = values.iter().position(|x| !x.is_finite())?;
        Some(Fault { code: *code, drive, value: values[drive], limit: 0.0 })
    };
    signals.iter().find_map(in_one)
}

/// Refuses a signal with a number that is not finite, and a period that is no positive number.
pub(crate) fn must_be_usable<const N: usize>(signals: &[&[f64; N]], dt: f64) -> Result<(), Fault> {
    must_be_finite(FaultCode::InputNotFinite, signals)?;
    if dt.is_finite() && dt > 0.0 { Ok(()) } else { Err(Fault { code: FaultCode::Period, drive: 0, value: dt, limit: 0.0 }) }
}

/// Refuses a signal with a number that is not finite.
pub(crate) fn must_be_finite<const N: usize>(code: FaultCode, signals: &[&[f64; N]]) -> Result<(), Fault> {
    signals.iter().find_map(|signal| first_not_finite(&[(code, signal.as_slice())])).map_or(Ok(()), Err)
}

/// Every entry within plus and minus its limit, and whether one was outside.
pub(crate) fn clipped<const N: usize>(wanted: &[f64; N], limit: &[f64; N]) -> ([f64; N], bool) {
    let out: [f64; N] = core::array::from_fn(|k| wanted[k].clamp(-limit[k], limit[k]));
    (out, (0..N).any(|k| wanted[k].abs() > limit[k]))
}
