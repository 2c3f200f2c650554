//! What a loop is doing, and why it does something else than before: codes that stand in records, and their names.

/// Bits of [`super::CycleRecord::flags`].
pub mod flags {
    /// A new state came in this period.
    pub const NEW_STATE: u32 = 1;
    /// The newest state was late.
    pub const LATE_STATE: u32 = 1 << 1;
    /// What came was refused: a broken frame, or a position that no robot reaches in that time.
    pub const REFUSED_STATE: u32 = 1 << 2;
    /// A command was handed over.
    pub const COMMANDED: u32 = 1 << 3;
    /// An effort was clipped inside the controller.
    pub const SATURATED: u32 = 1 << 4;
    /// The period before this one ended late.
    pub const OVERRUN: u32 = 1 << 5;
    /// The command is the safe one.
    pub const SAFE: u32 = 1 << 6;
    /// A session is open.
    pub const ARMED: u32 = 1 << 7;
    /// What is sent still leads over from what was sent before.
    pub const BLENDING: u32 = 1 << 8;
    /// The controller reported a fault.
    pub const CONTROLLER_FAULT: u32 = 1 << 9;
    /// The controller did a step.
    pub const STEPPED: u32 = 1 << 10;
    /// It was at rest before that step.
    pub const AT_REST: u32 = 1 << 11;
    /// It is that of another law than the position loop's.
    pub const OTHER_LAW: u32 = 1 << 12;

    /// All of them with their names.
    pub const ALL: [(&str, u32); 13] = [
        ("new-state", NEW_STATE),
        ("late-state", LATE_STATE),
        ("refused-state", REFUSED_STATE),
        ("commanded", COMMANDED),
        ("saturated", SATURATED),
        ("overrun", OVERRUN),
        ("safe", SAFE),
        ("armed", ARMED),
        ("blending", BLENDING),
        ("controller-fault", CONTROLLER_FAULT),
        ("stepped", STEPPED),
        ("at-rest", AT_REST),
        ("other-law", OTHER_LAW),
    ];
}

/// An enum with a code and a name for every value.
macro_rules! codes {
    ($(#[$meta:meta])* $name:ident { $($(#[$about:meta])* $value:ident = $code:literal, $text:literal;)* }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        #[repr(u32)]
        pub enum $name {
            $($(#[$about])* $value = $code,)*
        }

        impl $name {
            /// All of them, by code.
            pub const ALL: &'static [Self] = &[$(Self::$value),*];

            /// The one of a code.
            #[must_use]
            pub const fn of(code: u32) -> Option<Self> {
                match code {
                    $($code => Some(Self::$value),)*
                    _ => None,
                }
            }

            /// Its code; a name keeps its code for ever.
            #[must_use]
            pub const fn code(self) -> u32 {
                self as u32
            }

            /// Its name in logs and tables.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$value => $text,)*
                }
            }
        }
    };
}

codes! {
    /// What a loop is doing.
    Phase {
        /// No power; the robot's states are awaited.
        Off = 0, "off";
        /// States are good; nothing is asked of the drives but a safe action that goes on.
        Ready = 1, "ready";
        /// On the way to the pose from which everything starts.
        Homing = 2, "homing";
        /// Stands where it is told to.
        Holding = 3, "holding";
        /// Plays a motion.
        Position = 4, "running-position";
        /// Follows a law of contact.
        Force = 5, "running-force";
        /// Does an exercise.
        Exercise = 6, "running-exercise";
        /// The safe action, under the loop's own control, until somebody clears it.
        SafeStop = 7, "safe-stop";
        /// The robot or its state is out of the loop's hands, until somebody clears it.
        Fault = 8, "fault";
    }
}

impl Phase {
    /// Whether efforts of a controller go to the drives.
    #[must_use]
    pub const fn is_moving(self) -> bool {
        matches!(self, Self::Homing | Self::Holding | Self::Position | Self::Force | Self::Exercise)
    }
}

codes! {
    /// Why a loop does something else than before.
    Cause {
        /// It began.
        Started = 0, "started";
        /// Somebody said so.
        Order = 1, "order";
        /// What was to be done is done.
        Arrived = 2, "arrived";
        /// The robot answers with good states.
        RobotThere = 3, "robot-there";
        /// No state came `[s]`.
        NoState = 4, "no-state";
        /// The newest state is too old `[s]`.
        Stale = 5, "stale-state";
        /// Frames were broken, so many in a row.
        BrokenState = 6, "broken-state";
        /// A signal that is needed was not measured.
        NotMeasured = 7, "not-measured";
        /// A position jumped and stayed there `[m | rad]`.
        Jump = 8, "jump";
        /// A position stands still while its reference moves `[m | rad]`.
        Stuck = 9, "stuck";
        /// A drive does not follow its reference `[m | rad]`.
        Following = 10, "following-error";
        /// A drive stands outside its range `[m | rad]`.
        Position = 11, "position-limit";
        /// A drive is too fast `[m/s | rad/s]`.
        Speed = 12, "speed-limit";
        /// The environment pushes too hard `[N | N·m]`.
        Wrench = 13, "wrench-limit";
        /// The controller stopped; the value is the code of its fault.
        Controller = 14, "controller-fault";
        /// The controller answered with an effort that is no number.
        NotFinite = 15, "command-not-finite";
        /// The model's loops do not close where the robot is said to be: the gap `[m | rad]`.
        Model = 16, "model-lost";
        /// The robot's side refused a command.
        Refused = 17, "command-refused";
        /// Commands are not acknowledged, so many in a row.
        Unheard = 18, "not-acknowledged";
        /// Somebody else's command was accepted.
        Foreign = 19, "foreign-commander";
        /// The robot's side applies its own safe action.
        Tripped = 20, "robot-tripped";
        /// The emergency-stop line is open.
        EmergencyStop = 21, "emergency-stop";
        /// A drive reports a fault.
        Drive = 22, "drive-fault";
        /// Periods ended late, so many in a row.
        Overruns = 23, "overruns";
        /// Too many periods of a second ended late.
        OverrunShare = 24, "overrun-share";
        /// The loop itself stood still `[s]`.
        Stalled = 25, "stalled";
        /// The supervisor is silent `[s]`.
        Supervisor = 26, "supervisor-silent";
        /// The motion asked for what is no number, or is out of reach.
        Reference = 27, "bad-reference";
        /// The robot's side was built for other frames.
        Layout = 28, "other-layout";
        /// The robot is gone.
        Gone = 29, "robot-gone";
        /// The program itself failed.
        Internal = 30, "internal";
        /// Numbers of a controller are not those that it was made of: memory has changed.
        Corrupted = 31, "numbers-changed";
    }
}

/// A change of phase.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transition {
    /// Number of the period.
    pub cycle: u64,
    /// When `[ns]`.
    pub at_ns: u64,
    /// What was being done.
    pub from: Phase,
    /// What is done from now on.
    pub to: Phase,
    /// Why.
    pub cause: Cause,
    /// Which axis, sensor or component; zero where it is about none.
    pub place: u32,
    /// The value in question, in the unit of its cause.
    pub value: f64,
    /// What it should have been, in the same unit.
    pub limit: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_lead_back_and_names_are_told_apart() {
        for (i, phase) in Phase::ALL.iter().enumerate() {
            assert_eq!(Phase::of(phase.code()), Some(*phase));
            assert!(Phase::ALL[..i].iter().all(|other| other.name() != phase.name()));
        }
        for (i, cause) in Cause::ALL.iter().enumerate() {
            assert_eq!(Cause::of(cause.code()), Some(*cause));
            assert!(Cause::ALL[..i].iter().all(|other| other.name() != cause.name()));
        }
        assert_eq!((Phase::of(9), Cause::of(32)), (None, None));
    }
}
