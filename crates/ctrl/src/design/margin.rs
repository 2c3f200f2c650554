//! How far a loop is from instability: spectral radius and abscissa, and the largest gain it bears.

use alloc::vec::Vec;

use nalgebra::{Complex, DMatrix};
use pkm_dyn::math;

use super::discretise::balanced;
use super::error::DesignError;

/// Eigenvalues of a square real matrix; empty when they cannot be computed.
#[must_use]
pub fn eigenvalues(A: &DMatrix<f64>) -> Vec<Complex<f64>> {
    // Positions beside velocities of stiff parts: unbalanced, rounding moves poles near the unit circle by 1e-6.
    let (A, _) = balanced(A);
    let copy = faer::Mat::<f64>::from_fn(A.nrows(), A.ncols(), |i, j| A[(i, j)]);
    copy.eigenvalues().unwrap_or_default()
}

/// Largest modulus of an eigenvalue; infinite when the eigenvalues cannot be computed, zero without states.
#[must_use]
pub fn spectral_radius(A: &DMatrix<f64>) -> f64 {
    let found = eigenvalues(A);
    if found.len() < A.nrows() { f64::INFINITY } else { found.iter().map(|p| math::hypot(p.re, p.im)).fold(0.0, f64::max) }
}

/// Largest real part of an eigenvalue; infinite when the eigenvalues cannot be computed, minus infinity without states.
#[must_use]
pub fn spectral_abscissa(A: &DMatrix<f64>) -> f64 {
    let found = eigenvalues(A);
    if found.len() < A.nrows() { f64::INFINITY } else { found.iter().map(|p| p.re).fold(f64::NEG_INFINITY, f64::max) }
}

/// Gains above this are no limit in practice.
const ENDLESS: f64 = 1e5;

/// Halvings of the interval: 2⁻⁴⁰ of it is left.
const HALVINGS: usize = 40;

/// The smallest gain from `start` on at which `A(gain)` stops being stable, found by doubling and bisection; infinite when that is
/// above 10⁵.
///
/// A loop that becomes unstable and stable again between two doublings is not noticed.
///
/// # Errors
/// What `closed` refuses; a loop that is unstable at `start` already.
pub fn critical_gain(start: f64, closed: impl Fn(f64) -> Result<DMatrix<f64>, DesignError>) -> Result<f64, DesignError> {
    let is_stable = |gain: f64| closed(gain).map(|A| spectral_radius(&A) < 1.0);
    if !is_stable(start)? {
        return Err(DesignError::Value { what: "gain at the start", value: start, limit: "must be stable" });
    }
    let (mut lower, mut upper) = (start, if start > 0.0 { 2.0 * start } else { 1.0 });
    while is_stable(upper)? {
        lower = upper;
        upper *= 2.0;
        if upper > ENDLESS {
            return Ok(f64::INFINITY);
        }
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (lower + upper);
        if is_stable(middle)? {
            lower = middle;
        } else {
            upper = middle;
        }
    }
    Ok(lower)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_first_order_loop_with_a_delay_bears_the_gain_one() {
        // x⁺ = x − k·x(one sample ago): z² − z + k, of product k: on the circle at k = 1.
        let closed = |k: f64| Ok(DMatrix::from_row_slice(2, 2, &[1.0, -k, 1.0, 0.0]));
        assert!(critical_gain(-0.1, closed).is_err(), "positive feedback is not stable");
        assert!((critical_gain(0.1, closed).unwrap() - 1.0).abs() < 1e-9);
        let calm = |_: f64| Ok(DMatrix::from_element(1, 1, 0.5));
        assert!(critical_gain(0.0, calm).unwrap().is_infinite());
        assert!((spectral_radius(&closed(0.5).unwrap()) - math::sqrt(0.5)).abs() < 1e-12);
        assert!((spectral_abscissa(&closed(0.5).unwrap()) - 0.5).abs() < 1e-12);
    }
}
