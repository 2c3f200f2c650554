//! Observers: velocities from positions, and efforts from outside that no sensor sees.
//!
//! A velocity observer takes one [`Sample`] per period: the position measured now, and what was sent since the sample before. The command
//! of this period is computed from the estimate, so feeding that back would close an algebraic loop. What acted is what is fed back: after
//! saturation the *saturated* acceleration, else the observer winds up.
//!
//! | observer | knows | state |
//! |---|---|---|
//! | [`FirstDifference`] | nothing | last position |
//! | [`FilteredDerivative`] | nothing | the same and a low-pass |
//! | [`AlphaBeta`] | constant velocity | position, velocity |
//! | [`Kalman`] | the acceleration sent, its error, the noise | position, velocity |
//! | [`SuperTwisting`] | a bound of the acceleration | position, velocity |
//! | [`CommandedAcceleration`] | the acceleration sent | position, velocity |
//! | [`CommandedVelocity`] | the acceleration sent, and nothing measured | velocity |
//! | [`ModelBased`] | the robot and the efforts sent | position, velocity, the model's pose |
//! | [`ExtendedState`] | the acceleration sent; estimates what was missing in it | position, velocity, missing acceleration |
//!
//! Rates of convergence are given as bandwidths; poles are exact for the `dt` of every sample, also after an overrun. Numbers that are not
//! finite pass through: the controller above latches a fault. Behind a gap in the measurements that it cannot have followed an observer goes
//! on from the mean speed over it ([`VelocityObserver::resume`]).

mod alpha_beta;
mod commanded_acceleration;
mod commanded_velocity;
mod extended_state;
mod filtered_derivative;
mod first_difference;
mod gap;
mod kalman;
mod model_based;
mod momentum;
mod nonlinear_extended_state;
mod super_twisting;

pub use alpha_beta::AlphaBeta;
pub use commanded_acceleration::{CommandedAcceleration, Discretisation, Prediction};
pub use commanded_velocity::CommandedVelocity;
pub use extended_state::{ExtendedState, ExtendedStateEstimate, LinearEso};
pub use filtered_derivative::FilteredDerivative;
pub use first_difference::FirstDifference;
pub(crate) use gap::Gap;
pub use kalman::Kalman;
pub use model_based::{ModelBased, ModelBasedState};
pub use momentum::{MomentumObserver, MomentumObserverConfig, MomentumObserverState, Outside};
pub use nonlinear_extended_state::NonlinearEso;
pub use super_twisting::SuperTwisting;

/// What a velocity observer sees in one period; one entry per drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample<const N: usize> {
    /// Positions measured now `[m | rad]`.
    pub q_meas: [f64; N],
    /// Accelerations sent since the last sample, after saturation `[m/s² | rad/s²]`; zero where nothing is known of them.
    pub a_cmd: [f64; N],
    /// Efforts sent since the last sample, after saturation `[N | N·m]`.
    pub tau: [f64; N],
    /// Time since the last sample `[s]`, above zero.
    pub dt: f64,
}

/// An estimator of the drives' velocities: its numbers in `self`, what changes from sample to sample outside.
pub trait VelocityObserver<const N: usize> {
    /// What changes from sample to sample.
    type State;

    /// The state before the first sample, which then counts as standing still. The one place that may allocate.
    fn at_rest(&self) -> Self::State;

    /// Starts anew from positions `q` `[m | rad]` in motion at `v` `[m/s | rad/s]`.
    fn reset_to(&self, state: &mut Self::State, q: &[f64; N], v: &[f64; N]);

    /// Goes on after a gap in the measurements that it cannot have followed, over which drives moved at `v` `[m/s | rad/s]` in the mean;
    /// the velocities now. Never fails, never allocates.
    fn resume(&self, state: &mut Self::State, sample: &Sample<N>, v: &[f64; N]) -> [f64; N] {
        self.reset_to(state, &sample.q_meas, v);
        *v
    }

    /// Takes one sample; the velocities `[m/s | rad/s]`. Never fails, never allocates.
    fn step(&self, state: &mut Self::State, sample: &Sample<N>) -> [f64; N];
}

/// Position and velocity of every drive as an observer has them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate<const N: usize> {
    /// Positions `[m | rad]`.
    pub q: [f64; N],
    /// Velocities `[m/s | rad/s]`.
    pub v: [f64; N],
    /// Whether there was a sample, or a start from known motion.
    pub has_started: bool,
}

impl<const N: usize> Default for Estimate<N> {
    fn default() -> Self {
        Self { q: [0.0; N], v: [0.0; N], has_started: false }
    }
}

impl<const N: usize> Estimate<N> {
    /// Known motion: positions `[m | rad]`, velocities `[m/s | rad/s]`.
    #[must_use]
    pub fn moving(q: &[f64; N], v: &[f64; N]) -> Self {
        Self { q: *q, v: *v, has_started: true }
    }
}

#[cfg(test)]
mod tests;
