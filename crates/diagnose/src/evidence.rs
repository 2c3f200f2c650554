//! The numbers behind the pictures: what a reader needs to see to believe or refute a verdict. Plain series, no drawing here.

use pkm_dyn::Model;
use pkm_dyn::effects::Applied;
use pkm_dyn::urdf::{Description, refined_toml, refined_urdf};
use serde::{Deserialize, Serialize};

pub use crate::verdict::Screened;
use crate::verdict::Verdict;

/// One actuated joint over one recording.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct JointSeries {
    /// Joint name.
    pub joint: String,
    /// Unit of effort, `N` or `N·m`.
    pub unit: String,
    /// Recording it belongs to.
    pub recording: String,
    /// Time `[s]`.
    pub time: Vec<f64>,
    /// Measured effort after the verdict's low-pass.
    pub measured: Vec<f64>,
    /// The model as given, after the same low-pass.
    pub nominal: Vec<f64>,
    /// The refined model, after the same low-pass.
    pub refined: Vec<f64>,
    /// Held-out spans, start and end `[s]`.
    pub heldout_spans: Vec<[f64; 2]>,
    /// rms of `measured - nominal` over the held-out samples, in `unit`.
    pub rms_nominal: f64,
    /// rms of `measured - refined` over the held-out samples, in `unit`.
    pub rms_refined: f64,
}

/// A finding as a picture: what the model lacks without it, against the variable that explains it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FindingPlot {
    /// Rank of the finding.
    pub rank: usize,
    /// Horizontal axis with unit, e.g. `velocity of q1 [m/s]`.
    pub x_label: String,
    /// Vertical axis with unit, e.g. `effort left at q1 [N]`.
    pub y_label: String,
    /// Horizontal values of the samples.
    pub x: Vec<f64>,
    /// What is left of the measured effort when everything but this finding is modelled.
    pub y: Vec<f64>,
    /// Whether the sample is held out.
    pub is_heldout: Vec<bool>,
    /// The finding's own contribution at the same samples.
    pub model: Vec<f64>,
}

/// Squared error of one joint in one regime, before and after.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RegimeCell {
    /// Joint name.
    pub joint: String,
    /// Regime name (formats section 3).
    pub regime: String,
    /// Share of samples in the regime, 0 to 1.
    pub share: f64,
    /// rms error over the joint's effort rms, model as given.
    pub before: f64,
    /// The same with every finding.
    pub after: f64,
}

/// One step of the chain from the model as given to the refined one.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ChainStep {
    /// What was added.
    pub label: String,
    /// The verdict's held-out number after it.
    pub heldout_rms: f64,
}

/// A leftover against one signal: partial dependence in stretches of equally many rows.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Dependence {
    /// The drive.
    pub joint: String,
    /// Unit of effort, `N` or `N·m`.
    pub unit: String,
    /// The signal, as the recordings name it.
    pub signal: String,
    /// Mean of the signal in each stretch.
    pub x: Vec<f64>,
    /// Mean leftover in each stretch.
    pub mean: Vec<f64>,
    /// Two standard errors of that mean.
    pub error: Vec<f64>,
}

/// A leftover's amplitude over frequency or order.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Lines {
    /// The drive.
    pub joint: String,
    /// Unit of effort, `N` or `N·m`.
    pub unit: String,
    /// What the lines are over, with unit.
    pub over: String,
    /// Frequency or order.
    pub x: Vec<f64>,
    /// Amplitude there.
    pub amplitude: Vec<f64>,
}

/// Effort of one drive in a replay, thinned for drawing.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ReplaySeries {
    /// The recording.
    pub recording: String,
    /// The joint.
    pub joint: String,
    /// Time `[s]`.
    pub time: Vec<f64>,
    /// Measured effort `[N | N·m]`.
    pub measured: Vec<f64>,
    /// Effort of the simulated robot as given `[N | N·m]`.
    pub given: Vec<f64>,
    /// Effort of the simulated refined robot `[N | N·m]`.
    pub refined: Vec<f64>,
}

/// Everything a report shows besides the verdict.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// Joints × recordings.
    pub joints: Vec<JointSeries>,
    /// One per finding that has a picture.
    pub findings: Vec<FindingPlot>,
    /// Joints × regimes.
    pub regimes: Vec<RegimeCell>,
    /// From the model as given to the refined one.
    pub chain: Vec<ChainStep>,
    /// What was ruled out, best first.
    pub ruled_out: Vec<Screened>,
    /// Surprise above which chance alone is left behind (95 % and 99 % of the null's maximum), last step: `[sigma]` as
    /// [`Screened::surprise`], because joints differ in how much chance can gain there.
    pub null_surprise: [f64; 2],
    /// Number of null runs per step.
    pub null_runs: usize,
    /// What stays unexplained, against the signals it depends on.
    pub dependences: Vec<Dependence>,
    /// What stays unexplained, by frequency and by order.
    pub lines: Vec<Lines>,
    /// Joints × recordings that were replayed in simulation.
    pub replay: Vec<ReplaySeries>,
}

/// The robot with every finding in it.
#[derive(Debug, Clone)]
pub struct Refined {
    /// The model as the URDF has it, with changed inertias, friction, rotor inertias and gravity.
    pub model: Model,
    /// Physics beyond rigid bodies: what the robot file had, changed and completed by what was found.
    pub effects: Vec<Applied>,
}

impl Refined {
    /// The texts of a robot.toml (naming `urdf_name` beside it) and of that URDF.
    ///
    /// # Errors
    /// The writing library's reason.
    pub fn texts(&self, description: &Description, urdf_name: &str) -> Result<[String; 2], String> {
        let toml = refined_toml(description, &self.model, &self.effects, urdf_name)?;
        Ok([toml, refined_urdf(description, &self.model)?])
    }
}

/// A finished diagnosis: the verdict, what stands behind it, and the robot it leads to.
#[derive(Debug, Clone)]
pub struct Diagnosis {
    /// The answer.
    pub verdict: Verdict,
    /// The numbers behind the pictures.
    pub evidence: Evidence,
    /// The refined robot; `None` when the recordings were unusable.
    pub refined: Option<Refined>,
}
