//! Codes that stand in frames.

/// Bits of [`crate::StateFrame::status`].
pub mod status {
    /// The drives are powered and follow commands.
    pub const POWERED: u32 = 1;
    /// The safe action is being applied, not a command.
    pub const SAFE: u32 = 1 << 1;
    /// The emergency-stop line is open.
    pub const STOPPED: u32 = 1 << 2;
}

/// What a command asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Mode {
    /// Drives without power; ends the session.
    Off = 0,
    /// Opens a session; moves nothing.
    Arm = 1,
    /// The efforts in the frame.
    Effort = 2,
    /// Mechanical brakes on.
    Brake = 3,
}

impl Mode {
    /// The mode of a code.
    #[must_use]
    pub const fn of(code: u32) -> Option<Self> {
        match code {
            0 => Some(Self::Off),
            1 => Some(Self::Arm),
            2 => Some(Self::Effort),
            3 => Some(Self::Brake),
            _ => None,
        }
    }

    /// Its code.
    #[must_use]
    pub const fn code(self) -> u32 {
        self as u32
    }
}

/// A kind of measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signal {
    /// `q` `[m | rad]`.
    Position,
    /// `v` `[m/s | rad/s]`.
    Velocity,
    /// `tau` `[N | N·m]`.
    Effort,
    /// `sensor`, each in its own unit.
    Sensor,
}

impl Signal {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Position, Self::Velocity, Self::Effort, Self::Sensor];

    /// Its name in messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Position => "q",
            Self::Velocity => "v",
            Self::Effort => "tau",
            Self::Sensor => "sensor",
        }
    }
}
