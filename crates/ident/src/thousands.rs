//! Efforts recorded a thousand times too small or too large, in kN or mN·m: with the factor the model explains them, as recorded it does not.
//!
//! What a drive's own offset and friction could explain is taken out of both sides first. Whatever else the model lacks, efforts of which it is
//! a thousand times as much do not follow it. Efforts that are the larger side might: a rotor inertia that the robot's files leave out can be
//! hundreds of times what it moves. There the weight must agree as well, or what is left without the drive's own acceleration.

use core::fmt;

use nalgebra::{DMatrix, DVector};
use pkm_dyn::Model;
use pkm_dyn::math;

/// Correlation of effort and model from which on one follows the other.
const FOLLOWS: f64 = 0.8;

/// Correlation from which on a drive is named beside one that follows.
const LEANS: f64 = 0.5;

/// The best factor must be a thousand within this factor: a payload, a torque constant or a wrong mass may be in it besides.
const WITHIN: f64 = 2.0;

/// Share of an effort that must be left, or be weight, to say anything.
const LEFT: f64 = 0.3;

/// Rows below which a correlation says nothing.
const LEAST: usize = 50;

/// The wrong units there are: what an effort must be multiplied by, and what stands before its unit.
const WAYS: [(f64, &str); 2] = [(1e3, "k"), (1e-3, "m")];

/// How an effort goes along with the model.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Fit {
    /// What the effort must be multiplied by to be the model's.
    factor: f64,
    correlation: f64,
    /// Share of the effort about its mean that was compared.
    left: f64,
}

/// One drive's effort beside the model's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Without offset and friction.
    plain: Fit,
    /// Without acceleration either.
    apart: Option<Fit>,
    /// What the mean effort must be multiplied by to be the model's, where the model has one to speak of.
    weight: Option<f64>,
}

/// Drives of a recording whose efforts are in another unit than the model's.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct OtherUnits {
    /// Its name.
    pub recording: String,
    /// The driven joints.
    pub joints: Vec<String>,
    /// What their efforts must be multiplied by.
    pub factor: f64,
    /// Smallest and largest factor with which one of them is the model's best.
    pub best: [f64; 2],
    /// The largest correlation with the model.
    pub correlation: f64,
    /// The units that the efforts are in.
    pub recorded_in: Vec<String>,
    /// The units that they should be in.
    pub units: Vec<&'static str>,
}

impl fmt::Display for OtherUnits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [least, most] = self.best;
        write!(
            f,
            "{}: {} {} the model only when multiplied by about {factor} (best by {}, correlation {:.2}): recorded in {}? Multiply by \
             {factor} to have {}, or look whether the masses of the robot are in kg",
            self.recording,
            listed(&self.joints.iter().map(|j| format!("tau.{j}")).collect::<Vec<_>>()),
            if self.joints.len() == 1 { "follows" } else { "follow" },
            if self.joints.len() == 1 { short(least) } else { format!("{} to {}", short(least), short(most)) },
            self.correlation,
            listed(&self.recorded_in),
            self.units.join(" and "),
            factor = self.factor,
        )
    }
}

/// What the drives of a recording say, in the order of the actuators and none where nothing was [`seen`]: nothing, or one entry per unit.
#[must_use]
pub fn other_units(model: &Model, recording: &str, drives: &[Option<Seen>]) -> Vec<OtherUnits> {
    WAYS.iter().filter_map(|way| off_by(model, recording, drives, *way)).collect()
}

/// The drives that are off by a factor.
fn off_by(model: &Model, recording: &str, drives: &[Option<Seen>], (factor, prefix): (f64, &str)) -> Option<OtherUnits> {
    if !drives.iter().flatten().any(|d| d.is_by(factor)) {
        return None;
    }
    let leans = |d: &Seen| d.is_by(factor) || d.plain.correlation > LEANS && is_about(d.plain.factor, factor);
    let all: Vec<(usize, Fit)> = drives.iter().enumerate().filter_map(|(k, d)| d.filter(leans).map(|d| (k, d.plain))).collect();
    let joints = || all.iter().map(|(k, _)| &model.joints[model.actuators[*k]]);
    let mut units: Vec<&str> = joints().map(|j| j.kind.unit_effort()).collect();
    units.sort_unstable();
    units.dedup();
    Some(OtherUnits {
        recording: recording.to_string(),
        joints: joints().map(|j| j.name.clone()).collect(),
        factor,
        best: [all.iter().map(|(_, f)| f.factor).fold(f64::INFINITY, f64::min), all.iter().map(|(_, f)| f.factor).fold(0.0, f64::max)],
        correlation: all.iter().map(|(_, f)| f.correlation).fold(0.0, f64::max),
        recorded_in: units.iter().map(|u| format!("{prefix}{u}")).collect(),
        units,
    })
}

/// Three digits of a factor.
fn short(x: f64) -> String {
    if x >= 1.0 { format!("{x:.0}") } else { format!("{x:.5}") }
}

fn listed(names: &[String]) -> String {
    match names {
        [all @ .., last] if !all.is_empty() => format!("{} and {last}", all.join(", ")),
        _ => names.concat(),
    }
}

fn is_about(factor: f64, wanted: f64) -> bool {
    (1.0 / WITHIN..WITHIN).contains(&(factor / wanted))
}

impl Fit {
    fn is_by(&self, factor: f64) -> bool {
        self.correlation > FOLLOWS && is_about(self.factor, factor)
    }
}

impl Seen {
    /// Correlation with the model, 0 where the efforts are of another size.
    pub(crate) fn correlation_as_it_is(&self) -> f64 {
        if is_about(self.plain.factor, 1.0) { self.plain.correlation } else { 0.0 }
    }

    fn is_by(&self, factor: f64) -> bool {
        let weighs = self.weight.is_some_and(|w| is_about(w, factor));
        let is_plain = self.plain.is_by(factor) && (factor > 1.0 || weighs);
        is_plain || self.apart.is_some_and(|f| f.is_by(factor) && f.left > LEFT)
    }
}

/// A drive's effort beside the model's, at the same samples and behind the same filter `[N | N·m]`; `own` are series of the drive itself, of any
/// scale: ones, its velocity, the direction of that, its acceleration. None where nothing is left to compare.
#[must_use]
pub fn seen(effort: &[f64], model: &[f64], own: &[Vec<f64>; 4]) -> Option<Seen> {
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len().max(1) as f64;
    let rms = math::sqrt(mean(&model.iter().map(|x| x * x).collect::<Vec<_>>()));
    let weight = (mean(model).abs() > LEFT * rms).then(|| mean(model) / mean(effort));
    Some(Seen { plain: fit(effort, model, &own[..3])?, apart: fit(effort, model, own), weight })
}

/// Effort against model where neither is explained by `own`; none where nothing is left of either.
fn fit(effort: &[f64], model: &[f64], own: &[Vec<f64>]) -> Option<Fit> {
    let n = effort.len();
    if n < LEAST {
        return None;
    }
    // Columns of one length, those of a drive that never moves left out.
    let columns: Vec<DVector<f64>> = own.iter().filter_map(|c| DVector::from_column_slice(c).try_normalize(0.0)).collect();
    let basis = DMatrix::from_columns(&columns).qr().q();
    let [(all, tau), (_, given)] = [effort, model].map(|x| {
        let x = DVector::from_column_slice(x);
        (x.add_scalar(-x.mean()).norm(), &x - &basis * basis.tr_mul(&x))
    });
    let is_rounding = |x: &DVector<f64>, of: &[f64]| x.amax() <= 1e-9 * of.iter().fold(0.0_f64, |top, x| top.max(x.abs()));
    if is_rounding(&tau, effort) || is_rounding(&given, model) {
        return None;
    }
    let together = tau.dot(&given);
    Some(Fit { factor: together / tau.norm_squared(), correlation: together / (tau.norm() * given.norm()), left: tau.norm() / all })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A drive that lifts and accelerates: position, velocity and acceleration of a sum of sines, and what its model says, at `n` samples.
    fn lifting(n: usize) -> [Vec<f64>; 4] {
        let at = |i: usize| {
            let t = 0.01 * i as f64;
            [(0.3, 1.9), (0.2, 4.3)].iter().fold([0.0; 3], |[q, v, a], (size, w)| {
                let (s, c) = (math::sin(w * t), math::cos(w * t));
                [q + size * s, v + size * w * c, a - size * w * w * s]
            })
        };
        let all: Vec<[f64; 3]> = (0..n).map(at).collect();
        let series = |k: usize| all.iter().map(|x| x[k]).collect::<Vec<f64>>();
        let model = all.iter().map(|[q, _, a]| 0.4 * a + 20.0 * math::cos(*q)).collect();
        [series(0), series(1), series(2), model]
    }

    fn own_of(v: &[f64], a: &[f64]) -> [Vec<f64>; 4] {
        [vec![1.0; v.len()], v.to_vec(), v.iter().map(|v| math::sign(*v)).collect(), a.to_vec()]
    }

    #[test]
    fn the_factor_comes_out_whatever_offset_and_friction_are_missing() {
        let [_, v, a, model] = lifting(800);
        for factor in [1e3, 1e-3] {
            let effort: Vec<f64> = model.iter().zip(&v).map(|(m, v)| (m + 7.0 + 3.0 * v + 9.0 * math::sign(*v)) / factor).collect();
            let found = seen(&effort, &model, &own_of(&v, &a)).expect("something is left");
            for f in [Some(found.plain), found.apart].into_iter().flatten() {
                assert!((f.factor / factor - 1.0).abs() < 1e-9 && (f.correlation - 1.0).abs() < 1e-9, "{found:?}");
            }
            assert!(found.is_by(factor) && !found.is_by(1.0 / factor), "{found:?}");
        }
    }

    #[test]
    fn a_rotor_a_thousand_times_what_it_moves_is_no_unit() {
        let [_, v, a, lifted] = lifting(800);
        let level: Vec<f64> = a.iter().zip(&v).map(|(a, v)| 0.4 * a + 0.02 * v * v).collect();
        // On a drive that carries nothing, and on one that lifts: there the weight is as it should be.
        for model in [level, lifted] {
            let effort: Vec<f64> = a.iter().zip(&model).map(|(a, m)| m + 400.0 * a).collect();
            let found = seen(&effort, &model, &own_of(&v, &a)).expect("something is left");
            assert!(!found.is_by(1e-3) && !found.is_by(1e3), "{found:?}");
        }
    }

    #[test]
    fn nothing_is_said_of_a_drive_without_a_model_or_with_few_rows() {
        let [_, v, a, model] = lifting(800);
        assert_eq!(seen(&model, &vec![0.0; 800], &own_of(&v, &a)), None);
        assert_eq!(seen(&v, &model, &own_of(&v, &a)), None);
        let [_, v, a, model] = lifting(40);
        assert_eq!(seen(&model, &model, &own_of(&v, &a)), None);
    }
}
