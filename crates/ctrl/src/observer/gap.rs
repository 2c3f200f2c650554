//! Gaps in the measurements: positions that are carried on meanwhile, or time that nobody told of, and then all of the way at once.
//!
//! Taken for the way of one period it would be a leap of the velocity, and of every command that damps with it.

use super::{Sample, VelocityObserver};
use crate::controller::Input;

/// Periods that positions may be carried on for, and observers still follow what was foretold.
const FOLLOWED: f64 = 4.5;

/// How much longer the way can have taken by its stamps than steps have told, before it is another speed.
const UNTOLD: f64 = 1.5;

/// What is remembered of the measurement before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Gap<const N: usize> {
    /// Positions of then `[m | rad]`.
    q: Option<[f64; N]>,
    /// Time that steps have told since `[s]`.
    told: f64,
}

impl<const N: usize> Default for Gap<N> {
    fn default() -> Self {
        Self { q: None, told: 0.0 }
    }
}

impl<const N: usize> Gap<N> {
    /// Mean velocities since the measurement before `[m/s | rad/s]`, where this one ends a gap that no observer can have followed.
    ///
    /// By the mean value theorem they are off by no more than what the drives accelerate within the gap.
    pub(crate) fn ended(&mut self, input: &Input<N>) -> Option<[f64; N]> {
        self.told += input.dt;
        if !(input.q_dt > 0.0 && input.q_dt.is_finite()) {
            return None;
        }
        let before = self.q.replace(input.q_meas);
        let told = core::mem::take(&mut self.told);
        let is_lost = input.q_dt > UNTOLD * told || told > FOLLOWED * input.dt;
        before.filter(|_| is_lost).map(|before| core::array::from_fn(|k| (input.q_meas[k] - before[k]) / input.q_dt))
    }

    /// One period of `observer`: a sample, or going on after a gap.
    pub(crate) fn observe<O: VelocityObserver<N>>(
        &mut self,
        observer: &O,
        state: &mut O::State,
        input: &Input<N>,
        sent: [[f64; N]; 2],
    ) -> [f64; N] {
        let [a_cmd, tau] = sent;
        let sample = Sample { q_meas: input.q_meas, a_cmd, tau, dt: input.dt };
        match self.ended(input) {
            Some(v) => observer.resume(state, &sample, &v),
            None => observer.step(state, &sample),
        }
    }
}
