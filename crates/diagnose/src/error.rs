//! Input the engine refuses: one line that names recording, place, value and limit.

/// Why a diagnosis cannot start.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum InputError {
    /// No recording at all.
    #[error("no recording given")]
    NoRecording,
    /// A recording that is there already: what it would confirm is itself.
    #[error("{recording}: the same samples as {other} (every recording must be one of its own)")]
    Copy {
        /// Recording as the user named it.
        recording: String,
        /// The one that it is a copy of.
        other: String,
    },
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
        "{recording}: t = {time} s: constraint row {row} stays {gap:.3e} m or rad open (limit 1e-9): {}",
        pkm_ident::degrees::open_question(robot, *unit)
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
    /// The drives do not determine the passive joints.
    #[error("robot {robot:?}: {mobility} degrees of freedom and {drives} drives (they must be equal)")]
    Mobility {
        /// Robot name.
        robot: String,
        /// Degrees of freedom at the first sample.
        mobility: usize,
        /// Number of drives.
        drives: usize,
    },
    /// An effect of the robot's files that no prediction of efforts can have in it.
    #[error("robot {robot:?}: {effect} is not taken into account by a diagnosis: take it out of the robot's file first")]
    Effect {
        /// Effect and place.
        effect: String,
        /// Robot name.
        robot: String,
    },
    /// An effect to be left out that there is not.
    #[error("without: no effect is called {name:?} (there are: {known})")]
    Unknown {
        /// As given.
        name: String,
        /// Names that a diagnosis looks for.
        known: String,
    },
    /// A band that no recording can show.
    #[error("band = {band} Hz (must be > 0 and below 0.4 of the sampling rate, {limit:.3} Hz)")]
    Band {
        /// As given `[Hz]`.
        band: f64,
        /// Upper limit `[Hz]`.
        limit: f64,
    },
    /// A motion that leaves nothing to fit on.
    #[error("{recording}: {reason}")]
    Short {
        /// Motion as the user named it.
        recording: String,
        /// What is too little of what.
        reason: String,
    },
    /// The temporary file that a long recording's series lie in gave something else back than it took.
    #[error("temporary file of the diagnosis in {folder:?}: {reason}")]
    Scratch {
        /// Folder of temporary files.
        folder: String,
        /// What the file system said.
        reason: String,
    },
    /// Noise of efforts that cannot be.
    #[error("noise of {joint}: {detail}")]
    Noise {
        /// Joint as stated.
        joint: String,
        /// What is wrong.
        detail: String,
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
}
