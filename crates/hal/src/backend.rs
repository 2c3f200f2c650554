//! The contract itself: state out, commands in, never waiting.

use crate::frame::{CommandFrame, MAX_AXES, StateFrame};

/// A robot, or what stands for one.
///
/// Neither call waits, allocates or panics, whatever is in the frames. A backend believes a command only after [`CommandFrame::check`] and
/// leaves its drives as they were when it returns an error. Who may command, and for how long, is the business of [`crate::Watchdog`].
pub trait Backend {
    /// Number of axes; it never changes.
    fn n_axes(&self) -> usize;

    /// Number of further sensors; it never changes.
    fn n_sensors(&self) -> usize;

    /// The newest state, sealed. The same frame again when there is no newer one: its sequence and stamp say so.
    ///
    /// # Errors
    /// No state yet, or none any more.
    fn read(&mut self) -> Result<StateFrame, HalError>;

    /// Hands over a sealed command.
    ///
    /// # Errors
    /// Why it was refused; nothing has changed then.
    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError>;

    /// Efforts that the last accepted command came to `[N | N·m]`, where something in here may change them; `None`: those that were asked for.
    fn sent(&self) -> Option<&[f64; MAX_AXES]> {
        None
    }

    /// Looks for the other side again, where it may have come back in another place. This may take milliseconds: for when nobody moves.
    fn reconnect(&mut self) {}
}

impl<B: Backend + ?Sized> Backend for &mut B {
    fn n_axes(&self) -> usize {
        (**self).n_axes()
    }

    fn n_sensors(&self) -> usize {
        (**self).n_sensors()
    }

    fn read(&mut self) -> Result<StateFrame, HalError> {
        (**self).read()
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        (**self).write(command)
    }

    fn sent(&self) -> Option<&[f64; MAX_AXES]> {
        (**self).sent()
    }

    fn reconnect(&mut self) {
        (**self).reconnect();
    }
}

/// Why a frame was refused or is not there.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum HalError {
    /// Nothing has been read yet.
    #[error("no state yet")]
    NoState,
    /// The other side is gone.
    #[error("the device is gone (code {code})")]
    Gone {
        /// The device's own code.
        code: i32,
    },
    /// The other side was built for other frames.
    #[error("layout {found:#018x} (must be {expected:#018x}): the two sides were built for different frames")]
    Layout {
        /// In the frame.
        found: u64,
        /// Of this program.
        expected: u64,
    },
    /// The contents are not those that were sealed.
    #[error("frame {sequence}: wrong checksum")]
    Checksum {
        /// Sequence in the frame, for what it is worth.
        sequence: u64,
    },
    /// Not this robot's number of axes or sensors.
    #[error("{found} axes or sensors in the frame (must be {expected})")]
    Axes {
        /// In the frame.
        found: u32,
        /// What it must be, or must not exceed.
        expected: u32,
    },
    /// A number that is none.
    #[error("{signal}[{index}] is not finite")]
    NotFinite {
        /// Which signal.
        signal: &'static str,
        /// Which axis or sensor.
        index: usize,
    },
    /// A code that is no mode, or a mode this device has not.
    #[error("mode {code} is not known here")]
    Mode {
        /// The code.
        code: u32,
    },
    /// The newest state is too old to act on.
    #[error("state is {age_ns} ns old (limit {limit_ns} ns)")]
    Stale {
        /// Its age `[ns]`.
        age_ns: u64,
        /// The most allowed `[ns]`.
        limit_ns: u64,
    },
    /// A stamp that lies ahead of the clock: the two sides do not share one.
    #[error("stamp is {ahead_ns} ns ahead of the clock (limit {limit_ns} ns)")]
    Ahead {
        /// How far `[ns]`.
        ahead_ns: u64,
        /// The most allowed `[ns]`.
        limit_ns: u64,
    },
    /// A command that arrived too late.
    #[error("command {sequence} expired {late_ns} ns ago")]
    Expired {
        /// Its sequence.
        sequence: u64,
        /// How long ago `[ns]`.
        late_ns: u64,
    },
    /// A command that would outlive its commander.
    #[error("command {sequence} is valid for {horizon_ns} ns (limit {limit_ns} ns)")]
    Horizon {
        /// Its sequence.
        sequence: u64,
        /// For how long `[ns]`.
        horizon_ns: u64,
        /// The most allowed `[ns]`.
        limit_ns: u64,
    },
    /// A command that was seen before, or one older than the last.
    #[error("command {sequence} comes after command {last}")]
    Replayed {
        /// Its sequence.
        sequence: u64,
        /// The last accepted one.
        last: u64,
    },
    /// A commander that does not hold the session.
    #[error("nonce {nonce:#018x} does not hold the session")]
    ForeignCommander {
        /// Its nonce.
        nonce: u64,
    },
    /// A session is open already.
    #[error("armed already: a session is open")]
    AlreadyArmed,
    /// No session is open: arm first.
    #[error("not armed")]
    NotArmed,
    /// A configured number that cannot be used.
    #[error("axis {axis}: {what} = {value} ({limit})")]
    Config {
        /// Which axis, from zero.
        axis: usize,
        /// Which number.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        limit: &'static str,
    },
}
