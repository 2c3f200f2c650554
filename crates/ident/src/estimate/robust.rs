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
    fn the_robust_deviation_ignores_a_minority() {
        let mut e: Vec<f64> = (0..1000).map(|i| f64::from(i % 201) / 100.0 - 1.0).collect();
        let clean = robust_deviation(&e);
        e.extend([1e6; 100]);
        assert!((robust_deviation(&e) / clean - 1.0).abs() < 0.12);
        assert!((outlier_share(&[e]) - 100.0 / 1100.0).abs() < 1e-12);
    }
}
