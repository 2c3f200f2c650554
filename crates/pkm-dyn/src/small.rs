//! Symmetric systems of a few unknowns, in place: nalgebra's dynamic factorisations allocate.

use nalgebra::DMatrix;

/// A pivot below this share of the largest diagonal entry is rounding: kilograms and kilogram square metres of one robot are less apart.
const NOTHING: f64 = 1e-18;

/// What the columns before leave of a diagonal entry is rounding below this share of it.
const CANCELLED: f64 = 1e-13;

/// Lower Cholesky factor of `m` in its lower triangle, whether `m` is positive definite.
#[must_use]
pub(crate) fn cholesky(m: &mut DMatrix<f64>) -> bool {
    let largest = (0..m.nrows()).fold(0.0_f64, |top, j| top.max(m[(j, j)]));
    for j in 0..m.nrows() {
        for i in j..m.nrows() {
            let sum = (0..j).fold(m[(i, j)], |sum, k| sum - m[(i, k)] * m[(j, k)]);
            if i > j {
                m[(i, j)] = sum / m[(j, j)];
            } else if sum > NOTHING * largest && sum > CANCELLED * m[(j, j)] {
                m[(j, j)] = crate::math::sqrt(sum);
            } else {
                // Not a number ends here as well.
                return false;
            }
        }
    }
    true
}

/// Solves `L·Lᵀ·x = b` in place, with the factor [`cholesky`] leaves.
pub(crate) fn solve(l: &DMatrix<f64>, x: &mut [f64]) {
    let n = l.nrows();
    for i in 0..n {
        x[i] = (0..i).fold(x[i], |sum, k| sum - l[(i, k)] * x[k]) / l[(i, i)];
    }
    for i in (0..n).rev() {
        x[i] = (i + 1..n).fold(x[i], |sum, k| sum - l[(k, i)] * x[k]) / l[(i, i)];
    }
}
