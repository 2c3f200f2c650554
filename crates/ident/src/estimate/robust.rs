//! Iteratively reweighted least squares: rows that no parameters explain lose their say.

use crate::error::InputError;
use crate::estimate::least_squares;
use crate::estimate::weighted::scatter;
use crate::factor::Factor;
use crate::observation::{Observation, Rows};

/// Tuning constants at which normal noise costs 5 % of efficiency \[Holland1977\].
const HUBER: f64 = 1.345;
const BISQUARE: f64 = 4.685;

/// Median absolute deviation to standard deviation, for normal noise.
const NORMAL_MAD: f64 = 1.4826;

/// A row further off than this many standard deviations is an outlier: of normal noise one in 16 000.
const OUTLIER: f64 = 4.0;

/// Passes over the rows, at most.
const ITERATIONS: usize = 30;

/// The fit has settled when no row's prediction moves by more than this share of the noise.
const SETTLED: f64 = 1e-3;

/// How much a residual counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Loss {
    /// Beyond the tuning constant the weight falls as one over the residual.
    Huber,
    /// Beyond the tuning constant the weight is zero.
    Bisquare,
}

impl Loss {
    /// Weight of a residual of `u` standard deviations.
    #[must_use]
    pub fn weight(self, u: f64) -> f64 {
        match self {
            Self::Huber => (HUBER / u.abs().max(f64::MIN_POSITIVE)).min(1.0),
            Self::Bisquare => {
                let inside = 1.0 - (u / BISQUARE) * (u / BISQUARE);
                if inside > 0.0 { inside * inside } else { 0.0 }
            }
        }
    }
}

impl Loss {
    /// Derivative of `ψ(u) = u·weight(u)`: how much a residual of `u` standard deviations still tells of the parameters.
    #[must_use]
    pub fn bend(self, u: f64) -> f64 {
        match self {
            Self::Huber => f64::from(u8::from(u.abs() < HUBER)),
            Self::Bisquare => {
                let square = (u / BISQUARE) * (u / BISQUARE);
                if square < 1.0 { (1.0 - square) * (1.0 - 5.0 * square) } else { 0.0 }
            }
        }
    }

    /// What the reweighting leaves of residuals `[drive][recording][row]`, `σ·ψ(e/σ)`, and the mean bend of every drive: the estimate solves
    /// `Σ Wᵀψ/σ = 0`. Rows that are not used (zero) stay zero and do not count. The bend is that of a fit of which `freedom` is the share
    /// of degrees of freedom left, by the correction of first order of \[Huber1981, section 7.6\].
    #[must_use]
    pub fn cut(self, series: &[Vec<Vec<f64>>], noise: &[f64], freedom: f64) -> (Vec<Vec<Vec<f64>>>, Vec<f64>) {
        let each = |(drive, sigma): (&Vec<Vec<f64>>, &f64)| {
            let used = || drive.iter().flatten().filter(|e| e.abs() > 0.0);
            let mean = |of: &dyn Fn(f64) -> f64| used().map(|e| of(self.bend(e / sigma))).sum::<f64>() / used().count().max(1) as f64;
            let (bend, square) = (mean(&|b| b), mean(&|b| b * b));
            let variance = (square - bend * bend) / (bend * bend).max(f64::MIN_POSITIVE);
            let bend = bend / (1.0 + (1.0 - freedom) * variance);
            // A row without weight is a row all the same.
            let cut = |e: &f64| if e.abs() > 0.0 { (e * self.weight(e / sigma)).abs().max(f64::MIN_POSITIVE).copysign(*e) } else { 0.0 };
            (drive.iter().map(|s| s.iter().map(cut).collect()).collect(), bend)
        };
        series.iter().zip(noise).map(each).unzip()
    }
}

/// Where the iteration ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Robust {
    /// All parameters; eliminated ones are zero.
    pub theta: Vec<f64>,
    /// Standard deviation of each drive's rows by their median absolute deviation `[N | N·m]`.
    pub noise: Vec<f64>,
    /// Share of rows further than four standard deviations off.
    pub outliers: f64,
    /// Passes over the rows.
    pub iterations: usize,
    /// Whether the fit has settled.
    pub is_settled: bool,
}

/// Residuals of all active rows, by drive.
///
/// # Errors
/// Loops that do not close along a recording.
pub fn residuals(observation: &Observation<'_>, rows: Rows, theta: &[f64]) -> Result<Vec<Vec<f64>>, InputError> {
    let mut out = vec![Vec::new(); observation.robot().model.n_act()];
    observation.each(
        rows,
        &mut |block| {
            for (k, out) in out.iter_mut().enumerate() {
                for i in (0..block.len()).filter(|&i| block.is_active(k, i)) {
                    out.push(block.target(k, i) - dot(block.row(k, i), theta));
                }
            }
        },
        &mut |_| {},
    )?;
    Ok(out)
}

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Standard deviation by the median absolute deviation, which half of the rows cannot spoil.
#[must_use]
pub fn robust_deviation(residuals: &[f64]) -> f64 {
    let mut size: Vec<f64> = residuals.iter().map(|e| e.abs()).collect();
    size.sort_by(f64::total_cmp);
    NORMAL_MAD * size.get(size.len() / 2).copied().unwrap_or(0.0)
}

/// Share of residuals further than four robust standard deviations off, over all drives.
#[must_use]
pub fn outlier_share(residuals: &[Vec<f64>]) -> f64 {
    let total: usize = residuals.iter().map(Vec::len).sum();
    let far = |e: &Vec<f64>| {
        let limit = OUTLIER * robust_deviation(e);
        e.iter().filter(|e| e.abs() > limit).count()
    };
    residuals.iter().map(far).sum::<usize>() as f64 / total.max(1) as f64
}

/// Reweights until the fit has settled, from `start`; drives with `usable[k]` false do not take part, the effort of the parameters `fixed`
/// is given.
///
/// # Errors
/// Loops that do not close along a recording.
pub fn reweighted(
    observation: &Observation<'_>,
    kept: &[usize],
    [start, fixed]: [&[f64]; 2],
    usable: &[bool],
    loss: Loss,
) -> Result<Robust, InputError> {
    let p = observation.columns().len();
    let mut out = Robust { theta: start.to_vec(), noise: Vec::new(), outliers: 0.0, iterations: 0, is_settled: false };
    while out.iterations < ITERATIONS && !out.is_settled {
        let e = residuals(observation, Rows::Fitted, &out.theta)?;
        out.noise = e.iter().map(|e| robust_deviation(e).max(f64::MIN_POSITIVE)).collect();
        out.outliers = outlier_share(&e);
        let mut factor = Factor::new(p);
        let mut at = vec![0; e.len()];
        let mut scaled = vec![0.0; p];
        observation.each(
            Rows::Fitted,
            &mut |block| {
                for k in 0..e.len() {
                    for i in (0..block.len()).filter(|&i| block.is_active(k, i)) {
                        let u = e[k][at[k]] / out.noise[k];
                        at[k] += 1;
                        let weight = if usable[k] { loss.weight(u).sqrt() / out.noise[k] } else { 0.0 };
                        scaled.iter_mut().zip(block.row(k, i)).for_each(|(s, w)| *s = weight * w);
                        factor.push(&scaled, weight * (block.target(k, i) - dot(block.row(k, i), fixed)), 0.0);
                    }
                }
            },
            &mut |_| {},
        )?;
        let triangle = factor.triangle();
        let mut next = scatter(&least_squares::ordinary(&triangle, kept), kept, p);
        next.iter_mut().zip(fixed).for_each(|(x, f)| *x += f);
        let step: Vec<f64> = next.iter().zip(&out.theta).map(|(a, b)| a - b).collect();
        // rms change of the weighted predictions, in standard deviations.
        let change = (0..p).map(|i| (i..p).map(|c| triangle[(i, c)] * step[c]).sum::<f64>()).map(|x| x * x).sum::<f64>();
        out.is_settled = (change / factor.count().max(1) as f64).sqrt() < SETTLED;
        out.theta = next;
        out.iterations += 1;
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_one_at_zero_and_fall_beyond_the_tuning_constant() {
        assert!((Loss::Huber.weight(0.5) - 1.0).abs() < 1e-15 && (Loss::Huber.weight(-2.69) - 0.5).abs() < 1e-12);
        assert!((Loss::Bisquare.weight(0.0) - 1.0).abs() < 1e-15 && Loss::Bisquare.weight(5.0).abs() < 1e-15);
    }

    #[test]
    fn bends_are_the_derivatives_of_what_is_left() {
        for loss in [Loss::Huber, Loss::Bisquare] {
            for u in [-6.0, -4.0, -1.2, 0.0, 0.7, 2.0, 3.3, 4.6, 5.0] {
                let psi = |u: f64| u * loss.weight(u);
                let difference = (psi(u + 1e-6) - psi(u - 1e-6)) / 2e-6;
                assert!((loss.bend(u) - difference).abs() < 1e-6, "{loss:?} {u}: {} {difference}", loss.bend(u));
            }
        }
        let (cut, bend) = Loss::Huber.cut(&[vec![vec![1.0, 0.0, -4.0, 20.0]]], &[2.0], 1.0);
        assert!((bend[0] - 1.0 / 3.0).abs() < 1e-15);
        assert!((cut[0][0][2] + 2.0 * HUBER).abs() < 1e-12 && (cut[0][0][3] - 2.0 * HUBER).abs() < 1e-12 && cut[0][0][1].abs() <= 0.0);
    }

    #[test]
    fn normal_noise_costs_five_percent_of_efficiency() {
        // E ψ² / (E ψ')² over the normal distribution is what the tuning constants are made for \[Holland1977\]: 1/0.95.
        for loss in [Loss::Huber, Loss::Bisquare] {
            let (mut square, mut bend) = (0.0, 0.0);
            for i in -80_000..=80_000 {
                let u = 1e-4 * f64::from(i);
                let density = 1e-4 * pkm_dyn::math::exp(-0.5 * u * u) / (2.0 * core::f64::consts::PI).sqrt();
                square += density * (u * loss.weight(u)) * (u * loss.weight(u));
                bend += density * loss.bend(u);
            }
            assert!((square / (bend * bend) * 0.95 - 1.0).abs() < 1e-3, "{loss:?}: {}", square / (bend * bend));
        }
    }

    #[test]
    fn the_robust_deviation_ignores_a_minority() {
        let mut e: Vec<f64> = (0..1000).map(|i| f64::from(i % 201) / 100.0 - 1.0).collect();
        let clean = robust_deviation(&e);
        e.extend([1e6; 100]);
        assert!((robust_deviation(&e) / clean - 1.0).abs() < 0.12);
        assert!((outlier_share(&[e]) - 100.0 / 1100.0).abs() < 1e-12);
    }
}
