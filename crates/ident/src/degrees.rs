//! Positions recorded in degrees or millimetres: far beyond a joint's limits as they are, inside them in the other unit; or loops that close only
//! there.

use core::f64::consts::PI;
use core::fmt;

use pkm_dyn::model::JointKind;
use pkm_dyn::{Data, Model, loops};

use crate::Recording;

/// How far beyond its limits a joint must be recorded, and how far it may be in the other unit: shares of its travel.
const FAR: f64 = 4.0;
const NEAR: f64 = 0.5;

/// The other units that positions come in.
const WAYS: [(JointKind, f64, &str); 2] = [(JointKind::Revolute, PI / 180.0, "degrees"), (JointKind::Prismatic, 1e-3, "millimetres")];

/// A column of positions that would make sense in another unit.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct OtherPositions {
    /// Name of the recording.
    pub recording: String,
    /// The driven joint.
    pub joint: String,
    /// Smallest and largest position as recorded.
    pub range: [f64; 2],
    /// The joint's limits, in its own unit.
    pub limits: [f64; 2],
    /// The joint's unit.
    pub unit: &'static str,
    /// The unit that the positions seem to be in.
    pub recorded_in: &'static str,
}

impl fmt::Display for OtherPositions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { recording, joint, range: [low, high], limits: [lower, upper], unit, recorded_in } = self;
        write!(
            f,
            "{recording}: q.{joint} goes from {low:.3} to {high:.3} {unit}, limits are {lower:.3} to {upper:.3} {unit}: is it in {recorded_in}?"
        )
    }
}

/// Driven joints of a recording whose positions would make sense in another unit; only those whose limits are stated can be told.
#[must_use]
pub fn other_positions(model: &Model, recording: &Recording) -> Vec<OtherPositions> {
    let told = |&j: &usize| {
        let joint = &model.joints[j];
        let [lower, upper] = [joint.limits.lower, joint.limits.upper];
        let known = recording.signal(&format!("q.{}", joint.name))?.iter().copied().filter(|x| x.is_finite());
        let (low, high) = known.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        let (_, factor, recorded_in) = WAYS.into_iter().find(|(kind, ..)| *kind == joint.kind)?;
        let travel = upper - lower;
        let is_known = lower.is_finite() && upper.is_finite() && travel > 0.0 && high > low;
        let is_far = high > upper + FAR * travel || low < lower - FAR * travel;
        let is_near = factor * low > lower - NEAR * travel && factor * high < upper + NEAR * travel;
        (is_known && is_far && is_near).then(|| OtherPositions {
            recording: recording.name.clone(),
            joint: joint.name.clone(),
            range: [low, high],
            limits: [lower, upper],
            unit: joint.kind.unit_position(),
            recorded_in,
        })
    };
    model.actuators.iter().filter_map(told).collect()
}

/// The unit in which the loops of a robot would close at drive positions `q`, where they do not as they are; none where they do, or nowhere.
#[must_use]
pub fn unit_that_closes(model: &Model, q: &[f64]) -> Option<&'static str> {
    let closes = |wanted: Option<(JointKind, f64)>| {
        let mut data = Data::new(model);
        let in_its_unit = |(q, &j): (&f64, &usize)| wanted.filter(|(kind, _)| *kind == model.joints[j].kind).map_or(*q, |(_, f)| f * q);
        let q: Vec<f64> = q.iter().zip(&model.actuators).map(in_its_unit).collect();
        loops::assemble(model, &mut data).is_closed && loops::walk_to(model, &mut data, &q).is_closed
    };
    if closes(None) {
        return None;
    }
    let is_there = |kind: JointKind| model.actuators.iter().any(|&j| model.joints[j].kind == kind);
    WAYS.into_iter().find(|&(kind, factor, _)| is_there(kind) && closes(Some((kind, factor)))).map(|(.., unit)| unit)
}

/// The same of the first positions of a recording; none where a column is missing.
#[must_use]
pub fn unit_that_closes_at_first(model: &Model, recording: &Recording) -> Option<&'static str> {
    let first = |j: &usize| recording.signal(&format!("q.{}", model.joints[*j].name))?.iter().copied().find(|q| q.is_finite());
    let q = model.actuators.iter().map(first).collect::<Option<Vec<f64>>>()?;
    unit_that_closes(model, &q)
}

/// What to ask of a recording whose loops stay open.
#[must_use]
pub fn open_question(robot: &str, unit: Option<&str>) -> String {
    unit.map_or_else(|| format!("is this a recording of {robot:?}?"), |unit| format!("are positions in {unit}? In {unit} they would close"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is said of a minute in which both shoulders of the five-bar go to and fro so far.
    fn said(least: f64, most: f64) -> Vec<String> {
        let found = pkm_robots::find("five_bar").unwrap();
        let model = pkm_dyn::urdf::parse(found.toml, found.urdf, [found.toml_name, found.urdf_name]).unwrap().robot.model;
        let mut recording = Recording { name: "A".to_string(), ..Recording::default() };
        for joint in ["shoulder_left", "shoulder_right"] {
            let q = (0..100).map(|i| least + (most - least) * f64::from(i) / 99.0).chain([f64::NAN]).collect();
            recording.signals.insert(format!("q.{joint}"), q);
        }
        other_positions(&model, &recording).iter().map(ToString::to_string).collect()
    }

    #[test]
    fn degrees_are_told_by_loops_that_close_in_no_other_unit() {
        let found = pkm_robots::find("five_bar").unwrap();
        let model = pkm_dyn::urdf::parse(found.toml, found.urdf, [found.toml_name, found.urdf_name]).unwrap().robot.model;
        let pose: [f64; 2] = [0.3, -0.2];
        assert_eq!(unit_that_closes(&model, &pose), None);
        let unit = unit_that_closes(&model, &pose.map(f64::to_degrees));
        assert_eq!(unit, Some("degrees"));
        assert!(open_question("five_bar", unit).contains("in degrees") && open_question("five_bar", None).contains("\"five_bar\""));
        // Thousands of radians are nothing.
        assert_eq!(unit_that_closes(&model, &pose.map(|q| 1e4 * q)), None);
    }

    #[test]
    fn degrees_are_told_by_the_limits() {
        // Limits are -0.6 to 0.6 rad, which is 34.4 degrees to either side.
        let told = said(-30.0, 25.0);
        assert_eq!(told[0], "A: q.shoulder_left goes from -30.000 to 25.000 rad, limits are -0.600 to 0.600 rad: is it in degrees?");
        assert_eq!(told.len(), 2);
        // Within the limits, a little beyond them, and farther than degrees would explain.
        for (least, most) in [(-0.5, 0.5), (-1.5, 2.0), (-300.0, 300.0)] {
            assert_eq!(said(least, most), Vec::<String>::new(), "{least} {most}");
        }
        // A joint that stands says nothing.
        assert!(said(30.0, 30.0).is_empty());
    }
}
