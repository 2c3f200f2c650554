//! The noise of each drive, and weights from it: newtons of a strong drive and newton metres of a wrist do not count alike.

use crate::estimate::least_squares;
use crate::factor::Factors;

/// Noise is not taken to be smaller than this share of a drive's rms effort: no model and no sensor is better.
const LEAST_NOISE: f64 = 1e-4;

/// Two steps: noise from ordinary least squares in units of each drive's effort, then from the weighted fit.
const STEPS: usize = 2;

/// Standard deviation of each drive's rows about the weighted fit of the columns `kept` `[N | N·m]`; infinite for a drive without rows.
///
/// Rows of drives with `usable[k]` false do not take part.
#[must_use]
pub fn drive_noise(factors: &Factors, kept: &[usize], usable: &[bool]) -> Vec<f64> {
    let drives: Vec<_> = (0..factors.n_drives()).map(|k| factors.drive(k)).collect();
    let rms = |k: usize| (drives[k].effort_square() / drives[k].count().max(1) as f64).sqrt();
    let is_usable = |k: usize| usable[k] && drives[k].count() > 0;
    let mut noise: Vec<f64> = (0..drives.len()).map(|k| if is_usable(k) { rms(k).max(f64::MIN_POSITIVE) } else { f64::INFINITY }).collect();
    let total: usize = (0..drives.len()).filter(|&k| is_usable(k)).map(|k| drives[k].count()).sum();
    for _ in 0..STEPS {
        let theta = weighted_theta(factors, kept, &noise);
        for k in (0..drives.len()).filter(|&k| is_usable(k)) {
            let count = drives[k].count() as f64;
            // Every drive pays for its share of the parameters.
            let freedom = (count - kept.len() as f64 * count / total as f64).max(1.0);
            noise[k] = (drives[k].error_square(&theta) / freedom).sqrt().max(LEAST_NOISE * rms(k)).max(f64::MIN_POSITIVE);
        }
    }
    noise
}

/// Weighted least squares; eliminated parameters are zero.
#[must_use]
pub fn weighted_theta(factors: &Factors, kept: &[usize], noise: &[f64]) -> Vec<f64> {
    let weights: Vec<f64> = noise.iter().map(|s| 1.0 / s).collect();
    let triangle = factors.weighted(&weights).triangle();
    scatter(&least_squares::ordinary(&triangle, kept), kept, factors.n_columns())
}

/// Values of the kept columns among all `n`, zeros elsewhere.
#[must_use]
pub fn scatter(values: &[f64], kept: &[usize], n: usize) -> Vec<f64> {
    let mut out = vec![0.0; n];
    for (x, &j) in values.iter().zip(kept) {
        out[j] = *x;
    }
    out
}
