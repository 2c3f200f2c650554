//! Who may command: one session at a time, opened with a fresh nonce, its commands in order and none of them old.

use crate::backend::HalError;
use crate::frame::{CommandFrame, Mode};

/// The one session of a HAL.
///
/// A nonce is any number but 0 that no session had before; drawing 64 random bits is enough. The last one is refused when it comes
/// again, older ones expire: so a recorded or replayed command never moves anything.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Session {
    nonce: u64,
    sequence: u64,
    is_open: bool,
    horizon_limit_ns: u64,
}

impl Session {
    /// No session; commands may be valid for at most `horizon_limit_ns` `[ns]`.
    #[must_use]
    pub const fn new(horizon_limit_ns: u64) -> Self {
        Self { nonce: 0, sequence: 0, is_open: false, horizon_limit_ns }
    }

    /// Whether a session is open.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        self.is_open
    }

    /// Nonce of the open session, or of the last one; 0 when there was none.
    #[must_use]
    pub const fn nonce(&self) -> u64 {
        self.nonce
    }

    /// Sequence of the command admitted last.
    #[must_use]
    pub const fn sequence(&self) -> u64 {
        self.sequence
    }

    /// Admits a command to a robot of `n_axes` axes at `now_ns` `[ns]`, or says why not; [`Mode::Arm`] opens the session, once: it must
    /// not lengthen the life of efforts that were commanded before. [`Mode::Off`] ends it.
    ///
    /// # Errors
    /// What is wrong with the command. The session is as before then.
    pub fn admit(&mut self, command: &CommandFrame, n_axes: usize, now_ns: u64) -> Result<Mode, HalError> {
        let mode = command.check(n_axes)?;
        let CommandFrame { nonce, sequence, valid_until_ns, .. } = *command;
        if valid_until_ns < now_ns {
            return Err(HalError::Expired { sequence, late_ns: now_ns - valid_until_ns });
        }
        let (horizon_ns, limit_ns) = (valid_until_ns - now_ns, self.horizon_limit_ns);
        if horizon_ns > limit_ns {
            return Err(HalError::Horizon { sequence, horizon_ns, limit_ns });
        }
        if mode == Mode::Arm && !self.is_open {
            if nonce == 0 || nonce == self.nonce {
                return Err(HalError::ForeignCommander { nonce });
            }
            (self.nonce, self.sequence, self.is_open) = (nonce, sequence, true);
            return Ok(mode);
        }
        if !self.is_open {
            return Err(HalError::NotArmed);
        }
        if nonce != self.nonce {
            return Err(HalError::ForeignCommander { nonce });
        }
        if mode == Mode::Arm {
            return Err(HalError::AlreadyArmed);
        }
        if sequence <= self.sequence {
            return Err(HalError::Replayed { sequence, last: self.sequence });
        }
        self.sequence = sequence;
        self.is_open = mode != Mode::Off;
        Ok(mode)
    }

    /// Ends the session: its nonce is spent.
    pub const fn end(&mut self) {
        self.is_open = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn command(nonce: u64, sequence: u64, mode: Mode, valid_until_ns: u64) -> CommandFrame {
        CommandFrame { nonce, sequence, valid_until_ns, ..CommandFrame::new(1, mode) }.sealed()
    }

    #[test]
    fn one_commander_in_order_and_in_time() {
        let mut session = Session::new(100);
        let mut admit = |nonce, sequence, mode, until| session.admit(&command(nonce, sequence, mode, until), 1, 1000);
        assert_eq!(admit(5, 1, Mode::Effort, 1050), Err(HalError::NotArmed));
        assert_eq!(admit(0, 1, Mode::Arm, 1050), Err(HalError::ForeignCommander { nonce: 0 }));
        assert_eq!(admit(5, 1, Mode::Arm, 1050), Ok(Mode::Arm));
        assert_eq!(admit(6, 2, Mode::Arm, 1050), Err(HalError::ForeignCommander { nonce: 6 }));
        assert_eq!(admit(5, 2, Mode::Arm, 1050), Err(HalError::AlreadyArmed));
        assert_eq!(admit(6, 2, Mode::Effort, 1050), Err(HalError::ForeignCommander { nonce: 6 }));
        assert_eq!(admit(5, 2, Mode::Effort, 1100), Ok(Mode::Effort));
        assert_eq!(admit(5, 2, Mode::Effort, 1100), Err(HalError::Replayed { sequence: 2, last: 2 }));
        assert_eq!(admit(5, 3, Mode::Effort, 1101), Err(HalError::Horizon { sequence: 3, horizon_ns: 101, limit_ns: 100 }));
        assert_eq!(admit(5, 3, Mode::Effort, 999), Err(HalError::Expired { sequence: 3, late_ns: 1 }));
        assert_eq!(admit(5, u64::MAX, Mode::Off, 1000), Ok(Mode::Off));
        assert_eq!(admit(5, 3, Mode::Arm, 1050), Err(HalError::ForeignCommander { nonce: 5 }));
        assert_eq!(admit(6, 1, Mode::Arm, 1050), Ok(Mode::Arm));
    }
}
