//! The verdict: what was located, named, modelled and improved, in the JSON layout tools outside pkm read (schema `pkm.verdict/1`).

use alloc::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::isolability::Isolability;

/// Name of the JSON layout.
pub const SCHEMA: &str = "pkm.verdict/1";

/// How the diagnosis ended.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// The recordings could be used; findings may be empty.
    #[default]
    Ok,
    /// The gate rejected the recordings; nothing else is filled.
    Unusable,
    /// The mismatch does not repeat from period to period.
    NotRepeatable,
}

/// What one recording was used for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Use {
    /// Fitted and selected on.
    Train,
    /// Only judged on.
    Holdout,
    /// Fitted on some blocks, judged on the others.
    Both,
}

/// One recording as the verdict names it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordingUse {
    /// Path as given.
    pub path: String,
    /// Number of samples.
    pub samples: usize,
    /// Length `[s]`.
    pub duration_s: f64,
    /// What it was used for.
    pub used: Use,
    /// Held-out spans `[s]`, start and end, on the recording's own time axis.
    #[serde(default)]
    pub heldout_spans: Vec<[f64; 2]>,
}

/// Held-out errors; all are fractions of the measured effort's rms (formats section 3).
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Heldout {
    /// The model as given.
    pub rms_nominal: f64,
    /// Rigid-body, friction and offset parameters refitted, no physics added.
    pub rms_refit: f64,
    /// With every finding added.
    pub rms_final: f64,
    /// Estimated measurement noise, below which no model can go.
    pub noise_floor: f64,
    /// Zero-phase low-pass applied to effort and model alike `[Hz]`.
    pub band_hz: f64,
    /// Always `fraction of tau rms`.
    pub unit: String,
    /// The same per actuated joint.
    #[serde(default)]
    pub joints: Vec<HeldoutJoint>,
}

/// Held-out errors of one actuated joint, in the joint's own unit.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct HeldoutJoint {
    /// Joint name.
    pub joint: String,
    /// `N` or `N·m`.
    pub unit: String,
    /// rms of the measured effort.
    pub rms_tau: f64,
    /// rms error of the model as given.
    pub rms_nominal: f64,
    /// rms error after refitting the parameters the model already has.
    pub rms_refit: f64,
    /// rms error with every finding added.
    pub rms_final: f64,
}

/// Efforts with which surplus drives strain each other; they move nothing.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct InternalEffort {
    /// The drives.
    #[serde(rename = "where")]
    pub place: Vec<String>,
    /// rms over drives and samples.
    pub rms: f64,
    /// Largest at any drive.
    pub peak: f64,
    /// `N` or `N·m`.
    pub unit: String,
    /// Its rms over that of the measured efforts.
    pub share: f64,
    /// Share of its square that does not change with time.
    pub steady_share: f64,
    /// rms by which a drive's measured position differs from what the loops have for all drives together `[m | rad]`.
    pub contradiction_rms: f64,
    /// One sentence.
    pub says: String,
}

/// A value with its 95 % interval and unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Best value.
    pub value: f64,
    /// 95 % confidence interval.
    pub ci95: [f64; 2],
    /// Unit.
    pub unit: String,
}

/// An effect at a place.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct EffectAt {
    /// Effect name.
    pub effect: String,
    /// Joints, links, loops or sensors as the robot's files name them.
    #[serde(rename = "where")]
    pub place: Vec<String>,
    /// What would tell it apart from the finding that lists it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub separating_experiment: String,
}

/// An explanation that was considered and rejected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LookAlike {
    /// Effect name.
    pub effect: String,
    /// Where it was tried.
    #[serde(rename = "where", default)]
    pub place: Vec<String>,
    /// Why it is not the answer, with the number that says so.
    pub why_not: String,
    /// The experiment that would separate the two for good.
    pub separating_experiment: String,
}

/// One piece of missing physics: located, named, sized and proven on held-out data.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// 1 is the most important.
    pub rank: usize,
    /// Effect name (formats section 4).
    pub effect: String,
    /// Where it acts.
    #[serde(rename = "where")]
    pub place: Vec<String>,
    /// Regimes in which it shows.
    pub regime: Vec<String>,
    /// The regime in numbers, e.g. `|dq.q1| < 0.02 m/s, 31 % of samples`.
    pub when: String,
    /// Probability that it is this effect: the chance that it, or one of `cannot_tell_from`, is there, shared evenly among all of them, times the
    /// cosine between what is left without it and what it explains.
    pub confidence: f64,
    /// Family-wise p-value from B null runs; never below 1/(B+1).
    pub p_value: f64,
    /// Identified parameters by name.
    pub parameters: BTreeMap<String, Estimate>,
    /// The verdict's held-out number before this finding is added (findings are added in rank order).
    pub heldout_rms_before: f64,
    /// The same after it is added.
    pub heldout_rms_after: f64,
    /// One sentence a robot engineer would write.
    pub says: String,
    /// The equation with its symbols, as fitted.
    #[serde(default)]
    pub equation: String,
    /// What a controller does about it.
    #[serde(default)]
    pub compensation: Compensation,
    /// Considered and rejected.
    pub look_alikes: Vec<LookAlike>,
    /// Cannot be separated from the finding by these recordings.
    pub cannot_tell_from: Vec<EffectAt>,
    /// What would separate it from each of them, cheapest first, with the angle to expect.
    #[serde(default)]
    pub experiments: Vec<Experiment>,
    /// What it explains under three strengths of belief in the model's inertias.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depends_on_prior: Option<PriorGains>,
}

/// An experiment that would change what a finding can be told from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Experiment {
    /// The other effect.
    pub against: String,
    /// Where that is.
    #[serde(rename = "where")]
    pub place: Vec<String>,
    /// What to do, in a few words.
    pub intervention: String,
    /// Cosine of the angle between the two effects along the motions recorded so far, 0 to 1.
    pub cos_now: f64,
    /// The same with the experiment added, from the nominal model.
    pub cos_expected: f64,
    /// Whether that tells them apart.
    pub separates: bool,
    /// The same as a sentence.
    pub says: String,
}

/// Share of the squared error of its drives that a finding takes away on blocks it was not fitted on, with the model's inertias taken as
/// exact, within the chosen prior, and free.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct PriorGains {
    /// Inertias exact: what changed on the same robot?
    pub anchored: f64,
    /// Inertias within `soft_prior` of their size.
    pub soft: f64,
    /// Inertias free: is the structure wrong?
    pub refit: f64,
    /// How far off inertias may be for `soft`, as a share of their size.
    pub soft_prior: f64,
    /// Whether it is worth a name under some of them and not under others.
    pub depends: bool,
}

/// What is left after every finding.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Unexplained {
    /// Whether something is missing that the library has no name for.
    pub present: bool,
    /// Held-out squared error left after every finding, as a share of the nominal model's.
    pub share_of_residual: f64,
    /// Joints where most of the error stays.
    #[serde(rename = "where")]
    pub place: Vec<String>,
    /// Signals the leftover depends on, strongest first.
    pub depends_on: Vec<String>,
    /// The same in a sentence.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub says: String,
}

/// The smallest size of an effect these recordings could have shown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Detectable {
    /// Effect name.
    pub effect: String,
    /// Where.
    #[serde(rename = "where")]
    pub place: Vec<String>,
    /// Which parameter.
    pub parameter: String,
    /// Smallest visible size.
    pub value: f64,
    /// Unit.
    pub unit: String,
    /// The same as a sentence.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub says: String,
}

/// An effect that these recordings could not have shown in any size.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Invisible {
    /// Effect name.
    pub effect: String,
    /// Where.
    #[serde(rename = "where")]
    pub place: Vec<String>,
    /// Why not.
    pub why: String,
}

/// A candidate that is no finding, and why.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Screened {
    /// Effect name.
    pub effect: String,
    /// Where.
    #[serde(rename = "where")]
    pub place: Vec<String>,
    /// Held-out squared error it would take away, as a share of what is there.
    pub gain: f64,
    /// That gain in standard deviations of what the candidate gains in null runs, above their mean `[sigma]`.
    pub surprise: f64,
    /// Folds in which it helped, of how many.
    pub wins: [usize; 2],
    /// Why it is not a finding.
    pub why_not: String,
}

/// One drive of a recording, replayed in simulation under feedback: the robot as given ("before") and the refined one ("after").
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Replay {
    /// The recording.
    pub recording: String,
    /// The drive.
    pub joint: String,
    /// What moved the simulated robots, and along what.
    pub how: String,
    /// rms of the measured effort about its mean `[N | N·m]`.
    pub rms_tau: f64,
    /// rms of measured less simulated effort, as given `[N | N·m]`.
    pub effort_before: f64,
    /// The same, refined.
    pub effort_after: f64,
    /// rms of measured less simulated position, as given `[m | rad]`.
    pub position_before: f64,
    /// The same, refined.
    pub position_after: f64,
    /// Work of the drive as measured `[J]`.
    pub work_measured: f64,
    /// Its work in simulation, as given `[J]`.
    pub work_before: f64,
    /// The same, refined.
    pub work_after: f64,
}

/// What a controller does about a finding.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Compensation {
    /// Whether a controller that computes with the refined robot file has it already.
    pub in_refined_model: bool,
    /// What to do, with the numbers found.
    pub says: String,
}

/// The answer to one diagnosis.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Always [`SCHEMA`].
    pub schema: String,
    /// How the diagnosis ended.
    pub status: Status,
    /// Robot name.
    pub robot: String,
    /// The recordings and what they were used for.
    pub recordings: Vec<RecordingUse>,
    /// Whether the nominal model explains the recordings.
    pub nothing_missing: bool,
    /// Held-out errors.
    pub heldout: Heldout,
    /// Findings, most important first.
    pub findings: Vec<Finding>,
    /// What is left.
    pub unexplained: Unexplained,
    /// What could not have been seen.
    pub minimum_detectable: Vec<Detectable>,
    /// Recordings replayed in simulation, drive by drive; empty when nothing was replayed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub replay: Vec<Replay>,
    /// What could not have been seen in any size.
    #[serde(default)]
    pub invisible: Vec<Invisible>,
    /// What was tried and is no finding, largest gain first; the most promising of it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ruled_out: Vec<Screened>,
    /// Which effects these recordings could tell apart.
    #[serde(default, skip_serializing_if = "Isolability::is_empty")]
    pub isolability: Isolability,
    /// What surplus drives were measured to do to each other; absent unless there are more drives than freedoms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub internal_effort: Option<InternalEffort>,
    /// Path of the refined robot, beside the JSON; empty when none was written.
    pub refined_model: String,
    /// Reasons for `unusable` or `not_repeatable`, else a one-sentence summary.
    pub says: String,
    /// What the gate noticed without rejecting the recordings, one line each.
    #[serde(default)]
    pub notes: Vec<String>,
}
