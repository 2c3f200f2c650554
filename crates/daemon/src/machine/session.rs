//! The session with the robot's side: what was asked, what was heard.

use pkm_hal::frame::status;
use pkm_hal::{Cause, CommandFrame, Mode, StateFrame};

use crate::gate::Offence;

/// What the loop knows of its session.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Session {
    pub(super) nonce: u64,
    pub(super) sequence: u64,
    pub(super) is_open: bool,
    /// Whether the robot's side has said our nonce.
    pub(super) is_heard: bool,
    /// Sequence of the first efforts.
    first_effort: u64,
    /// Periods since it was opened.
    pub(super) age: u64,
}

impl Session {
    /// A session that is to be opened.
    pub(super) fn new(nonce: u64) -> Self {
        Self { nonce, is_open: true, ..Self::default() }
    }

    /// Whether efforts were sent in it.
    pub(super) const fn has_efforts(&self) -> bool {
        self.first_effort != 0
    }

    /// The next command of it.
    pub(super) fn command(&mut self, n_axes: usize, mode: Mode, now_ns: u64, valid_for_ns: u64) -> CommandFrame {
        self.sequence += 1;
        if mode == Mode::Effort && self.first_effort == 0 {
            self.first_effort = self.sequence;
        }
        CommandFrame {
            nonce: self.nonce,
            sequence: self.sequence,
            stamp_ns: now_ns,
            valid_until_ns: now_ns.saturating_add(valid_for_ns),
            ..CommandFrame::new(n_axes, mode)
        }
    }

    /// What the newest state says of the session, if that is not what it should; `patience` periods may pass until a command is heard.
    pub(super) fn offence(&mut self, state: &StateFrame, patience: u64) -> Option<Offence> {
        if !self.is_open {
            return None;
        }
        self.age += 1;
        self.is_heard |= state.nonce == self.nonce;
        if !self.is_heard {
            // Until then the nonce in the state is that of an earlier session.
            return (self.age > patience).then(|| Offence::of(Cause::Unheard, self.age as f64, patience as f64));
        }
        if state.nonce != self.nonce {
            // A driver that began anew knows of nobody.
            let cause = if state.nonce == 0 { Cause::Gone } else { Cause::Foreign };
            return Some(Offence::of(cause, 0.0, 0.0));
        }
        let has_taken_over = self.first_effort != 0 && state.command_sequence >= self.first_effort && state.status & status::SAFE != 0;
        if has_taken_over {
            return Some(Offence::of(Cause::Tripped, 1.0, 0.0));
        }
        let unheard = self.sequence.saturating_sub(state.command_sequence);
        (unheard > patience).then(|| Offence::of(Cause::Unheard, unheard as f64, patience as f64))
    }
}
