//! Singular values and right singular vectors by one-sided Jacobi rotations, in place and without allocation once built.
//!
//! nalgebra's dynamic decomposition allocates on every call, so it cannot serve the loop. Jacobi finds small singular values to high
//! relative accuracy, and distance to a singularity is a small singular value \[Demmel1992\].

use alloc::vec;
use alloc::vec::Vec;

use crate::math;

/// Sweeps over all pairs of columns; matrices of this size need six to ten.
const MAX_SWEEPS: usize = 60;

/// Columns count as orthogonal when their cosine is below this.
const ORTHOGONAL: f64 = 1e-15;

/// `A·V = U·S` for matrices of a fixed size: singular values in falling order, and `V`.
#[derive(Debug, Clone, PartialEq)]
pub struct Svd {
    rows: usize,
    cols: usize,
    /// `A`, then `U·S`, column by column.
    a: Vec<f64>,
    /// `V`, column by column.
    v: Vec<f64>,
    /// Singular values in falling order, one per column of `A`; those beyond its rank are zero or rounding.
    values: Vec<f64>,
}

impl Svd {
    /// Room for matrices of `rows` × `cols`.
    #[must_use]
    pub fn new(rows: usize, cols: usize) -> Self {
        Self { rows, cols, a: vec![0.0; rows * cols], v: vec![0.0; cols * cols], values: vec![0.0; cols] }
    }

    /// Decomposes the matrix whose entry (i, j) is `entry(i, j)`; a matrix with entries that are no numbers has singular values NaN.
    pub fn factor(&mut self, entry: impl Fn(usize, usize) -> f64) {
        let (m, n) = (self.rows, self.cols);
        self.v.fill(0.0);
        for j in 0..n {
            for i in 0..m {
                self.a[j * m + i] = entry(i, j);
            }
            self.v[j * n + j] = 1.0;
        }
        // Columns that are zero beside the whole have no direction to be orthogonal to.
        let floor = 1e-32 * self.a.iter().map(|x| x * x).sum::<f64>();
        if floor.is_nan() || floor.is_infinite() {
            self.values.fill(f64::NAN);
            return;
        }
        for _ in 0..MAX_SWEEPS {
            let mut is_done = true;
            for p in 0..n {
                for q in p + 1..n {
                    is_done &= self.rotate(p, q, floor);
                }
            }
            if is_done {
                break;
            }
        }
        self.sort();
    }

    /// Makes columns `p` and `q` orthogonal; whether they were.
    fn rotate(&mut self, p: usize, q: usize, floor: f64) -> bool {
        let m = self.rows;
        let (mut alpha, mut beta, mut gamma) = (0.0, 0.0, 0.0);
        for i in 0..m {
            let (x, y) = (self.a[p * m + i], self.a[q * m + i]);
            alpha += x * x;
            beta += y * y;
            gamma += x * y;
        }
        if gamma.abs() <= ORTHOGONAL * math::sqrt(alpha * beta) || gamma.abs() <= floor {
            return true;
        }
        let zeta = (beta - alpha) / (2.0 * gamma);
        // The smaller of the two angles: the columns keep their places, and the sweeps converge.
        let t = if zeta >= 0.0 { 1.0 } else { -1.0 } / (zeta.abs() + math::sqrt(1.0 + zeta * zeta));
        let c = 1.0 / math::sqrt(1.0 + t * t);
        turn(&mut self.a, m, [p, q], [c, c * t]);
        turn(&mut self.v, self.cols, [p, q], [c, c * t]);
        false
    }

    fn sort(&mut self) {
        let (m, n) = (self.rows, self.cols);
        for j in 0..n {
            self.values[j] = math::sqrt(self.a[j * m..(j + 1) * m].iter().map(|x| x * x).sum());
        }
        for j in 0..n {
            let best = (j..n).fold(j, |best, k| if self.values[k] > self.values[best] { k } else { best });
            if best != j {
                self.values.swap(j, best);
                (0..m).for_each(|i| self.a.swap(j * m + i, best * m + i));
                (0..n).for_each(|i| self.v.swap(j * n + i, best * n + i));
            }
        }
    }

    /// Singular values in falling order, one per column.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Right singular vector of the `k`-th singular value, of length one.
    #[must_use]
    pub fn right(&self, k: usize) -> &[f64] {
        &self.v[k * self.cols..(k + 1) * self.cols]
    }

    /// `A` times that vector: the left singular vector, as long as the singular value.
    #[must_use]
    pub fn image(&self, k: usize) -> &[f64] {
        &self.a[k * self.rows..(k + 1) * self.rows]
    }

    /// Number of singular values above `tolerance` times the largest.
    #[must_use]
    pub fn rank(&self, tolerance: f64) -> usize {
        let largest = self.values.first().copied().unwrap_or(0.0);
        self.values.iter().take(self.rows).filter(|&&s| s > tolerance * largest).count()
    }
}

fn turn(matrix: &mut [f64], rows: usize, [p, q]: [usize; 2], [c, s]: [f64; 2]) {
    for i in 0..rows {
        let (x, y) = (matrix[p * rows + i], matrix[q * rows + i]);
        matrix[p * rows + i] = c * x - s * y;
        matrix[q * rows + i] = s * x + c * y;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn singular_values_are_nalgebras(m in 1_usize..9, n in 1_usize..9, entries in prop::collection::vec(-2.0..2.0_f64, 64)) {
            let a = DMatrix::from_fn(m, n, |i, j| entries[i * 8 + j]);
            let mut svd = Svd::new(m, n);
            svd.factor(|i, j| a[(i, j)]);
            let mut want = a.singular_values().as_slice().to_vec();
            want.sort_by(|x, y| y.total_cmp(x));
            want.resize(n, 0.0);
            for (k, want) in want.iter().enumerate() {
                prop_assert!((svd.values()[k] - want).abs() < 1e-13 * (1.0 + want));
                let v = DMatrix::from_column_slice(n, 1, svd.right(k));
                prop_assert!((v.norm() - 1.0).abs() < 1e-13);
                prop_assert!((&a * &v - DMatrix::from_column_slice(m, 1, svd.image(k))).norm() < 1e-13);
            }
        }
    }

    #[test]
    fn the_null_space_of_a_wide_matrix_is_found() {
        let mut svd = Svd::new(2, 4);
        let a = [[1.0, 2.0, 0.0, -1.0], [2.0, 4.0, 0.0, -2.0]];
        svd.factor(|i, j| a[i][j]);
        assert_eq!(svd.rank(1e-9), 1);
        for k in 1..4 {
            assert!(a.iter().all(|row| row.iter().zip(svd.right(k)).map(|(x, v)| x * v).sum::<f64>().abs() < 1e-14));
        }
    }

    #[test]
    fn not_a_number_gives_no_number_and_no_panic() {
        let mut svd = Svd::new(2, 2);
        svd.factor(|_, _| f64::NAN);
        assert!(svd.values()[0].is_nan() && svd.rank(1e-9) == 0);
    }
}
