//! Output error: parameters of a simulation, linear or not, from what it puts out \[Ljung1999, section 7.2\].
//!
//! Where an equation is linear in its parameters and every signal in it is measured, regression is better: it needs no start and has one
//! answer. Output error is for the rest: shapes of friction, input gains of drives whose effort is not recorded, mechanisms of which only
//! one angle is seen. The simulation is the caller's, a closure from parameters to outputs; with a controller inside it this is closed-loop
//! output error. Nelder and Mead's simplex looks for the valley, Levenberg and Marquardt for its bottom.

use faer::Mat;

use crate::minimise::levenberg_marquardt::{self, Squares, levenberg_marquardt};
use crate::minimise::nelder_mead::{self, nelder_mead};
use crate::minimise::{Bounds, Ending};
use crate::note::Note;
use crate::statistics::{Residual, critical_95};

/// Correlation of two estimates from which on the data hardly tell them apart.
const CONFOUNDED: f64 = 0.98;

/// Evaluations of the simplex per parameter, and its tolerance: it only has to find the valley.
const SIMPLEX_EVALUATIONS: usize = 60;
const SIMPLEX_STEP: f64 = 1e-2;

/// Passes of reweighting the channels by what was left of them.
const PASSES: usize = 2;

/// Noise of a channel is not taken to be below this share of its rms: no simulation is better.
const LEAST_NOISE: f64 = 1e-9;

/// A parameter of a simulation that is to be found.
#[derive(Debug, Clone, PartialEq)]
pub struct Unknown {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: &'static str,
    /// Where to start.
    pub start: f64,
    /// Change that matters; the first step of the search.
    pub scale: f64,
    /// Range it must stay in.
    pub bounds: Bounds,
}

/// What was measured in one run.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// Name.
    pub name: String,
    /// `[channel][sample]`, uniform in time; NaN where nothing was measured.
    pub outputs: Vec<Vec<f64>>,
}

/// How to search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Strategy {
    /// Simplex, then least squares from where it ended.
    SimplexThenSquares,
    /// Least squares from the start.
    Squares,
    /// The simplex alone: for simulations with jumps. No intervals come from a Jacobian that is none; they are still computed there.
    Simplex,
}

/// A parameter that was found.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Found {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: &'static str,
    /// Value.
    pub value: f64,
    /// 95 % interval, residuals coloured as they are; infinite when the outputs do not depend on the parameter, or only on it and others
    /// together.
    pub ci95: [f64; 2],
    /// Whether it ended at a bound.
    pub is_at_bound: bool,
}

/// How well one trial is met.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Match {
    /// The trial.
    pub trial: String,
    /// By channel: root mean square error over the rms of the measured signal about its mean.
    pub nrmse: Vec<f64>,
}

/// Two parameters that the outputs hardly tell apart.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Confounded {
    /// The two.
    pub names: [String; 2],
    /// Correlation of their estimates, −1 to 1.
    pub correlation: f64,
}

/// A direction of the parameters along which the outputs change by less than this share of the most they change by (columns at length one)
/// is not shown; differences have some eight digits.
const NOT_SHOWN: f64 = 1e-7;

/// Part of a direction, of length one, that counts.
const PART: f64 = 1e-3;

/// The outcome.
#[derive(Debug, Clone)]
pub struct OutputError {
    /// What is to be said against it.
    pub notes: Vec<Note>,
    /// The parameters.
    pub found: Vec<Found>,
    /// Their covariance; infinite variances of parameters that are not shown, uncorrelated with others.
    pub covariance: Mat<f64>,
    /// Condition number of the derivatives, columns at length one: infinite when a combination of parameters has no say.
    pub condition: f64,
    /// Pairs that are hardly told apart.
    pub confounded: Vec<Confounded>,
    /// Trials that were fitted.
    pub fitted: Vec<Match>,
    /// Trials that were only looked at.
    pub validated: Vec<Match>,
    /// Standard deviation of what is left, by channel.
    pub noise: Vec<f64>,
    /// Correlation of neighbouring residuals, by channel.
    pub lag_one: Vec<f64>,
    /// Simulations of all fitted trials.
    pub evaluations: usize,
    /// How the last search ended.
    pub ending: Ending,
}

/// Outputs of a simulation with parameters `x` in trial number `i` (fitted trials first, then the others): `[channel][sample]`, as long as
/// measured. `None` when it fails.
pub type Simulation<'s> = dyn FnMut(&[f64], usize) -> Option<Vec<Vec<f64>>> + 's;

/// Finds `unknowns` from the trials `fit`, and judges them on `validate`.
///
/// Channels weigh by what is left of them. `None` without trials, without unknowns, or when the simulation fails at every start tried.
pub fn output_error(
    unknowns: &[Unknown],
    fit: &[Trial],
    validate: &[Trial],
    simulate: &mut Simulation<'_>,
    strategy: Strategy,
) -> Option<OutputError> {
    let channels = fit.first()?.outputs.len();
    if unknowns.is_empty() || fit.iter().chain(validate).any(|t| t.outputs.len() != channels) {
        return None;
    }
    let noise: Vec<f64> = (0..channels).map(|c| spread(fit, c)).collect();
    let mut problem = Problem { unknowns, fit, simulate, noise, evaluations: 0 };
    let mut x: Vec<f64> = unknowns.iter().map(|u| u.start).collect();
    let mut ending = Ending::NoStart;
    if strategy != Strategy::Squares {
        (x, ending) = problem.simplex(&x, strategy == Strategy::Simplex);
    }
    let mut squares: Option<Squares> = None;
    for _ in 0..PASSES {
        if let Some(last) = &squares {
            problem.noise = problem.left(&last.residual);
        }
        let found = problem.squares(&x, if strategy == Strategy::Simplex { 0 } else { levenberg_marquardt::Options::default().iterations });
        if found.ending == Ending::NoStart {
            return None;
        }
        if strategy != Strategy::Simplex {
            ending = found.ending;
        }
        x.clone_from(&found.x);
        squares = Some(found);
    }
    let squares = squares.filter(|_| ending != Ending::NoStart)?;
    let residuals = problem.series(&squares.residual);
    Some(problem.report(&squares, &residuals, validate, ending))
}

/// Root mean square of a channel about its mean in every trial.
fn spread(trials: &[Trial], channel: usize) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for t in trials {
        let known: Vec<f64> = t.outputs[channel].iter().copied().filter(|x| x.is_finite()).collect();
        let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
        sum += known.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>();
        count += known.len() as f64;
    }
    (sum / f64::max(count, 1.0)).sqrt().max(f64::MIN_POSITIVE)
}

struct Problem<'p, 's> {
    unknowns: &'p [Unknown],
    fit: &'p [Trial],
    simulate: &'p mut Simulation<'s>,
    noise: Vec<f64>,
    evaluations: usize,
}

impl Problem<'_, '_> {
    /// Residuals in units of the noise: trial by trial, channel by channel; zero where nothing was measured.
    fn residual(&mut self, x: &[f64]) -> Option<Vec<f64>> {
        self.evaluations += 1;
        let mut out = Vec::new();
        for (i, trial) in self.fit.iter().enumerate() {
            let said = (self.simulate)(x, i)?;
            for (c, (measured, said)) in trial.outputs.iter().zip(&said).enumerate() {
                if said.len() != measured.len() {
                    return None;
                }
                out.extend(measured.iter().zip(said).map(|(m, s)| if m.is_finite() { (m - s) / self.noise[c] } else { 0.0 }));
            }
        }
        Some(out)
    }

    fn bounds(&self) -> Vec<Bounds> {
        self.unknowns.iter().map(|u| u.bounds).collect()
    }

    fn scales(&self) -> Vec<f64> {
        self.unknowns.iter().map(|u| u.scale).collect()
    }

    fn simplex(&mut self, start: &[f64], is_last: bool) -> (Vec<f64>, Ending) {
        let (bounds, scales) = (self.bounds(), self.scales());
        let few = nelder_mead::Options { evaluations: SIMPLEX_EVALUATIONS * start.len(), step: SIMPLEX_STEP, cost: 1e-6 };
        let options = if is_last { nelder_mead::Options::default() } else { few };
        let mut cost = |x: &[f64]| self.residual(x).map_or(f64::INFINITY, |e| e.iter().map(|e| e * e).sum());
        let found = nelder_mead(&mut cost, start, &scales, &bounds, &options);
        (found.x, found.ending)
    }

    fn squares(&mut self, start: &[f64], iterations: usize) -> Squares {
        let (bounds, scales) = (self.bounds(), self.scales());
        let options = levenberg_marquardt::Options { iterations, ..levenberg_marquardt::Options::default() };
        levenberg_marquardt(&mut |x| self.residual(x), start, &scales, &bounds, &options)
    }

    /// Residuals of each channel, one series per trial, in units of the output.
    fn series(&self, residual: &[f64]) -> Vec<Vec<Vec<f64>>> {
        let channels = self.noise.len();
        let mut out = vec![Vec::new(); channels];
        let mut from = 0;
        for t in self.fit {
            for (c, out) in out.iter_mut().enumerate() {
                let to = from + t.outputs[c].len();
                out.push(residual[from..to].iter().map(|e| e * self.noise[c]).collect());
                from = to;
            }
        }
        out
    }

    /// Standard deviation that residuals leave of every channel.
    fn left(&self, residual: &[f64]) -> Vec<f64> {
        let series = self.series(residual);
        let of = |c: usize| {
            let count = self.fit.iter().flat_map(|t| &t.outputs[c]).filter(|x| x.is_finite()).count();
            let square: f64 = series[c].iter().flatten().map(|e| e * e).sum();
            (square / count.max(1) as f64).sqrt().max(LEAST_NOISE * spread(self.fit, c))
        };
        (0..series.len()).map(of).collect()
    }

    fn report(&mut self, squares: &Squares, series: &[Vec<Vec<f64>>], validate: &[Trial], ending: Ending) -> OutputError {
        let n = self.unknowns.len();
        let count: usize = series.iter().flatten().map(Vec::len).sum();
        let freedom = 1.0 - n as f64 / count.max(1) as f64;
        let residuals: Vec<Residual> = series.iter().map(|s| Residual::of(s, freedom)).collect();
        let shown = Shown::of(&squares.jacobian);
        let covariance = self.covariance(squares, &residuals, &shown);
        let bandwidth = residuals.iter().map(Residual::bandwidth).fold(0.0, f64::max);
        let critical = critical_95(bandwidth);
        let found = |(k, u): (usize, &Unknown)| {
            let sd = covariance[(k, k)].max(0.0).sqrt();
            let value = squares.x[k];
            let half = if sd.is_finite() { critical * sd } else { f64::INFINITY };
            let near = |bound: f64| (value - bound).abs() <= 1e-9 * u.scale;
            Found {
                name: u.name.clone(),
                unit: u.unit,
                value,
                ci95: [value - half, value + half],
                is_at_bound: near(u.bounds.lower) || near(u.bounds.upper),
            }
        };
        let at = self.fit.len();
        OutputError {
            found: self.unknowns.iter().enumerate().map(found).collect(),
            condition: condition(&squares.jacobian),
            confounded: self.confounded(&shown),
            notes: shown.notes(self.unknowns),
            covariance,
            fitted: self.fit.iter().enumerate().map(|(i, t)| meet(t, (self.simulate)(&squares.x, i))).collect(),
            validated: validate.iter().enumerate().map(|(i, t)| meet(t, (self.simulate)(&squares.x, at + i))).collect(),
            noise: residuals.iter().map(|r| r.deviation).collect(),
            lag_one: residuals.iter().map(|r| r.lag_one).collect(),
            evaluations: self.evaluations,
            ending,
        }
    }

    /// The sandwich `H⁻¹·Σ JᵀΩJ·H⁻¹` with every channel's autocovariance, in the directions that are shown; infinite for the parameters
    /// that have a part in others.
    fn covariance(&self, squares: &Squares, residuals: &[Residual], shown: &Shown) -> Mat<f64> {
        let n = self.unknowns.len();
        let (j, inverse) = (&squares.jacobian, &shown.inverse);
        let mut spread = Mat::<f64>::zeros(n, n);
        let mut from = 0;
        for t in self.fit {
            for (c, r) in residuals.iter().enumerate() {
                let len = t.outputs[c].len();
                for (lag, gamma) in r.autocovariance.iter().enumerate().take(len) {
                    // The Jacobian is in units of the noise at the last pass, the autocovariance in those of the output.
                    let gamma = gamma / (self.noise[c] * self.noise[c]);
                    let (old, new) = (j.subrows(from, len - lag), j.subrows(from + lag, len - lag));
                    let part = new.transpose() * old * faer::Scale(if lag == 0 { 0.5 * gamma } else { gamma });
                    spread += &part + part.transpose();
                }
                from += len;
            }
        }
        let mut sandwich = inverse * spread * inverse;
        crate::statistics::at_least_white(&mut sandwich, inverse);
        let is_hidden = |k: usize| shown.silent.contains(&k) || shown.hidden.iter().any(|d| d[k].abs() > PART);
        Mat::from_fn(n, n, |i, k| match (is_hidden(i) || is_hidden(k), i == k) {
            (false, _) => sandwich[(i, k)],
            (true, true) => f64::INFINITY,
            (true, false) => 0.0,
        })
    }

    /// Which pairs trade places: how alike their columns are, whatever the noise is.
    fn confounded(&self, shown: &Shown) -> Vec<Confounded> {
        let n = self.unknowns.len();
        let pair = |i: usize, k: usize| {
            // Two parameters that have a part in one hidden direction trade places along it.
            let together = shown.hidden.iter().map(|d| d[i] * d[k]).find(|x| x.abs() > PART * PART);
            let both = (shown.inverse[(i, i)] * shown.inverse[(k, k)]).sqrt();
            let correlation = together.map_or_else(|| if both > 0.0 { shown.inverse[(i, k)] / both } else { 0.0 }, f64::signum);
            let names = [i, k].map(|i| self.unknowns[i].name.clone());
            (correlation.abs() > CONFOUNDED).then_some(Confounded { names, correlation })
        };
        (0..n).flat_map(|i| (i + 1..n).map(move |k| (i, k))).filter_map(|(i, k)| pair(i, k)).collect()
    }
}

/// What the derivatives show of the parameters.
struct Shown {
    /// Inverse of `JᵀJ` in the directions that are shown.
    inverse: Mat<f64>,
    /// Parameters on which nothing depends.
    silent: Vec<usize>,
    /// Other directions that are not shown: a part per parameter, of length one at columns of length one.
    hidden: Vec<Vec<f64>>,
}

impl Shown {
    fn of(jacobian: &Mat<f64>) -> Self {
        let n = jacobian.ncols();
        let lengths: Vec<f64> = (0..n).map(|k| jacobian.col(k).norm_l2()).collect();
        let (heard, silent): (Vec<usize>, Vec<usize>) = (0..n).partition(|&k| lengths[k] > 0.0);
        let mut out = Self { inverse: Mat::zeros(n, n), silent, hidden: Vec::new() };
        let unit = Mat::from_fn(jacobian.nrows(), heard.len(), |i, k| jacobian[(i, heard[k])] / lengths[heard[k]]);
        let Ok(svd) = unit.thin_svd() else {
            out.silent = (0..n).collect();
            return out;
        };
        let values: Vec<f64> = svd.S().column_vector().iter().copied().collect();
        let top = values.first().copied().unwrap_or(0.0);
        for (c, s) in values.iter().enumerate() {
            let direction: Vec<f64> = (0..heard.len()).map(|k| svd.V()[(k, c)]).collect();
            if *s <= NOT_SHOWN * top {
                let mut all = vec![0.0; n];
                heard.iter().zip(&direction).for_each(|(&k, x)| all[k] = *x);
                out.hidden.push(all);
                continue;
            }
            for (i, a) in heard.iter().zip(&direction) {
                for (k, b) in heard.iter().zip(&direction) {
                    out.inverse[(*i, *k)] += a * b / (s * s * lengths[*i] * lengths[*k]);
                }
            }
        }
        out
    }

    fn notes(&self, unknowns: &[Unknown]) -> Vec<Note> {
        let silent = self.silent.iter().map(|&k| Note::Silent { parameter: unknowns[k].name.clone() });
        let named = |d: &Vec<f64>| unknowns.iter().zip(d).filter(|(_, x)| x.abs() > PART).map(|(u, _)| u.name.clone()).collect();
        silent.chain(self.hidden.iter().map(|d| Note::OnlyTogether { parameters: named(d) })).collect()
    }
}

fn condition(jacobian: &Mat<f64>) -> f64 {
    let scaled =
        Mat::from_fn(jacobian.nrows(), jacobian.ncols(), |i, k| jacobian[(i, k)] / jacobian.col(k).norm_l2().max(f64::MIN_POSITIVE));
    let Ok(values) = scaled.singular_values() else { return f64::INFINITY };
    match (values.first(), values.last()) {
        (Some(first), Some(last)) if *last > 0.0 => first / last,
        _ => f64::INFINITY,
    }
}

/// Errors of a simulated trial; infinite where the simulation failed.
fn meet(trial: &Trial, said: Option<Vec<Vec<f64>>>) -> Match {
    let nrmse = |c: usize| {
        let Some(said) = said.as_ref().and_then(|s| s.get(c)).filter(|s| s.len() == trial.outputs[c].len()) else { return f64::INFINITY };
        let known: Vec<(f64, f64)> = trial.outputs[c].iter().zip(said).filter(|(m, _)| m.is_finite()).map(|(m, s)| (*m, *s)).collect();
        let count = known.len().max(1) as f64;
        let mean = known.iter().map(|(m, _)| m).sum::<f64>() / count;
        let (error, size) = known.iter().fold((0.0, 0.0), |(e, s), (m, said)| (e + (m - said) * (m - said), s + (m - mean) * (m - mean)));
        (error / f64::max(size, f64::MIN_POSITIVE)).sqrt()
    };
    Match { trial: trial.name.clone(), nrmse: (0..trial.outputs.len()).map(nrmse).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_dyn::math;

    /// A first-order lag `x' = (gain·u − x)/tau` driven by a square wave, exact between its switches.
    fn lag(x: &[f64], half_period: usize) -> Vec<f64> {
        let (gain, decay) = (x[0], math::exp(-0.01 / x[1]));
        let mut y = 0.0;
        (0..400)
            .map(|i| {
                let u = if (i / half_period).is_multiple_of(2) { gain } else { -gain };
                y = u + (y - u) * decay;
                y
            })
            .collect()
    }

    /// Numbers that look random: a linear congruence, summed to be near normal.
    fn noise(n: usize) -> Vec<f64> {
        let mut x = 12345_u64;
        let mut unit = || {
            x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (x >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..n).map(|_| (0..12).map(|_| unit()).sum::<f64>() - 6.0).collect()
    }

    fn unknowns() -> Vec<Unknown> {
        let unknown = |name: &str, unit, start, scale| Unknown {
            name: name.to_string(),
            unit,
            start,
            scale,
            bounds: Bounds { lower: 1e-3, upper: 100.0 },
        };
        vec![unknown("gain", "1", 1.0, 0.3), unknown("time constant", "s", 0.5, 0.2)]
    }

    #[test]
    fn a_lag_comes_back_by_every_strategy() {
        let truth = [2.5, 0.17];
        let periods = [60, 25, 40];
        let trial = |i: usize, sd: f64| Trial {
            name: format!("{i}"),
            outputs: vec![lag(&truth, periods[i]).iter().zip(&noise(1200)[400 * i..]).map(|(y, e)| y + sd * e).collect()],
        };
        let mut simulate = |x: &[f64], i: usize| Some(vec![lag(x, periods[i])]);
        for strategy in [Strategy::SimplexThenSquares, Strategy::Squares, Strategy::Simplex] {
            let out = output_error(&unknowns(), &[trial(0, 0.05), trial(1, 0.05)], &[trial(2, 0.0)], &mut simulate, strategy).unwrap();
            assert_eq!(out.ending, Ending::Settled, "{strategy:?}");
            for (f, want) in out.found.iter().zip(truth) {
                assert!((f.value / want - 1.0).abs() < 0.02 && f.ci95[0] < want && want < f.ci95[1], "{strategy:?} {f:?}");
                assert!(f.ci95[1] - f.ci95[0] < 0.1 * want, "{f:?}");
            }
            assert!(out.validated[0].nrmse[0] < 0.01 && out.fitted[0].nrmse[0] < 0.05 && out.confounded.is_empty(), "{out:?}");
            assert!((out.noise[0] / 0.05 - 1.0).abs() < 0.15, "{:?}", out.noise);
        }
    }

    #[test]
    fn what_cannot_be_told_apart_is_named() {
        // Only the product of the two acts.
        let mut simulate = |x: &[f64], _: usize| Some(vec![lag(&[x[0] * x[1], 0.17], 60)]);
        let measured = lag(&[2.5, 0.17], 60).iter().zip(noise(400)).map(|(y, e)| y + 0.01 * e).collect();
        let trial = Trial { name: "t".to_string(), outputs: vec![measured] };
        let out = output_error(&unknowns(), &[trial], &[], &mut simulate, Strategy::Squares).unwrap();
        assert!((out.found[0].value * out.found[1].value - 2.5).abs() < 0.01);
        let names = ["gain", "time constant"].map(str::to_string);
        // More of one is less of the other, wholly.
        assert_eq!(out.confounded, [Confounded { names: names.clone(), correlation: -1.0 }]);
        assert_eq!(out.notes, [Note::OnlyTogether { parameters: names.to_vec() }]);
        assert!(out.found.iter().all(|f| f.ci95 == [f64::NEG_INFINITY, f64::INFINITY]) && out.condition > 1e7, "{out:?}");
    }

    /// `y = x₀·sin + x₁·(cosine·sin + sine·cos)` over whole periods: columns of square n/2 at that angle.
    fn two_columns(x: &[f64], cosine: f64, n: usize) -> Vec<f64> {
        let sine = (1.0 - cosine * cosine).sqrt();
        let turn = |i: usize| 2.0 * core::f64::consts::PI * 20.0 * i as f64 / n as f64;
        (0..n).map(|i| x[0] * math::sin(turn(i)) + x[1] * (cosine * math::sin(turn(i)) + sine * math::cos(turn(i)))).collect()
    }

    #[test]
    fn correlations_and_spreads_are_those_of_the_angle_between_the_columns() {
        // White noise s on two columns of square n/2 at an angle: variance 2s²/(n·sin²), correlation −cos.
        let (n, s) = (4000, 0.02);
        for (cosine, is_named) in [(0.995, true), (0.9, false), (-0.995, true)] {
            let measured = two_columns(&[1.0, 1.0], cosine, n).iter().zip(noise(n)).map(|(y, e)| y + s * e).collect();
            let trial = Trial { name: "t".to_string(), outputs: vec![measured] };
            let mut simulate = |x: &[f64], _: usize| Some(vec![two_columns(x, cosine, n)]);
            let out = output_error(&unknowns(), &[trial], &[], &mut simulate, Strategy::Squares).unwrap();
            let sd = s * (2.0 / (n as f64 * (1.0 - cosine * cosine))).sqrt();
            for f in &out.found {
                let half = 0.5 * (f.ci95[1] - f.ci95[0]);
                assert!((half / (1.96 * sd) - 1.0).abs() < 0.1, "{cosine}: {half} instead of {}", 1.96 * sd);
                assert!((f.value - 1.0).abs() < 3.3 * sd, "{cosine}: {f:?}");
            }
            assert_eq!(out.confounded.len(), usize::from(is_named), "{cosine}: {:?}", out.confounded);
            assert!(out.confounded.iter().all(|c| (c.correlation + cosine).abs() < 5e-3), "{cosine}: {:?}", out.confounded);
            assert!(out.notes.is_empty());
        }
    }

    #[test]
    fn a_parameter_on_which_nothing_depends_is_named_and_takes_no_other_with_it() {
        let (n, s) = (4000, 0.02);
        let measured: Vec<f64> = two_columns(&[1.0, 1.0], 0.5, n).iter().zip(noise(n)).map(|(y, e)| y + s * e).collect();
        let trial = Trial { name: "t".to_string(), outputs: vec![measured] };
        let idle = Unknown { name: "idle".to_string(), ..unknowns()[0].clone() };
        let asked = [unknowns()[0].clone(), idle, unknowns()[1].clone()];
        let mut simulate = |x: &[f64], _: usize| Some(vec![two_columns(&[x[0], x[2]], 0.5, n)]);
        let out = output_error(&asked, core::slice::from_ref(&trial), &[], &mut simulate, Strategy::Squares).unwrap();
        let mut without = |x: &[f64], _: usize| Some(vec![two_columns(x, 0.5, n)]);
        let alone = output_error(&unknowns(), &[trial], &[], &mut without, Strategy::Squares).unwrap();
        assert_eq!(out.notes, [Note::Silent { parameter: "idle".to_string() }]);
        assert!(out.found[1].ci95[0] == f64::NEG_INFINITY && out.found[1].ci95[1] == f64::INFINITY);
        assert!(out.confounded.is_empty(), "{:?}", out.confounded);
        for (with, without) in [&out.found[0], &out.found[2]].into_iter().zip(&alone.found) {
            for k in 0..2 {
                assert!((with.ci95[k] - without.ci95[k]).abs() < 1e-3 * (without.ci95[1] - without.ci95[0]), "{with:?} {without:?}");
            }
        }
    }

    #[test]
    fn a_simulation_that_always_fails_is_no_answer() {
        let trial = Trial { name: "t".to_string(), outputs: vec![vec![0.0; 50]] };
        assert!(output_error(&unknowns(), &[trial], &[], &mut |_, _| None, Strategy::SimplexThenSquares).is_none());
    }
}
