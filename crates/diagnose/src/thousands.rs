//! Efforts recorded a thousand times too small or too large, in kN or mN·m: with the factor the model explains them, as recorded it does not.
//!
//! What a drive's own offset and friction could explain is taken out of both sides first. Whatever else the model lacks, an effort of
//! which it is one part in a thousand cannot follow it; but where efforts are the larger side, a rotor inertia that the robot's files leave out
//! can be hundreds of times what it moves, so there the drive's own acceleration is taken out as well, and something must be left.

use nalgebra::{DMatrix, DVector};
use pkm_dyn::Model;
use pkm_dyn::effects::Robot;
use pkm_dyn::math;
use pkm_ident::filter::LowPass;

use crate::motion::{Motion, softness_widths};
use crate::sharing;

/// Correlation of effort and model from which on one follows the other.
const FOLLOWS: f64 = 0.9;

/// The best factor must be a thousand within this factor: a payload, a torque constant or a wrong mass may be in it besides.
const WITHIN: f64 = 2.0;

/// Share of a large effort that its drive's own offset, friction and acceleration must leave to be compared with the model.
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

/// Reasons against recordings whose efforts are in other units: one per motion and unit.
pub(crate) fn reasons(robot: &Robot, motions: &[Motion]) -> Vec<String> {
    motions.iter().flat_map(|m| WAYS.iter().filter_map(|&(factor, prefix)| reason(&robot.model, m, (factor, prefix)))).collect()
}

fn reason(model: &Model, motion: &Motion, (factor, prefix): (f64, &str)) -> Option<String> {
    let efforts = sharing::efforts_that_move(motion);
    let widths = softness_widths(model, motion);
    let mut all: Vec<(usize, Fit)> = Vec::new();
    for (k, [effort, given]) in efforts.iter().enumerate() {
        let own = own(motion, k, widths[0][model.actuators[k]], factor < 1.0);
        let fit = fit(&sampled(motion, effort), &sampled(motion, given), &own);
        all.extend(fit.filter(|f| f.is_by(factor)).map(|f| (k, f)));
    }
    if all.is_empty() {
        return None;
    }
    let joints = || all.iter().map(|(k, _)| &model.joints[model.actuators[*k]]);
    let mut units: Vec<&str> = joints().map(|j| j.kind.unit_effort()).collect();
    units.sort_unstable();
    units.dedup();
    let least = all.iter().map(|(_, f)| f.factor).fold(f64::INFINITY, f64::min);
    let most = all.iter().map(|(_, f)| f.factor).fold(0.0, f64::max);
    Some(format!(
        "{}: {} {} the model only when multiplied by about {factor} (best by {}, correlation {:.2}): recorded in {}? Multiply by {factor} to \
         have {}, or look whether the masses of the robot are in kg",
        motion.segment.name,
        listed(&joints().map(|j| format!("tau.{}", j.name)).collect::<Vec<_>>()),
        if all.len() == 1 { "follows" } else { "follow" },
        if all.len() == 1 { short(least) } else { format!("{} to {}", short(least), short(most)) },
        all.iter().map(|(_, f)| f.correlation).fold(1.0, f64::min),
        listed(&units.iter().map(|u| format!("{prefix}{u}")).collect::<Vec<_>>()),
        units.join(" and "),
    ))
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

impl Fit {
    fn is_by(&self, factor: f64) -> bool {
        let off = self.factor / factor;
        let is_left = factor > 1.0 || self.left > LEFT;
        self.correlation > FOLLOWS && (1.0 / WITHIN..WITHIN).contains(&off) && is_left
    }
}

/// What a drive's own offset, friction and, if asked for, inertia do to its effort.
fn own(motion: &Motion, drive: usize, width: f64, with_acceleration: bool) -> Vec<Vec<f64>> {
    let s = &motion.segment;
    let mut out = vec![vec![1.0; s.valid.len()], s.v[drive].clone(), Motion::direction(&s.v[drive], width)];
    if with_acceleration {
        out.push(s.a[drive].clone());
    }
    out.iter().map(|x| sampled(motion, x)).collect()
}

/// A series behind the band's filter at samples that may be used, no more of them than the band needs.
fn sampled(motion: &Motion, x: &[f64]) -> Vec<f64> {
    let s = &motion.segment;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a ratio of two positive rates")]
    let every = ((1.0 / (s.dt * 5.0 * s.band)).floor() as usize).max(1);
    let smooth = LowPass::new(s.band, s.dt).apply(x);
    smooth.into_iter().zip(&s.valid).step_by(every).filter_map(|(x, is_valid)| is_valid.then_some(x)).collect()
}

/// Effort against model where neither is explained by `own`; none where nothing is left of either.
fn fit(effort: &[f64], model: &[f64], own: &[Vec<f64>]) -> Option<Fit> {
    let n = effort.len();
    if n < LEAST {
        return None;
    }
    let about_mean = |x: &[f64]| {
        let mean = x.iter().sum::<f64>() / n as f64;
        math::sqrt(x.iter().map(|x| (x - mean) * (x - mean)).sum())
    };
    // Columns of one length, those of a drive that never moves left out.
    let lengths: Vec<f64> = own.iter().map(|c| math::sqrt(c.iter().map(|x| x * x).sum())).collect();
    let columns: Vec<DVector<f64>> =
        own.iter().zip(&lengths).filter(|(_, l)| **l > 0.0).map(|(c, l)| DVector::from_column_slice(c) / *l).collect();
    let basis = DMatrix::from_columns(&columns).qr().q();
    let rest = |x: &[f64]| {
        let x = DVector::from_column_slice(x);
        &x - &basis * basis.tr_mul(&x)
    };
    let (all, [tau, given]) = (about_mean(effort), [rest(effort), rest(model)]);
    let rounding =
        |x: &DVector<f64>, of: &[f64]| x.norm() <= 1e-9 * of.iter().fold(0.0_f64, |top, x| top.max(x.abs())) * math::sqrt(n as f64);
    if rounding(&tau, effort) || rounding(&given, model) {
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

    fn own_of(v: &[f64], a: Option<&[f64]>) -> Vec<Vec<f64>> {
        let mut out = vec![vec![1.0; v.len()], v.to_vec(), v.iter().map(|v| math::sign(*v)).collect()];
        out.extend(a.map(<[f64]>::to_vec));
        out
    }

    #[test]
    fn the_factor_comes_out_whatever_offset_and_friction_are_missing() {
        let [_, v, a, model] = lifting(800);
        for (factor, with) in [(1e3, None), (1e-3, Some(a.as_slice()))] {
            let effort: Vec<f64> = model.iter().zip(&v).map(|(m, v)| (m + 7.0 + 3.0 * v + 9.0 * math::sign(*v)) / factor).collect();
            let found = fit(&effort, &model, &own_of(&v, with)).expect("something is left");
            assert!((found.factor / factor - 1.0).abs() < 1e-9 && (found.correlation - 1.0).abs() < 1e-9, "{found:?}");
            assert!(found.is_by(factor) && !found.is_by(1.0 / factor), "{found:?}");
        }
    }

    #[test]
    fn a_rotor_a_thousand_times_what_it_moves_is_no_unit() {
        let [_, v, a, _] = lifting(800);
        let model: Vec<f64> = a.iter().zip(&v).map(|(a, v)| 1e-3 * a + 2e-4 * v * v).collect();
        let effort: Vec<f64> = a.iter().zip(&model).map(|(a, m)| m + a).collect();
        let found = fit(&effort, &model, &own_of(&v, Some(&a))).expect("the coupling is left");
        assert!(!found.is_by(1e-3), "{found:?}");
    }

    #[test]
    fn nothing_is_said_of_a_drive_without_a_model_or_with_few_rows() {
        let [_, v, _, model] = lifting(800);
        assert_eq!(fit(&model, &vec![0.0; 800], &own_of(&v, None)), None);
        assert_eq!(fit(&v, &model, &own_of(&v, None)), None);
        let [_, v, _, model] = lifting(40);
        assert_eq!(fit(&model, &model, &own_of(&v, None)), None);
    }
}
