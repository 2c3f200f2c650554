//! Efforts with their sign turned, or in each other's columns: so changed the robot as its files have it explains nearly all of them, as
//! recorded far less.
//!
//! Nothing is taken out or fitted first. Where friction or a load is missing as well, what is left is more than is asked for here, and nothing
//! is said: a spring that turns the effort round would else be called a sign.

use core::fmt;

use pkm_dyn::Model;

/// Share of an effort's square that the model may leave of it as it should have been recorded.
const NEARLY_ALL: f64 = 0.1;

/// Share that the model must leave of it as it was recorded, or how many times as much as it leaves of it as it should have been: drives that
/// carry each other's load feel much the same.
const MUCH: f64 = 0.3;
const TIMES: f64 = 20.0;

/// Rows below which nothing is said.
const LEAST: usize = 50;

/// A drive's effort and the model's at the samples of its recording, behind the same filter `[N | N·m]`; NaN where it does not count.
#[derive(Debug, Clone, Copy)]
pub struct Pair<'s> {
    /// As recorded.
    pub effort: &'s [f64],
    /// Of the robot as its files have it.
    pub model: &'s [f64],
}

/// Columns of a recording that hold something else than they should.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Mixed {
    /// Its name.
    pub recording: String,
    /// The driven joint, or the two whose efforts stand in each other's columns.
    pub joints: Vec<String>,
    /// Largest share of an effort's square that the model leaves as recorded.
    pub as_recorded: f64,
    /// The same with the sign turned, or the columns exchanged.
    pub mended: f64,
}

impl fmt::Display for Mixed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [left, mended] = [self.as_recorded, self.mended].map(|x| format!("{:.0} %", 100.0 * x));
        match self.joints.as_slice() {
            [a, b] => write!(
                f,
                "{}: tau.{a} follows the model of {b}, and tau.{b} that of {a} ({mended} of their squares is left then, {left} as recorded): are \
                 the columns exchanged?",
                self.recording
            ),
            joints => write!(
                f,
                "{}: tau.{} follows the model with its sign turned ({mended} of its square is left then, {left} as recorded): tau must be what the \
                 drive does to the robot, positive along the joint's axis",
                self.recording,
                joints.concat()
            ),
        }
    }
}

/// What the drives of a recording say, in the order of the actuators.
#[must_use]
pub fn mixed(model: &Model, recording: &str, drives: &[Pair<'_>]) -> Vec<Mixed> {
    let joint = |k: usize| model.joints[model.actuators[k]].name.clone();
    let kind = |k: usize| model.joints[model.actuators[k]].kind;
    let mut out = Vec::new();
    for (k, own) in drives.iter().enumerate() {
        let as_recorded = left(own.effort, own.model, 1.0);
        let turned = left(own.effort, own.model, -1.0);
        if is_mended(as_recorded, turned) {
            out.push(Mixed { recording: recording.to_string(), joints: vec![joint(k)], as_recorded, mended: turned });
        }
        for (l, other) in drives.iter().enumerate().skip(k + 1).filter(|(l, _)| kind(*l) == kind(k)) {
            let here = [as_recorded, left(other.effort, other.model, 1.0)];
            let there = [left(own.effort, other.model, 1.0), left(other.effort, own.model, 1.0)];
            if here.iter().zip(&there).all(|(here, there)| is_mended(*here, *there)) {
                let [as_recorded, mended] = [here, there].map(|[a, b]| a.max(b));
                out.push(Mixed { recording: recording.to_string(), joints: vec![joint(k), joint(l)], as_recorded, mended });
            }
        }
    }
    out
}

/// Whether a change explains what it explains so much better that it is no chance.
fn is_mended(as_recorded: f64, changed: f64) -> bool {
    changed < NEARLY_ALL && (as_recorded > MUCH || as_recorded > NEARLY_ALL && as_recorded > TIMES * changed)
}

/// Share of an effort's square that a model times `sign` leaves; infinite where there is nothing to compare.
fn left(effort: &[f64], model: &[f64], sign: f64) -> f64 {
    let both = effort.iter().zip(model).filter(|(e, m)| e.is_finite() && m.is_finite());
    let (count, all, rest) =
        both.fold((0, 0.0, 0.0), |(count, all, rest), (e, m)| (count + 1, all + e * e, rest + (e - sign * m) * (e - sign * m)));
    if count < LEAST || all <= 0.0 { f64::INFINITY } else { rest / all }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_dyn::math;

    #[test]
    fn a_turned_sign_shows_and_a_spring_that_nearly_turns_it_does_not() {
        let wave = |size: f64, w: f64| (0..400).map(|i| size * math::sin(0.05 * w * f64::from(i))).collect::<Vec<f64>>();
        let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + b).collect::<Vec<f64>>();
        let model = sum(&wave(10.0, 1.0), &wave(6.0, 2.7));
        assert!(left(&model.iter().map(|x| -x).collect::<Vec<_>>(), &model, -1.0) < 1e-12);
        // An inertia asks for m·w² times the position; a spring that turns the slow part round strengthens it in proportion, not the fast one.
        let with_spring = sum(&wave(-10.0, 1.0), &wave(6.0 - 20.0 / (2.7 * 2.7), 2.7));
        assert!(left(&with_spring, &model, -1.0) > NEARLY_ALL);
        assert!(left(&model[..20], &model[..20], 1.0).is_infinite());
    }
}
