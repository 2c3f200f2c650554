//! Why a simulation cannot start or go on.

use pkm_dyn::effects::EffectError;

/// Why a simulation cannot start or go on.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimError {
    /// A number of the scenario that cannot be used.
    #[error("scenario: {what} = {value} ({limit})")]
    Scenario {
        /// Which number.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        limit: &'static str,
    },
    /// The true and the nominal robot are not the same mechanism.
    #[error("true and nominal robot differ in their {what}")]
    NotTheSameRobot {
        /// What differs.
        what: &'static str,
    },
    /// A recording without the positions that were asked for.
    #[error("no column {column:?}: the simulation needs the reference that the robot was to follow")]
    NoReference {
        /// The column.
        column: String,
    },
    /// The drives do not determine the motion.
    #[error("robot {robot:?}: {mobility} degrees of freedom at the start, {drives} drives (must be equal and > 0)")]
    Mobility {
        /// Its name.
        robot: String,
        /// Degrees of freedom.
        mobility: usize,
        /// Number of drives.
        drives: usize,
    },
    /// The loops do not close.
    #[error("loops do not close at t = {time} s: gap {gap:e} in row {row}, rank {rank}")]
    NotClosed {
        /// When `[s]`.
        time: f64,
        /// Largest gap `[m | rad]`.
        gap: f64,
        /// Constraint row of the largest gap (couplings first, then loops).
        row: usize,
        /// Rank of the constraints with respect to the passive joints.
        rank: usize,
    },
    /// The mass matrix is not positive definite.
    #[error("the mass matrix is not positive definite at t = {time} s: a joint moves no mass")]
    Massless {
        /// When `[s]`.
        time: f64,
    },
    /// A step that cannot be taken.
    #[error("no way on at t = {time} s: loops open, a freedom moves no mass, or an effect is too stiff for the step")]
    Stuck {
        /// When `[s]`.
        time: f64,
    },
    /// A load that a recording states on a link that is none.
    #[error("the recording states a load on link {link:?} (must be a link of the robot)")]
    NoLink {
        /// The link.
        link: String,
    },
    /// The motion grew beyond all bounds.
    #[error("the motion diverged at t = {time} s")]
    Diverged {
        /// When `[s]`.
        time: f64,
    },
    /// A motion that leaves a joint's limits.
    #[error("reference at t = {time} s: {what} of joint {joint:?} = {value} (limits {lower} to {upper})")]
    OutOfLimits {
        /// When `[s]`.
        time: f64,
        /// The joint.
        joint: String,
        /// Position or velocity.
        what: &'static str,
        /// Its value `[m | rad]`, `[m/s | rad/s]`.
        value: f64,
        /// Lower limit.
        lower: f64,
        /// Upper limit.
        upper: f64,
    },
    /// No motion keeps loops closed and limits kept, however small.
    #[error("no periodic motion about the middle of travel of robot {robot:?} keeps its loops closed and its limits: {reason}")]
    NoMotion {
        /// Its name.
        robot: String,
        /// What was violated last.
        reason: String,
    },
    /// A robot without a joint that its single drive moves.
    #[error("robot {robot:?} has not one drive that moves a joint {joint:?}")]
    NoCoordinate {
        /// Its name.
        robot: String,
        /// The joint.
        joint: String,
    },
    /// A recording without a signal that a replay needs.
    #[error("the recording has no {signal}")]
    NoSignal {
        /// Name of its column.
        signal: String,
    },
    /// An effect that this robot cannot have.
    #[error("effect {effect}: {problem}")]
    NoPlace {
        /// The effect.
        effect: &'static str,
        /// Why not.
        problem: &'static str,
    },
    /// Something that the engine of a plant has no means for.
    #[error("{engine} cannot represent {what}: {problem}")]
    NotRepresentable {
        /// The engine.
        engine: &'static str,
        /// Part of the robot.
        what: String,
        /// Why not.
        problem: &'static str,
    },
    /// Bodies that an engine could not hold together.
    #[error("joint or loop {joint:?} is open by {gap:e} m or rad at t = {time} s (limit {limit:e})")]
    Torn {
        /// When `[s]`.
        time: f64,
        /// Joint or loop that is open farthest.
        joint: String,
        /// How far `[m | rad]`.
        gap: f64,
        /// What is still taken for closed `[m | rad]`.
        limit: f64,
    },
    /// A controller that stopped.
    #[error("controller {law}: fault {code:?} ({number}){place} at t = {time} s: {value} (limit {limit})", number = *code as u8)]
    Fault {
        /// Its law.
        law: String,
        /// What happened.
        code: pkm_ctrl::FaultCode,
        /// Where, beginning with a blank; empty for what concerns the whole.
        place: String,
        /// When `[s]`.
        time: f64,
        /// The value that was not allowed, in the unit of the code.
        value: f64,
        /// What would have been.
        limit: f64,
    },
    /// Drives that refused a command.
    #[error("the drives refused a command: {0}")]
    Drives(#[from] pkm_hal::HalError),
    /// An effect that is not in the library.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// A controller that cannot be built for this robot.
    #[error("controller: {0}")]
    Controller(#[from] pkm_ctrl::ConfigError),
}
