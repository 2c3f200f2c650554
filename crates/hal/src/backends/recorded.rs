//! A recording in place of a robot: its states come again as time passes, whatever is commanded.

use crate::backend::{Backend, HalError};
use crate::clock::Clock;
use crate::frame::{CommandFrame, StateFrame};

/// States that were recorded, at the pace of a clock: what a loop would see, with nothing that can move.
///
/// Commands are checked and acknowledged, and change nothing. States keep their distances in time and are stamped by the clock of now; one
/// that nobody read in time is missing in the sequence, as with a robot. After the last the recording is [`HalError::Gone`].
#[derive(Debug, Clone)]
pub struct Recorded<'r, C> {
    frames: &'r [StateFrame],
    clock: C,
    start_ns: u64,
    /// States that have come.
    came: usize,
    state: Option<StateFrame>,
    /// Nonce and sequence of the last command.
    acknowledged: (u64, u64),
}

/// Code of [`HalError::Gone`]: the recording is over.
pub const OVER: i32 = 1;

impl<'r, C: Clock> Recorded<'r, C> {
    /// The states `frames`, the first of them now.
    ///
    /// # Errors
    /// No state; one that is broken, of another robot than the first, or not later than the one before.
    pub fn try_new(frames: &'r [StateFrame], clock: C) -> Result<Self, HalError> {
        let first = frames.first().ok_or(HalError::NoState)?;
        for (k, frame) in frames.iter().enumerate() {
            frame.check()?;
            for (found, expected) in [(frame.n_axes, first.n_axes), (frame.n_sensors, first.n_sensors)] {
                if found != expected {
                    return Err(HalError::Axes { found, expected });
                }
            }
            if k > 0 && frame.stamp_ns <= frames[k - 1].stamp_ns {
                return Err(HalError::Replayed { sequence: frame.sequence, last: frames[k - 1].sequence });
            }
        }
        let start_ns = clock.now_ns();
        Ok(Self { frames, clock, start_ns, came: 0, state: None, acknowledged: (0, 0) })
    }

    /// Time of a state since the first `[ns]`.
    fn offset_ns(&self, frame: &StateFrame) -> u64 {
        frame.stamp_ns - self.frames[0].stamp_ns
    }
}

impl<C: Clock> Backend for Recorded<'_, C> {
    fn n_axes(&self) -> usize {
        self.frames[0].n_axes as usize
    }

    fn n_sensors(&self) -> usize {
        self.frames[0].n_sensors as usize
    }

    fn read(&mut self) -> Result<StateFrame, HalError> {
        let passed_ns = self.clock.now_ns().saturating_sub(self.start_ns);
        let came = self.came + self.frames[self.came..].partition_point(|frame| self.offset_ns(frame) <= passed_ns);
        if came > self.came {
            let recorded = &self.frames[came - 1];
            let stamp_ns = self.start_ns.saturating_add(self.offset_ns(recorded));
            let (nonce, command_sequence) = self.acknowledged;
            self.state = Some(StateFrame { sequence: came as u64, stamp_ns, nonce, command_sequence, ..*recorded }.sealed());
            self.came = came;
        } else if came == self.frames.len() && passed_ns > self.offset_ns(&self.frames[came - 1]) {
            return Err(HalError::Gone { code: OVER });
        }
        self.state.ok_or(HalError::NoState)
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        command.check(self.n_axes())?;
        self.acknowledged = (command.nonce, command.sequence);
        Ok(())
    }
}
