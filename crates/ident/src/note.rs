//! What an identification has to say against itself, each with its numbers.

use core::fmt;

use crate::degrees::OtherPositions;
use crate::mixed::Mixed;
use crate::seconds::OtherTime;
use crate::thousands::OtherUnits;

/// Whether the answer may be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// Nothing speaks against it.
    Identified,
    /// There is an answer; the notes say what is wrong with it.
    Doubtful,
    /// There is none; the notes say why. The parameters are the nominal ones.
    NotIdentified,
}

/// One objection.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[serde(tag = "note", rename_all = "snake_case")]
pub enum Note {
    /// A drive hardly moved: its own parameters keep their nominal values and its rows are not used.
    StandsStill {
        /// The driven joint.
        joint: String,
        /// Its travel `[m | rad]`.
        travel: f64,
        /// Travel that would do `[m | rad]`.
        limit: f64,
    },
    /// No drive moved.
    NoMotion,
    /// Efforts in kN or mN·m: parameters from them would be a thousand times too small or too large.
    OtherUnits(OtherUnits),
    /// Efforts with their sign turned or in each other's columns.
    Mixed(Mixed),
    /// Positions in degrees or millimetres.
    OtherPositions(OtherPositions),
    /// Time in milliseconds.
    OtherTime(OtherTime),
    /// Fewer rows than the parameters need.
    FewRows {
        /// Rows of all drives.
        rows: usize,
        /// Parameters to estimate.
        parameters: usize,
        /// Rows that would do.
        limit: usize,
    },
    /// The motion shows fewer combinations than the robot has: it is rank-deficient.
    RankDeficient {
        /// Combinations that some motion of the robot would show.
        structural: usize,
        /// Combinations that this one shows.
        shown: usize,
        /// Share of the largest pivot below which one counts as zero.
        tolerance: f64,
    },
    /// The base parameters are badly conditioned: small errors of the recordings become large ones of some parameters.
    IllConditioned {
        /// Condition number of the base columns at length one.
        condition: f64,
        /// Limit.
        limit: f64,
        /// Base parameters that could be estimated together below the limit.
        well_conditioned: usize,
    },
    /// Rows that no parameters explain.
    Outliers {
        /// Share of rows further than four robust standard deviations off.
        share: f64,
        /// Limit.
        limit: f64,
    },
    /// Single samples of effort that stand out of their neighbours; they were replaced by the median around them.
    Spikes {
        /// The driven joint.
        joint: String,
        /// Share of its samples.
        share: f64,
        /// Limit.
        limit: f64,
    },
    /// No physical robot has the parameters that the recordings alone ask for: friction below zero or masses that are none.
    Infeasible {
        /// Mean squared weighted residual of the estimate without bounds.
        unbounded: f64,
        /// The same of the physical robot that was taken instead.
        physical: f64,
        /// Ratio of the two above which this is said.
        limit: f64,
    },
    /// A link of the robot file has an inertia that no body has; the estimate starts from the nearest extended one.
    NominalNotABody {
        /// The link.
        link: String,
        /// Squared extent that had to be added `[m²]`.
        added: f64,
    },
    /// The convex program did not reach its accuracy.
    Solver {
        /// How it ended.
        outcome: &'static str,
        /// Iterations.
        iterations: u32,
    },
    /// An iteration did not settle.
    NotSettled {
        /// Passes.
        iterations: usize,
    },
    /// No combination of noisy columns is the effort: the estimate is weighted least squares.
    NoTotal {
        /// Base parameters that were asked for.
        parameters: usize,
    },
    /// Parameters that are at the edge of what is physical: intervals of the others are those with these held there.
    AtBound {
        /// Their names.
        parameters: Vec<String>,
    },
    /// The outputs of a simulation do not depend on a parameter.
    Silent {
        /// Its name.
        parameter: String,
    },
    /// The outputs of a simulation depend on a combination of parameters only.
    OnlyTogether {
        /// Their names.
        parameters: Vec<String>,
    },
    /// The search for a gain ended at an end of its range.
    GainAtBound {
        /// The driven joint.
        joint: String,
        /// The gain at that end.
        gain: f64,
        /// The range of gains that was searched.
        range: [f64; 2],
    },
    /// The estimated lateness is an end of the range that was searched: the efforts are left where they are stamped.
    LatenessAtEdge {
        /// Where the search ended `[s]`.
        late_s: f64,
        /// Range to either side `[s]`.
        most_s: f64,
    },
    /// No instruments could be made: the estimate is weighted least squares.
    NoInstruments {
        /// Simulations that went well before.
        iterations: usize,
        /// Why.
        reason: String,
    },
    /// The simulated motion says little about the measured one.
    WeakInstruments {
        /// The base parameter whose column it explains least.
        parameter: String,
        /// Share of that column that is explained.
        explained: f64,
        /// Limit.
        limit: f64,
    },
    /// A shape of a friction law that the motion does not show; it stays where the search ended.
    ShapeNotShown {
        /// The shape.
        shape: String,
        /// Where the search ended.
        value: f64,
        /// As stated in the robot file.
        stated: f64,
    },
    /// No recording states a load: gains of drives and masses cannot be told apart.
    NoKnownLoad {
        /// Recordings that were looked at.
        recordings: usize,
    },
    /// The known load hardly acts on a drive.
    GainNotShown {
        /// The driven joint.
        joint: String,
        /// Half of the gain's interval over the gain.
        half_width: f64,
        /// Limit.
        limit: f64,
    },
    /// A payload that the drives hardly feel.
    PayloadNotSeen {
        /// The link it would ride on.
        link: String,
        /// Estimated mass `[kg]`.
        mass: f64,
        /// Its 95 % interval `[kg]`.
        interval: [f64; 2],
    },
    /// Held-out error of a drive became larger than with the nominal robot.
    Worse {
        /// The driven joint.
        joint: String,
        /// Nominal error, share of the effort's rms.
        nominal: f64,
        /// Error after identification.
        identified: f64,
    },
}

impl Note {
    /// What this note makes of the answer.
    #[must_use]
    pub fn verdict(&self) -> Status {
        match self {
            Self::NoMotion
            | Self::OtherUnits(_)
            | Self::Mixed(_)
            | Self::OtherPositions(_)
            | Self::OtherTime(_)
            | Self::FewRows { .. }
            | Self::Solver { outcome: "failed", .. }
            | Self::NoKnownLoad { .. } => Status::NotIdentified,
            Self::NominalNotABody { .. } | Self::AtBound { .. } => Status::Identified,
            _ => Status::Doubtful,
        }
    }

    /// The worst verdict of all.
    #[must_use]
    pub fn worst(notes: &[Self]) -> Status {
        let verdicts: Vec<Status> = notes.iter().map(Self::verdict).collect();
        [Status::NotIdentified, Status::Doubtful].into_iter().find(|s| verdicts.contains(s)).unwrap_or(Status::Identified)
    }
}

impl fmt::Display for Note {
    #[expect(clippy::too_many_lines, reason = "one sentence per note")]
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::StandsStill { joint, travel, limit } => {
                write!(f, "{joint} stands still: it travels {travel:.3e} m or rad (limit {limit:.3e}); its parameters stay nominal")
            }
            Self::NoMotion => write!(f, "no drive moves: nothing can be identified"),
            Self::OtherUnits(found) => write!(f, "{found}"),
            Self::Mixed(found) => write!(f, "{found}"),
            Self::OtherPositions(found) => write!(f, "{found}"),
            Self::OtherTime(found) => write!(f, "{found}"),
            Self::FewRows { rows, parameters, limit } => {
                write!(
                    f,
                    "{rows} independent rows for {parameters} parameters (at least {limit} are needed): record longer, or raise --band"
                )
            }
            Self::RankDeficient { structural, shown, tolerance } => write!(
                f,
                "the motion shows {shown} of {structural} base parameters (pivots below {tolerance:.0e} of the largest count as zero): \
                 the others stay near nominal"
            ),
            Self::IllConditioned { condition, limit, well_conditioned } => write!(
                f,
                "condition number {condition:.0} of the base parameters (limit {limit:.0}); {well_conditioned} of them would stay below it: \
                 look at their intervals, or use a motion made for identification"
            ),
            Self::Outliers { share, limit } => write!(
                f,
                "{:.1} % of the rows are further than 4 standard deviations off (limit {:.1} %): try --method bisquare, or look at them",
                100.0 * share,
                100.0 * limit
            ),
            Self::Spikes { joint, share, limit } => write!(
                f,
                "{joint}: {:.1} % of its effort samples stood out of their neighbours and were replaced (limit {:.1} %)",
                100.0 * share,
                100.0 * limit
            ),
            Self::Infeasible { unbounded, physical, limit } => write!(
                f,
                "no physical robot has what the recordings ask for: squared error {physical:.3} instead of {unbounded:.3} in units of the \
                 noise (limit {limit} times): some physics is missing, see `pkm diagnose`"
            ),
            Self::NominalNotABody { link, added } => {
                write!(
                    f,
                    "link {link}: its nominal inertia is that of something flat or thin, or of no body; {:.1} cm of extent were added to start from",
                    100.0 * added.sqrt()
                )
            }
            Self::Solver { outcome, iterations } => write!(f, "the convex program ended {outcome} after {iterations} iterations"),
            Self::NotSettled { iterations } => write!(f, "the iteration did not settle in {iterations} passes"),
            Self::NoTotal { parameters } => write!(
                f,
                "no total least squares of {parameters} parameters: the smallest singular vector has no part along the effort; this is the \
                 weighted least-squares estimate"
            ),
            Self::AtBound { parameters } => {
                write!(f, "at the edge of what is physical: {}; other intervals are those with these held there", parameters.join(", "))
            }
            Self::Silent { parameter } => write!(f, "{parameter}: no output depends on it; it stays where the search began"),
            Self::OnlyTogether { parameters } => {
                write!(f, "{}: the outputs depend on a combination of them only, and not on each by itself", parameters.join(", "))
            }
            Self::GainAtBound { joint, gain, range: [low, high] } => write!(
                f,
                "{joint}: the search for its gain ended at {gain:.3}, an end of its range {low:.3} to {high:.3}: is the load stated in kilograms, \
                 and on for the whole recording?"
            ),
            Self::LatenessAtEdge { late_s, most_s } => write!(
                f,
                "the efforts look {late_s:.4} s late, an end of the range of {most_s:.4} s to either side: they were left as stamped; search \
                 wider, or look at the clocks"
            ),
            Self::NoInstruments { iterations, reason } => {
                write!(f, "no instruments after {iterations} simulations ({reason}): this is the weighted least-squares estimate")
            }
            Self::WeakInstruments { parameter, explained, limit } => write!(
                f,
                "the simulated motion explains {:.1} % of the column of {parameter} (limit {:.0} %): is the controller in the simulation the real one?",
                100.0 * explained,
                100.0 * limit
            ),
            Self::ShapeNotShown { shape, value, stated } => {
                write!(f, "{shape}: the motion does not show it; the search from {stated:.3e} ended at {value:.3e}")
            }
            Self::NoKnownLoad { recordings } => write!(
                f,
                "none of {recordings} recordings states a load: gains and masses cannot be told apart; record once more with a weighed mass"
            ),
            Self::GainNotShown { joint, half_width, limit } => write!(
                f,
                "{joint}: its gain is known to {:.0} % only (limit {:.0} %): the known load hardly acts on it",
                100.0 * half_width,
                100.0 * limit
            ),
            Self::PayloadNotSeen { link, mass, interval } => write!(
                f,
                "{link}: no payload can be told from none: {mass:.3e} kg, 95 % interval {:.3e} to {:.3e} kg",
                interval[0], interval[1]
            ),
            Self::Worse { joint, nominal, identified } => write!(
                f,
                "{joint}: held-out error {:.1} % of the effort, with the nominal robot {:.1} %",
                100.0 * identified,
                100.0 * nominal
            ),
        }
    }
}
