//! Gains over singular values: piecewise-linear functions that stay below the critical gains found at many orientations.

use alloc::vec;
use alloc::vec::Vec;

use nalgebra::{DMatrix, DVector};

use super::error::DesignError;

/// One orientation: the singular value of a direction there and the largest gain that direction bears.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Singular value of the effective mass `[kg]`.
    pub value: f64,
    /// Critical gain in that direction.
    pub critical: f64,
}

/// Breakpoints (singular value, gain) of a piecewise-linear schedule with `breakpoints` points, at most `share` of every critical gain.
///
/// Gains are those of least squares through `share` times the critical gains, then lowered together until none is exceeded
/// \[McDaid, Figure 8.14\].
///
/// # Errors
/// No samples, samples that are not finite and positive, a share outside 0 … 1, fewer than one breakpoint.
pub fn fit(samples: &[Sample], breakpoints: usize, share: f64) -> Result<Vec<[f64; 2]>, DesignError> {
    let refuse = |what, value, limit| Err(DesignError::Value { what, value, limit });
    if !(share > 0.0 && share <= 1.0) {
        return refuse("share of the critical gain", share, "must be > 0 and <= 1");
    }
    for s in samples {
        for (what, value) in [("singular value", s.value), ("critical gain", s.critical)] {
            if !(value.is_finite() && value > 0.0) {
                return refuse(what, value, "must be finite and > 0");
            }
        }
    }
    let (low, high) = samples.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), s| (l.min(s.value), h.max(s.value)));
    if samples.is_empty() || breakpoints == 0 {
        return refuse("number of samples or breakpoints", 0.0, "must be at least 1");
    }
    // One point, or all values alike: a constant.
    if breakpoints == 1 || high - low <= 1e-9 * high {
        let least = samples.iter().map(|s| s.critical).fold(f64::INFINITY, f64::min);
        return Ok(vec![[low, share * least]]);
    }
    let pieces = (breakpoints - 1) as f64;
    let at = |k: usize| low + (high - low) * k as f64 / pieces;
    let hat = |value: f64, k: usize| (1.0 - ((value - at(k)) / (high - low) * pieces).abs()).max(0.0);
    let (rows, weight) = (samples.len(), 1e-6);
    // A little stiffness decides breakpoints that no sample is near.
    let W = DMatrix::from_fn(rows + breakpoints - 1, breakpoints, |i, k| match i.checked_sub(rows) {
        None => hat(samples[i].value, k),
        Some(j) if j == k => -weight,
        Some(j) if j + 1 == k => weight,
        Some(_) => 0.0,
    });
    let y = DVector::from_fn(rows + breakpoints - 1, |i, _| samples.get(i).map_or(0.0, |s| share * s.critical));
    let normal = W.transpose() * &W;
    let mut gains = normal.cholesky().ok_or(DesignError::Singular { what: "the schedule's normal matrix" })?.solve(&(W.transpose() * y));
    let floor = share * samples.iter().map(|s| s.critical).fold(f64::INFINITY, f64::min);
    gains.iter_mut().for_each(|g| *g = g.max(1e-3 * floor));
    let value = |x: f64| (0..breakpoints).map(|k| hat(x, k) * gains[k]).sum::<f64>();
    let scale = samples.iter().map(|s| share * s.critical / value(s.value)).fold(1.0, f64::min);
    Ok((0..breakpoints).map(|k| [at(k), gains[k] * scale]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_found_and_nothing_is_exceeded() {
        let line: Vec<Sample> = (0..9).map(|k| Sample { value: 1.0 + f64::from(k), critical: 50.0 - 3.0 * f64::from(k) }).collect();
        let points = fit(&line, 3, 0.8).unwrap();
        for (point, want) in points.iter().zip([[1.0, 40.0], [5.0, 30.4], [9.0, 20.8]]) {
            assert!((point[0] - want[0]).abs() < 1e-12 && (point[1] - want[1]).abs() < 1e-6, "{points:?}");
        }
        let bent: Vec<Sample> =
            (0..30).map(f64::from).map(|k| Sample { value: 1.0 + k, critical: 5.0 + (k - 11.0) * (k - 11.0) }).collect();
        let points = fit(&bent, 4, 0.5).unwrap();
        for s in &bent {
            let i = (1..3).find(|&i| s.value <= points[i][0]).unwrap_or(3);
            let ([x0, y0], [x1, y1]) = (points[i - 1], points[i]);
            let gain = y0 + (y1 - y0) * (s.value - x0) / (x1 - x0);
            assert!(gain <= 0.5 * s.critical * (1.0 + 1e-12) && gain > 0.0, "{gain} at {s:?}");
        }
        assert_eq!(fit(&line[..1], 4, 0.8).unwrap(), [[1.0, 40.0]]);
        assert!(fit(&[], 3, 0.8).is_err() && fit(&line, 3, 1.1).is_err() && fit(&line, 0, 0.5).is_err());
    }
}
