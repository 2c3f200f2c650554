//! How long it takes from a state that is handed over until the command that answers it is there.

use pkm_daemon::histogram::{Summary, Times};
use pkm_hal::{Backend, Clock, CommandFrame, HalError, MAX_AXES, StateFrame};

/// States whose moment is remembered: more than pass until a command is no longer valid anywhere in practice.
const REMEMBERED: usize = 256;

/// A robot whose answers are timed.
pub(super) struct Heard<B, C> {
    pub(super) inner: B,
    clock: C,
    /// Sequence and moment `[ns]` of the last states.
    handed: [(u64, u64); REMEMBERED],
    times: Times,
}

impl<B: Backend, C: Clock> Heard<B, C> {
    pub(super) fn new(inner: B, clock: C) -> Self {
        Self { inner, clock, handed: [(0, 0); REMEMBERED], times: Times::default() }
    }

    /// From state to command, over all commands so far.
    pub(super) fn round_trips(&self) -> Summary {
        self.times.summary()
    }
}

/// Place of a state among those remembered.
fn slot(sequence: u64) -> usize {
    usize::try_from(sequence % REMEMBERED as u64).unwrap_or(0)
}

impl<B: Backend, C: Clock> Backend for Heard<B, C> {
    fn n_axes(&self) -> usize {
        self.inner.n_axes()
    }

    fn n_sensors(&self) -> usize {
        self.inner.n_sensors()
    }

    fn read(&mut self) -> Result<StateFrame, HalError> {
        let state = self.inner.read()?;
        let place = &mut self.handed[slot(state.sequence)];
        // The first time that it is handed over, not every time that there is no newer one.
        if place.0 != state.sequence {
            *place = (state.sequence, self.clock.now_ns());
        }
        Ok(state)
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        let (sequence, at_ns) = self.handed[slot(command.state_sequence)];
        if sequence == command.state_sequence && sequence > 0 {
            self.times.note(self.clock.now_ns().saturating_sub(at_ns));
        }
        self.inner.write(command)
    }

    fn sent(&self) -> Option<&[f64; MAX_AXES]> {
        self.inner.sent()
    }

    fn reconnect(&mut self) {
        self.inner.reconnect();
    }
}

#[cfg(test)]
mod tests {
    use pkm_hal::backends::Loopback;
    use pkm_hal::{ManualClock, Mode};

    use super::*;

    #[test]
    fn what_is_timed_is_the_state_that_is_answered() {
        let clock = ManualClock::new(0);
        let mut robot = Heard::new(Loopback::new(1, &clock), &clock);
        let first = robot.read().unwrap();
        clock.advance(1_000_000);
        let second = robot.read().unwrap();
        assert!(second.sequence > first.sequence);
        clock.advance(2_000_000);
        let answer = |state: &StateFrame| CommandFrame { state_sequence: state.sequence, ..CommandFrame::new(1, Mode::Effort) }.sealed();
        robot.write(&answer(&first)).unwrap();
        robot.write(&answer(&second)).unwrap();
        // Nobody has such a state.
        robot.write(&answer(&StateFrame { sequence: 77, ..first })).unwrap();
        let told = robot.round_trips();
        assert_eq!((told.count, told.max_us), (2, 3000.0));
        assert!((told.p50_us - 2000.0).abs() < 3.0, "{told:?}");
    }
}
