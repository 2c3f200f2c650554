//! What can be asked of an identification, and what it answers.

use faer::Mat;
use pkm_dyn::effects::Robot;

use crate::Recording;
use crate::base::BaseError;
use crate::columns::Columns;
use crate::error::InputError;
use crate::estimate::Method;
use crate::estimate::feasible::Prior;
use crate::estimate::instrumental::Exogeneity;
use crate::grouping::BaseSet;
use crate::note::{Note, Status};
use crate::observation::RowOptions;
use crate::preprocess::{Done, Preprocess};
use crate::relevant::Step;
use crate::shapes::Shape;

/// Parameters that can be held at their nominal values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Term {
    /// Rotor inertias.
    Rotor,
    /// Viscous and Coulomb friction of the drives.
    Friction,
    /// Viscous and Coulomb friction of passive joints.
    PassiveFriction,
    /// Constant parts of the drives' efforts.
    Offset,
    /// Stiffness of springs, amplitude and phase of ripples.
    Stiffness,
}

impl Term {
    /// All terms.
    pub const ALL: [Self; 5] = [Self::Rotor, Self::Friction, Self::PassiveFriction, Self::Offset, Self::Stiffness];

    /// Name, as on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Rotor => "rotor",
            Self::Friction => "friction",
            Self::PassiveFriction => "passive-friction",
            Self::Offset => "offset",
            Self::Stiffness => "stiffness",
        }
    }
}

/// How to identify.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Estimator.
    pub method: Method,
    /// How recordings become rows.
    pub rows: RowOptions,
    /// Terms that stay as the robot file has them.
    pub held: Vec<Term>,
    /// How unseen inertias are drawn to the nominal ones.
    pub prior: Prior,
    /// Weight of the prior per row; by cross-validation when `None`.
    pub prior_weight: Option<f64>,
    /// What is done to the recordings first.
    pub preprocess: Preprocess,
    /// Shapes of friction laws that the robot file states (a Stribeck velocity).
    pub shapes: Shapes,
}

/// What happens to the values of friction laws that the effort is not linear in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shapes {
    /// They stay as the robot file has them.
    Stated,
    /// They are estimated by variable projection.
    Estimated,
}

/// A closed loop to be simulated: a robot and a recording in, a recording with the same time stamps, its `q.*` as the robot would have
/// moved and any finite `tau.*`, out; or why not.
pub type Simulate<'s> = dyn FnMut(&Robot, &Recording) -> Result<Recording, String> + 's;

/// How an estimate by instrumental variables came about.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Instruments {
    /// Simulations of all recordings.
    pub iterations: usize,
    /// Whether the estimate stopped moving.
    pub is_settled: bool,
    /// The base parameter whose column the simulated motion explains least.
    pub weakest: String,
    /// How much fewer the rows are for being coloured.
    pub colour: f64,
    /// Whether least squares would have done.
    #[serde(flatten)]
    pub test: Exogeneity,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            method: Method::Sdp,
            rows: RowOptions::default(),
            held: Vec::new(),
            prior: Prior::Entropic,
            prior_weight: None,
            preprocess: Preprocess::default(),
            shapes: Shapes::Stated,
        }
    }
}

/// What the intervals of an identification are about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Intervals {
    /// Repetitions of the recording: residuals as coloured as they are, by the equations of the method.
    Sampling,
    /// The same, with the pull towards the nominal robot counted as knowledge: an estimate that is drawn there is biased, and by how much
    /// no recording says. Right as far as the nominal robot is as wrong as the prior, chosen by cross-validation, takes it to be.
    Posterior,
    /// Repetitions of a recording of which columns and effort, at length one, are noisy alike, to first order in that noise.
    FirstOrder,
}

impl Intervals {
    /// In words.
    #[must_use]
    pub fn says(self) -> &'static str {
        match self {
            Self::Sampling => "over repetitions of the recording, residuals as coloured as they are",
            Self::Posterior => "over repetitions of the recording, with the pull to the nominal robot counted as knowledge (posterior)",
            Self::FirstOrder => "to first order in the noise of columns and effort, which is taken to be alike in all at length one",
        }
    }
}

/// A base parameter.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Estimated {
    /// The combination, by names of parameters.
    pub name: String,
    /// Unit.
    pub unit: &'static str,
    /// In the robot's files.
    pub nominal: f64,
    /// As identified.
    pub value: f64,
    /// 95 % interval.
    pub ci95: [f64; 2],
    /// Standard deviation over the size of the value.
    pub relative_sd: f64,
}

/// Errors of one drive on held-out rows, and its residual there.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct JointError {
    /// The driven joint.
    pub joint: String,
    /// Unit of its effort.
    pub unit: &'static str,
    /// Root mean square of the measured effort.
    pub effort_rms: f64,
    /// Root mean square error of the nominal robot, as a share of the effort's.
    pub nominal: f64,
    /// The same as identified.
    pub identified: f64,
    /// The same on the rows that were fitted (without standstill).
    pub fitted: f64,
    /// Correlation of neighbouring residuals of the fit.
    pub lag_one: f64,
    /// Whether the fit's residual could be white noise.
    pub is_white: bool,
    /// How often normal noise would be as skewed or heavy-tailed as the fit's residual.
    pub normality: f64,
}

/// Ranks and conditions.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct BaseSummary {
    /// Parameters with a column that is not zero, of those to be estimated.
    pub acting: usize,
    /// Independent combinations that some motion shows; tolerance and gap of the rank.
    pub structural: usize,
    /// Independent combinations that these recordings show.
    pub shown: usize,
    /// Share of the largest pivot below which one counts as zero.
    pub tolerance: f64,
    /// Last pivot that counts over the first that does not; 0 when none is left over.
    pub gap: f64,
    /// Condition number of the base columns at length one.
    pub condition: f64,
    /// Condition number of the base columns in SI units.
    pub condition_raw: f64,
    /// Columns that could be estimated together with a condition number below `well_conditioned_limit`.
    pub well_conditioned: usize,
    /// That limit.
    pub well_conditioned_limit: f64,
}

/// One recording and its use.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct UsedRecording {
    /// Name as the user gave it.
    pub path: String,
    /// Samples on the grid.
    pub samples: usize,
    /// `fit`, `holdout` or `both`.
    pub used: &'static str,
}

/// The outcome of an identification.
#[derive(Debug, Clone)]
pub struct Identification {
    /// Robot name.
    pub robot: String,
    /// Whether the answer may be used.
    pub status: Status,
    /// What speaks against it.
    pub notes: Vec<Note>,
    /// How it was estimated.
    pub method: Method,
    /// Band of effort and model `[Hz]`.
    pub band_hz: f64,
    /// Weight of the prior per row; 0 without.
    pub prior_weight: f64,
    /// Rows that were fitted, all drives.
    pub n_rows: usize,
    /// What was recorded.
    pub recordings: Vec<UsedRecording>,
    /// Ranks and conditions.
    pub base: BaseSummary,
    /// Base parameters.
    pub parameters: Vec<Estimated>,
    /// What their intervals are about.
    pub intervals: Intervals,
    /// Errors by drive.
    pub joints: Vec<JointError>,
    /// Names, units and nominal values of all parameters.
    pub columns: Columns,
    /// All parameters of a physical robot with these base parameters.
    pub theta: Vec<f64>,
    /// The set of base parameters.
    pub set: Option<BaseSet>,
    /// Covariance of the base parameters.
    pub covariance: Mat<f64>,
    /// Steps of the reduction to relevant parameters; empty with other methods.
    pub steps: Vec<Step>,
    /// What was done to the recordings first.
    pub preprocessing: Vec<Done>,
    /// Shapes of friction laws that were estimated.
    pub shapes: Vec<Shape>,
    /// How the instruments came about; `None` with other methods.
    pub instruments: Option<Instruments>,
}

impl Identification {
    /// Held-out error, one number: root mean square over the drives of error over effort.
    #[must_use]
    pub fn pooled(&self, of: fn(&JointError) -> f64) -> f64 {
        let n = self.joints.len().max(1) as f64;
        (self.joints.iter().map(|j| of(j) * of(j)).sum::<f64>() / n).sqrt()
    }
}

/// Why there is no answer at all.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum IdentifyError {
    /// The recordings do not fit the robot.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The method wants a closed loop to be simulated, and was given none.
    #[error("method iv needs a simulation of the closed loop")]
    NoSimulation,
    /// The robot cannot move.
    #[error("robot {robot:?}: {source}")]
    Robot {
        /// Robot name.
        robot: String,
        /// Why.
        source: BaseError,
    },
}
