//! Time recorded in milliseconds, microseconds or nanoseconds: samples too far apart to show a motion, and efforts that follow the robot
//! in the other unit far better than in seconds.
//!
//! Inertia grows with the square of the clock. Efforts of a robot that really creeps contradict accelerations a million times as large, and
//! those of one that seems to creep fit nothing else; where weight alone explains them either way, nothing is said.

use core::fmt;

use pkm_dyn::effects::Robot;

use crate::Recording;
use crate::identify::units;
use crate::motion::Use;
use crate::observation::{Observation, RowOptions};

/// Samples farther apart than this show no motion of a robot `[s]`.
pub const SLOW_S: f64 = 0.2;

/// Samples closer than this are nobody's rate `[s]`.
const FAST_S: f64 = 1e-5;

/// The wrong units there are, and how many of them are a second.
const WAYS: [(&str, f64); 3] = [("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)];

/// Correlation of effort and model from which on one follows the other.
const FOLLOWS: f64 = 0.8;

/// What the model leaves of an effort's square must fall to this share of itself.
const FALLS_TO: f64 = 0.25;

/// A recording whose time is not in seconds.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct OtherTime {
    /// Its name.
    pub recording: String,
    /// Mean time between samples as recorded, were it in seconds.
    pub apart: f64,
    /// The driven joint that tells it best.
    pub joint: String,
    /// Correlation of its effort with the model, as recorded and in the other unit.
    pub correlation: [f64; 2],
    /// What `t` must be divided by.
    pub factor: f64,
    /// The unit that it is in.
    pub recorded_in: &'static str,
}

impl fmt::Display for OtherTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { recording, apart, joint, correlation: [here, there], factor, recorded_in } = self;
        write!(
            f,
            "{recording}: samples are {apart:.3} s apart, and tau.{joint} follows the model only when t is divided by {factor} (correlation \
             {there:.2}, as recorded {here:.2}): is t in {recorded_in}? It must be in seconds"
        )
    }
}

/// Mean time between samples `[s]`.
#[must_use]
pub fn apart(recording: &Recording) -> f64 {
    recording.duration() / recording.len().saturating_sub(1).max(1) as f64
}

/// The unit that a recording's time is in, where that is certain; none for seconds.
#[must_use]
pub fn other_time(robot: &Robot, recording: &Recording) -> Option<OtherTime> {
    let apart = apart(recording);
    if !(apart > SLOW_S && apart.is_finite()) {
        return None;
    }
    let (recorded_in, factor) = WAYS.into_iter().find(|(_, factor)| (FAST_S..=SLOW_S).contains(&(apart / factor)))?;
    let mut other = recording.clone();
    other.time.iter_mut().for_each(|t| *t /= factor);
    let there = correlations(robot, &other)?;
    // What cannot even be made rows of follows nothing.
    let here = correlations(robot, recording).unwrap_or_else(|| vec![0.0; there.len()]);
    let left = |c: f64| 1.0 - c.max(0.0) * c.max(0.0);
    let tells = |better: f64, worse: f64| better > FOLLOWS && left(better) < FALLS_TO * left(worse);
    let pairs = || here.iter().copied().zip(there.iter().copied());
    if pairs().any(|(here, there)| tells(here, there)) {
        return None;
    }
    let told = pairs().enumerate().filter(|(_, (here, there))| tells(*there, *here));
    let (k, (here, there)) = told.max_by(|a, b| (a.1.1 - a.1.0).total_cmp(&(b.1.1 - b.1.0)))?;
    let joint = robot.model.joints[robot.model.actuators[k]].name.clone();
    Some(OtherTime { recording: recording.name.clone(), apart, joint, correlation: [here, there], factor, recorded_in })
}

/// Correlation of every drive's effort with the model's, zero where its size is another; none where no rows can be made of the recording.
fn correlations(robot: &Robot, recording: &Recording) -> Option<Vec<f64>> {
    let observation = Observation::try_new(robot, &[(recording, Use::Both)], RowOptions::default()).ok()?;
    let drives = units::seen_of(&observation).ok()?.pop()?;
    Some(drives.iter().map(|seen| seen.map_or(0.0, |s| s.correlation_as_it_is())).collect())
}
