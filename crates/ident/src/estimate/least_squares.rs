//! Linear estimates of independent columns from a triangular factor: ordinary, ridge, total.

use faer::linalg::solvers::{Solve, SolveLstsq};
use faer::{Mat, Side};

/// The columns `kept` and the target (last column) of a triangle, columns at length one; and these lengths.
fn scaled(triangle: &Mat<f64>, kept: &[usize]) -> (Mat<f64>, Mat<f64>, Vec<f64>) {
    let target = triangle.ncols() - 1;
    let lengths: Vec<f64> = kept.iter().map(|&j| triangle.col(j).norm_l2().max(f64::MIN_POSITIVE)).collect();
    let a = Mat::from_fn(triangle.nrows(), kept.len(), |i, j| triangle[(i, kept[j])] / lengths[j]);
    (a, Mat::from_fn(triangle.nrows(), 1, |i, _| triangle[(i, target)]), lengths)
}

/// Least squares on independent columns: one value per kept column.
#[must_use]
pub fn ordinary(triangle: &Mat<f64>, kept: &[usize]) -> Vec<f64> {
    let (a, b, lengths) = scaled(triangle, kept);
    let x = a.qr().solve_lstsq(&b);
    lengths.iter().enumerate().map(|(j, l)| x[(j, 0)] / l).collect()
}

/// Least squares drawn towards `prior`: `‖W·x − z‖² + weight·Σ (length·(x − prior))²`, with the lengths of the columns.
#[must_use]
pub fn ridge(triangle: &Mat<f64>, kept: &[usize], prior: &[f64], weight: f64) -> Vec<f64> {
    let (a, b, lengths) = scaled(triangle, kept);
    let n = kept.len();
    let soft = weight.max(0.0).sqrt();
    let rows = a.nrows();
    let stacked = Mat::from_fn(rows + n, n, |i, j| if i < rows { a[(i, j)] } else { soft * f64::from(u8::from(i - rows == j)) });
    let target = Mat::from_fn(rows + n, 1, |i, _| if i < rows { b[(i, 0)] } else { soft * lengths[i - rows] * prior[i - rows] });
    let x = stacked.qr().solve_lstsq(&target);
    lengths.iter().enumerate().map(|(j, l)| x[(j, 0)] / l).collect()
}

/// Total least squares: the smallest change of columns and target, at length one each, that makes the target a combination of the columns.
///
/// `None` when the smallest singular vector has no part along the target: then no such combination exists.
#[must_use]
pub fn total(triangle: &Mat<f64>, kept: &[usize]) -> Option<Total> {
    let (a, b, lengths) = scaled(triangle, kept);
    let n = kept.len();
    let scale = b.norm_l2().max(f64::MIN_POSITIVE);
    let both = Mat::from_fn(a.nrows(), n + 1, |i, j| if j < n { a[(i, j)] } else { b[(i, 0)] / scale });
    let svd = both.thin_svd().ok()?;
    let v = svd.V();
    let last = v[(n, n)];
    if last.abs() < 1e-12 {
        return None;
    }
    let smallest = svd.S().column_vector().iter().copied().last().unwrap_or(0.0);
    Some(Total {
        values: (0..n).map(|j| -v[(j, n)] / last * scale / lengths[j]).collect(),
        noise: lengths.iter().map(|l| smallest * smallest * l * l).collect(),
    })
}

/// The solution of [`total`].
#[derive(Debug, Clone, PartialEq)]
pub struct Total {
    /// One value per kept column.
    pub values: Vec<f64>,
    /// Square of every column that is noise: the solution satisfies `(WᵀW − diag noise)·x = Wᵀz` \[Golub1980\].
    pub noise: Vec<f64>,
}

/// Precision that [`ridge`] draws every kept column with.
#[must_use]
pub fn ridge_precision(triangle: &Mat<f64>, kept: &[usize], weight: f64) -> Vec<f64> {
    kept.iter().map(|&j| weight.max(0.0) * triangle.col(j).squared_norm_l2()).collect()
}

/// Inverse of `WᵀW` over the kept columns: the covariance of least squares per unit of noise variance. `None` when it is singular.
#[must_use]
pub fn information_inverse(triangle: &Mat<f64>, kept: &[usize]) -> Option<Mat<f64>> {
    let (a, _, lengths) = scaled(triangle, kept);
    let gram = a.transpose() * &a;
    let inverse = gram.llt(Side::Lower).ok()?.solve(Mat::<f64>::identity(kept.len(), kept.len()));
    Some(Mat::from_fn(kept.len(), kept.len(), |i, j| inverse[(i, j)] / (lengths[i] * lengths[j])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::factor::Factor;

    /// Rows of a made-up problem with the solution (2, −3) for columns 0 and 2, column 1 their sum.
    fn triangle(noise: f64) -> Mat<f64> {
        let mut factor = Factor::new(3);
        for i in 0..100 {
            let (x, y) = (f64::from(i % 7) - 3.0, f64::from(i % 11) * 10.0);
            factor.push(&[x, x + y, y], 2.0 * x - 3.0 * y + noise * (f64::from(i % 5) - 2.0), 0.0);
        }
        factor.triangle()
    }

    #[test]
    fn exact_rows_give_the_exact_answer_by_every_road() {
        let t = triangle(0.0);
        for x in [ordinary(&t, &[0, 2]), ridge(&t, &[0, 2], &[0.0, 0.0], 0.0), total(&t, &[0, 2]).unwrap().values] {
            assert!((x[0] - 2.0).abs() < 1e-10 && (x[1] + 3.0).abs() < 1e-10, "{x:?}");
        }
        // Column 0 eliminated: 2·x − 3·y = 2·(x + y) − 5·y.
        let x = ordinary(&t, &[1, 2]);
        assert!((x[0] - 2.0).abs() < 1e-9 && (x[1] + 5.0).abs() < 1e-9, "{x:?}");
    }

    #[test]
    fn total_least_squares_solves_its_normal_equations() {
        let t = triangle(1.0);
        let found = total(&t, &[0, 2]).unwrap();
        for (i, &row) in [0, 2].iter().enumerate() {
            let product = |j: usize| (0..t.nrows()).map(|k| t[(k, row)] * t[(k, j)]).sum::<f64>();
            let left = product(0) * found.values[0] + product(2) * found.values[1] - found.noise[i] * found.values[i];
            assert!((left - product(3)).abs() < 1e-9 * product(3).abs() && found.noise[i] > 0.0, "{left} {}", product(3));
        }
    }

    #[test]
    fn a_heavy_ridge_stays_at_the_prior() {
        let t = triangle(1.0);
        let x = ridge(&t, &[0, 2], &[5.0, 1.0], 1e12);
        assert!((x[0] - 5.0).abs() < 1e-6 && (x[1] - 1.0).abs() < 1e-6, "{x:?}");
    }

    #[test]
    fn the_inverse_information_is_that_of_the_normal_equations() {
        let t = triangle(1.0);
        let inverse = information_inverse(&t, &[0, 2]).unwrap();
        let a = Mat::from_fn(t.nrows(), 2, |i, j| t[(i, 2 * j)]);
        let one = a.transpose() * &a * inverse;
        assert!((one - Mat::<f64>::identity(2, 2)).norm_max() < 1e-10);
    }
}
