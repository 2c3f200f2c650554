//! Input that identification refuses: one line that names recording, place, value and limit.

/// Why recordings cannot be used with a robot.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum InputError {
    /// No recording at all.
    #[error("no recording given")]
    NoRecording,
    /// A column the robot needs is not there.
    #[error("{recording}: no column {column:?} (required for every actuated joint of {robot:?}; columns: {found})")]
    MissingColumn {
        /// Recording as the user named it.
        recording: String,
        /// The column.
        column: String,
        /// Robot name.
        robot: String,
        /// Columns there are.
        found: String,
    },
    /// A column holds nothing.
    #[error("{recording}: column {column:?} has {known} known samples of {samples} (at least half must be known)")]
    EmptyColumn {
        /// Recording as the user named it.
        recording: String,
        /// The column.
        column: String,
        /// Known samples.
        known: usize,
        /// All samples.
        samples: usize,
    },
    /// Too few samples.
    #[error("{recording}: {samples} samples (at least {limit} are needed)")]
    TooShort {
        /// Recording as the user named it.
        recording: String,
        /// Number of samples.
        samples: usize,
        /// Limit.
        limit: usize,
    },
    /// The loops do not close at recorded drive positions.
    #[error(
        "{recording}: t = {time:.3} s: constraint row {row} stays {gap:.3e} m or rad open (limit 1e-9): {}",
        crate::degrees::open_question(robot, *unit)
    )]
    Open {
        /// Recording as the user named it.
        recording: String,
        /// Time of the sample `[s]`.
        time: f64,
        /// Constraint row, couplings first, then loops.
        row: usize,
        /// Remaining gap.
        gap: f64,
        /// Robot name.
        robot: String,
        /// The unit in which they would close.
        unit: Option<&'static str>,
    },
    /// The drives do not determine the passive joints at recorded drive positions.
    #[error("{recording}: t = {time:.3} s: singular pose: the drives determine {rank} of {passive} passive joints of {robot:?}")]
    Singular {
        /// Recording as the user named it.
        recording: String,
        /// Time of the sample `[s]`.
        time: f64,
        /// Passive joints that are determined.
        rank: usize,
        /// Passive joints.
        passive: usize,
        /// Robot name.
        robot: String,
    },
    /// An effect of the robot's files that no regression of efforts can have in it.
    #[error("robot {robot:?}: {effect} is not taken into account by an identification: take it out of the robot's file first")]
    Effect {
        /// Effect and place.
        effect: String,
        /// Robot name.
        robot: String,
    },
    /// A shape of a friction law that no search can start from.
    #[error("robot {robot:?}: {shape} = {value} (must be finite and > 0 to be estimated: a shape is sought by its logarithm)")]
    Shape {
        /// `<joint>.<effect>.<parameter>`.
        shape: String,
        /// As the robot file states it.
        value: f64,
        /// Robot name.
        robot: String,
    },
    /// A band that no recording can show.
    #[error("band = {band} Hz (must be > 0 and at most 0.4 of the sampling rate, {limit:.3} Hz)")]
    Band {
        /// As given `[Hz]`.
        band: f64,
        /// Upper limit `[Hz]`.
        limit: f64,
    },
    /// A rate to thin to that is none.
    #[error("{recording}: rate = {rate} Hz (must be finite and > 0; the recording has {limit:.3} Hz)")]
    Rate {
        /// Recording as the user named it.
        recording: String,
        /// As given `[Hz]`.
        rate: f64,
        /// Rate of the recording `[Hz]`.
        limit: f64,
    },
    /// A period to average over that does not fit twice.
    #[error("{recording}: period = {period} s (must be > 0 and fit at least twice into {duration:.3} s)")]
    Period {
        /// Recording as the user named it.
        recording: String,
        /// As given `[s]`.
        period: f64,
        /// Length of the recording `[s]`.
        duration: f64,
    },
    /// A link that is to carry a payload and is none, or has no mass that is estimated.
    #[error("payload: no link {link:?} with mass in robot {robot:?} (there are: {known})")]
    Carrier {
        /// As given.
        link: String,
        /// Robot name.
        robot: String,
        /// Links that could.
        known: String,
    },
    /// A stated gravity or load that does not fit the robot.
    #[error("{recording}: metadata {key}: {detail}")]
    Meta {
        /// Recording as the user named it.
        recording: String,
        /// Key.
        key: &'static str,
        /// What is wrong.
        detail: String,
    },
    /// More drives than freedoms, where each drive's own row is needed.
    #[error("{robot:?} has {drives} drives for {freedoms} degrees of freedom (they must be equal to tell the drives' gains)")]
    Redundant {
        /// Robot name.
        robot: String,
        /// Drives.
        drives: usize,
        /// Degrees of freedom.
        freedoms: usize,
    },
}
