//! What is read of a verdict (docs/FORMATS.md): as little as scoring needs, and nothing of the crate that writes it.

use alloc::collections::BTreeMap;

use serde::Deserialize;

/// A verdict.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
pub struct Verdict {
    /// `ok`, `unusable` or `not_repeatable`.
    #[serde(default)]
    pub status: String,
    /// Findings, most important first.
    #[serde(default)]
    pub findings: Vec<Finding>,
    /// What has no name.
    #[serde(default)]
    pub unexplained: Unexplained,
    /// Errors on held-out samples.
    #[serde(default)]
    pub heldout: Heldout,
    /// What was tried and is not among the findings.
    #[serde(default)]
    pub ruled_out: Vec<RuledOut>,
    /// What these recordings cannot show.
    #[serde(default)]
    pub invisible: Vec<Invisible>,
    /// The smallest that can be seen.
    #[serde(default)]
    pub minimum_detectable: Vec<Smallest>,
}

/// An effect that is not a finding, and the reason.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
pub struct RuledOut {
    /// Name of the effect.
    pub effect: String,
    /// Joints, links or loops.
    #[serde(default, rename = "where")]
    pub place: Vec<String>,
    /// Why not.
    #[serde(default)]
    pub why_not: String,
}

/// An effect that cannot be seen, and the reason.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
pub struct Invisible {
    /// Name of the effect.
    pub effect: String,
    /// Joints, links or loops.
    #[serde(default, rename = "where")]
    pub place: Vec<String>,
    /// Why.
    #[serde(default)]
    pub why: String,
}

/// The smallest of an effect that can be seen.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
pub struct Smallest {
    /// Name of the effect.
    pub effect: String,
    /// Joints, links or loops.
    #[serde(default, rename = "where")]
    pub place: Vec<String>,
    /// Name of the parameter.
    #[serde(default)]
    pub parameter: String,
    /// Smallest value, SI.
    #[serde(default)]
    pub value: f64,
}

/// A finding.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
pub struct Finding {
    /// Name of the effect.
    pub effect: String,
    /// Joints, links or loops.
    #[serde(default, rename = "where")]
    pub place: Vec<String>,
    /// When it acts.
    #[serde(default)]
    pub regime: Vec<String>,
    /// Stated probability of being right.
    #[serde(default)]
    pub confidence: f64,
    /// Estimates by name.
    #[serde(default)]
    pub parameters: BTreeMap<String, Estimate>,
    /// What it cannot be told from.
    #[serde(default)]
    pub cannot_tell_from: Vec<Place>,
    /// What looks like it and is not.
    #[serde(default)]
    pub look_alikes: Vec<RuledOut>,
    /// Held-out error without it, as a share of the effort.
    #[serde(default, rename = "heldout_rms_before")]
    pub before: f64,
    /// Held-out error with it, as a share of the effort.
    #[serde(default, rename = "heldout_rms_after")]
    pub after: f64,
}

/// An effect somewhere.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
pub struct Place {
    /// Name of the effect.
    pub effect: String,
    /// Joints, links or loops.
    #[serde(default, rename = "where")]
    pub place: Vec<String>,
}

/// An estimate.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
pub struct Estimate {
    /// Value, SI.
    pub value: f64,
    /// Interval that holds the truth 95 times in a hundred.
    #[serde(default)]
    pub ci95: Option<[f64; 2]>,
}

/// What has no name.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
pub struct Unexplained {
    /// Whether there is any.
    #[serde(default)]
    pub present: bool,
}

/// Errors on held-out samples, as shares of the effort.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
pub struct Heldout {
    /// The model as given.
    #[serde(default)]
    pub rms_nominal: f64,
    /// With every finding.
    #[serde(default)]
    pub rms_final: f64,
    /// Low-pass of the comparison `[Hz]`.
    #[serde(default)]
    pub band_hz: f64,
}
