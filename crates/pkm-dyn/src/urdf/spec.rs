//! robot.toml as it is written (formats section 1). Unknown keys are errors.

use alloc::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// A frame fixed to a link.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameSpec {
    /// Link name.
    pub link: String,
    /// Origin in the link's frame `[m]`.
    #[serde(default)]
    pub xyz: [f64; 3],
    /// Roll, pitch, yaw `[rad]`.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub rpy: [f64; 3],
}

fn is_zero(x: &[f64; 3]) -> bool {
    x.iter().all(|x| x.abs() == 0.0)
}

/// A `[[loop]]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoopSpec {
    /// Name.
    pub name: String,
    /// Frame a.
    pub a: FrameSpec,
    /// Frame b.
    pub b: FrameSpec,
    /// Forbidden motions of b relative to a, seen in a.
    pub constrain: Vec<String>,
}

/// An `[[actuator]]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorSpec {
    /// Driven joint.
    pub joint: String,
    /// Rotor inertia at the joint `[kg | kg·m²]`.
    #[serde(default)]
    pub rotor_inertia: f64,
}

/// A `[[coupling]]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CouplingSpec {
    /// Joint whose coordinate is defined.
    pub joint: String,
    /// Ratios of the joints it follows.
    pub of: BTreeMap<String, f64>,
    /// Constant part `[m | rad]`.
    #[serde(default)]
    pub offset: f64,
}

/// A `[[sensor]]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorSpec {
    /// Name.
    pub name: String,
    /// `wrench` or `pose`.
    pub kind: String,
    /// Link it sits on.
    pub link: String,
    /// Origin in the link's frame `[m]`.
    #[serde(default)]
    pub xyz: [f64; 3],
    /// Roll, pitch, yaw `[rad]`.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub rpy: [f64; 3],
}

/// One place or several.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Places {
    /// `where = "q1"`.
    One(String),
    /// `where = ["q1", "q2"]`.
    Many(Vec<String>),
}

impl Places {
    /// As a list.
    #[must_use]
    pub fn names(&self) -> Vec<&str> {
        match self {
            Self::One(name) => vec![name],
            Self::Many(names) => names.iter().map(String::as_str).collect(),
        }
    }
}

/// An `[[effect]]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectSpec {
    /// Name in the catalogue.
    pub name: String,
    /// Joint or link it sits at; with several, each gets the effect.
    #[serde(rename = "where")]
    pub places: Places,
    /// Parameters by name, SI.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
}

/// A whole robot.toml.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    /// Robot name.
    pub name: String,
    /// URDF beside this file.
    pub urdf: String,
    /// Gravity in the root link's frame `[m/s²]`.
    #[serde(default = "earth")]
    pub gravity: [f64; 3],
    /// Rough coordinates of the intended assembly `[m | rad]`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub assembly: BTreeMap<String, f64>,
    /// Loop closures.
    #[serde(default, rename = "loop", skip_serializing_if = "Vec::is_empty")]
    pub loops: Vec<LoopSpec>,
    /// Drives, in the order of `tau`.
    #[serde(default, rename = "actuator", skip_serializing_if = "Vec::is_empty")]
    pub actuators: Vec<ActuatorSpec>,
    /// Linear relations.
    #[serde(default, rename = "coupling", skip_serializing_if = "Vec::is_empty")]
    pub couplings: Vec<CouplingSpec>,
    /// Sensors.
    #[serde(default, rename = "sensor", skip_serializing_if = "Vec::is_empty")]
    pub sensors: Vec<SensorSpec>,
    /// Physics beyond rigid bodies.
    #[serde(default, rename = "effect", skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectSpec>,
}

fn earth() -> [f64; 3] {
    [0.0, 0.0, -9.81]
}
