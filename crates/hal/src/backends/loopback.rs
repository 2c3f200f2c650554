//! A robot that does at once what it is told and stands still: the smallest device that keeps the contract.

use crate::backend::{Backend, HalError};
use crate::clock::Clock;
use crate::frame::{CommandFrame, MAX_AXES, Mode, StateFrame, first_bits, status};

/// Reports the efforts it was asked for as the ones it exerts; positions and velocities are what [`Loopback::place`] says.
#[derive(Debug, Clone)]
pub struct Loopback<C> {
    state: StateFrame,
    clock: C,
}

impl<C: Clock> Loopback<C> {
    /// A robot of `n_axes` axes (at most [`MAX_AXES`]) whose states are stamped by `clock`.
    #[must_use]
    pub fn new(n_axes: usize, clock: C) -> Self {
        let mut state = StateFrame::new(n_axes, 0);
        let all = first_bits(n_axes.min(MAX_AXES));
        (state.valid_q, state.valid_v, state.valid_tau) = (all, all, all);
        Self { state, clock }
    }

    /// Says where it stands `[m | rad]` and how it moves `[m/s | rad/s]`; what is too long is left off.
    pub fn place(&mut self, q: &[f64], v: &[f64]) {
        for (to, from) in self.state.q.iter_mut().zip(q).chain(self.state.v.iter_mut().zip(v)) {
            *to = *from;
        }
    }
}

impl<C: Clock> Backend for Loopback<C> {
    fn n_axes(&self) -> usize {
        self.state.n_axes as usize
    }

    fn n_sensors(&self) -> usize {
        0
    }

    fn read(&mut self) -> Result<StateFrame, HalError> {
        self.state.sequence += 1;
        self.state.stamp_ns = self.clock.now_ns();
        Ok(self.state.sealed())
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        let mode = command.check(self.n_axes())?;
        let is_powered = mode == Mode::Effort;
        self.state.tau = if is_powered { command.tau } else { [0.0; MAX_AXES] };
        self.state.status = if is_powered { status::POWERED } else { 0 };
        (self.state.nonce, self.state.command_sequence) = (command.nonce, command.sequence);
        Ok(())
    }
}
