//! Simulated hardware that goes on whether somebody reads it or not: its periods pass as those of a clock do.

use pkm_hal::{Backend, Clock, CommandFrame, HalError, Mode, StateFrame};

use crate::backend::SimBackend;
use crate::plant::Plant;

/// Longest time that is made up for at once, in periods: after a longer pause the simulation has stood still.
const LONGEST: u64 = 100;

/// A [`SimBackend`] whose time is that of a clock; states carry the clock's stamps.
///
/// A command acts from the next period on and is held, as real drives do, until another one comes.
///
/// A robot does not stand still while the program that drives it gets no time: periods that were missed pass at the next look, under the
/// command that was held, and what is shown then is the newest state with its own stamp; those between were seen by nobody, and their numbers
/// are missing. That is what a driver of real hardware finds when it wakes: it reads where the drives are by now, once.
#[derive(Debug)]
pub struct Paced<P, C> {
    inner: SimBackend<P>,
    clock: C,
    period_ns: u64,
    /// When the next period ends `[ns]`.
    next_ns: u64,
    command: Option<CommandFrame>,
    state: StateFrame,
}

impl<P: Plant, C: Clock> Paced<P, C> {
    /// `inner`, whose control period is `period_ns` `[ns]` (at least 1), beginning now.
    ///
    /// # Errors
    /// The simulation has no state.
    pub fn try_new(mut inner: SimBackend<P>, clock: C, period_ns: u64) -> Result<Self, HalError> {
        let period_ns = period_ns.max(1);
        let now_ns = clock.now_ns();
        let state = StateFrame { stamp_ns: now_ns, ..inner.read()? }.sealed();
        Ok(Self { inner, clock, period_ns, next_ns: now_ns.saturating_add(period_ns), command: None, state })
    }

    /// The simulation.
    pub const fn inner_mut(&mut self) -> &mut SimBackend<P> {
        &mut self.inner
    }

    /// Lets every period pass that has passed on the clock.
    fn catch_up(&mut self) -> Result<(), HalError> {
        let now_ns = self.clock.now_ns();
        let behind = now_ns.saturating_sub(self.next_ns) / self.period_ns;
        if behind > LONGEST {
            self.next_ns = self.next_ns.saturating_add((behind - LONGEST).saturating_mul(self.period_ns));
        }
        while self.next_ns <= now_ns {
            match self.command.take() {
                Some(command) => self.inner.write(&command)?,
                None => self.inner.elapse()?,
            }
            self.state = StateFrame { stamp_ns: self.next_ns, ..self.inner.read()? }.sealed();
            self.next_ns = self.next_ns.saturating_add(self.period_ns);
        }
        Ok(())
    }
}

impl<P: Plant, C: Clock> Backend for Paced<P, C> {
    fn n_axes(&self) -> usize {
        self.inner.n_axes()
    }

    fn n_sensors(&self) -> usize {
        self.inner.n_sensors()
    }

    fn read(&mut self) -> Result<StateFrame, HalError> {
        self.catch_up()?;
        Ok(self.state)
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        let mode = command.check(self.n_axes())?;
        if mode == Mode::Brake {
            return Err(HalError::Mode { code: mode.code() });
        }
        self.command = Some(*command);
        Ok(())
    }
}
