//! Rank-revealing Gaussian elimination with complete pivoting, in place and without allocation once built.
//!
//! Loop constraints are often redundant (a planar loop closed by a pin in space): the rows that carry information are found here,
//! the others are left out, and the rank is reported. nalgebra's dynamic LU allocates on every call, so it cannot serve the loop.

use alloc::vec;
use alloc::vec::Vec;

/// Factors `A` (m × n) and solves `A·X = B` for consistent systems of full column rank.
#[derive(Debug, Clone, PartialEq)]
pub struct Elimination {
    rows: usize,
    cols: usize,
    lu: Vec<f64>,
    row_order: Vec<usize>,
    col_order: Vec<usize>,
    rank: usize,
    smallest_pivot_ratio: f64,
    scratch: Vec<f64>,
}

/// Pivots below this share of the largest entry count as zero: far above rounding (1e-16) and far below any pivot of a
/// mechanism away from a singularity.
pub const RANK_TOLERANCE: f64 = 1e-9;

impl Elimination {
    /// Scratch for matrices of `rows` × `cols`.
    #[must_use]
    pub fn new(rows: usize, cols: usize) -> Self {
        Self {
            rows,
            cols,
            lu: vec![0.0; rows * cols],
            row_order: (0..rows).collect(),
            col_order: (0..cols).collect(),
            rank: 0,
            smallest_pivot_ratio: 0.0,
            scratch: vec![0.0; rows.max(cols)],
        }
    }

    /// Factors the matrix whose entry (i, j) is `entry(i, j)`.
    pub fn factor(&mut self, entry: impl Fn(usize, usize) -> f64) {
        let (m, n) = (self.rows, self.cols);
        for i in 0..m {
            self.row_order[i] = i;
            for j in 0..n {
                self.lu[i * n + j] = entry(i, j);
            }
        }
        for j in 0..n {
            self.col_order[j] = j;
        }
        let largest = self.lu.iter().fold(0.0_f64, |top, x| top.max(x.abs()));
        self.rank = 0;
        self.smallest_pivot_ratio = 0.0;
        for k in 0..m.min(n) {
            let (value, i, j) = self.largest_from(k);
            if value.is_nan() || value <= RANK_TOLERANCE * largest {
                break;
            }
            self.swap_rows(k, i);
            self.swap_columns(k, j);
            self.eliminate(k);
            self.rank = k + 1;
            self.smallest_pivot_ratio = value / largest;
        }
    }

    fn largest_from(&self, k: usize) -> (f64, usize, usize) {
        let mut best = (0.0, k, k);
        for i in k..self.rows {
            for j in k..self.cols {
                let value = self.lu[i * self.cols + j].abs();
                if value > best.0 || value.is_nan() {
                    best = (value, i, j);
                }
            }
        }
        best
    }

    fn swap_rows(&mut self, a: usize, b: usize) {
        if a != b {
            for j in 0..self.cols {
                self.lu.swap(a * self.cols + j, b * self.cols + j);
            }
            self.row_order.swap(a, b);
        }
    }

    fn swap_columns(&mut self, a: usize, b: usize) {
        if a != b {
            for i in 0..self.rows {
                self.lu.swap(i * self.cols + a, i * self.cols + b);
            }
            self.col_order.swap(a, b);
        }
    }

    fn eliminate(&mut self, k: usize) {
        let n = self.cols;
        let pivot = self.lu[k * n + k];
        for i in k + 1..self.rows {
            let factor = self.lu[i * n + k] / pivot;
            self.lu[i * n + k] = factor;
            if factor != 0.0 {
                for j in k + 1..n {
                    self.lu[i * n + j] -= factor * self.lu[k * n + j];
                }
            }
        }
    }

    /// Numerical rank of the factored matrix.
    #[must_use]
    pub fn rank(&self) -> usize {
        self.rank
    }

    /// Smallest accepted pivot over the largest entry: how far the pose is from losing a rank.
    #[must_use]
    pub fn smallest_pivot_ratio(&self) -> f64 {
        self.smallest_pivot_ratio
    }

    /// Columns without a pivot: coordinates the constraints leave free.
    #[must_use]
    pub fn free_columns(&self) -> &[usize] {
        &self.col_order[self.rank..]
    }

    /// Solves `A·x = b` with the independent rows; columns without a pivot get zero.
    ///
    /// # Panics
    /// With slices of other lengths than the matrix was built for (debug builds).
    pub fn solve(&mut self, b: impl Fn(usize) -> f64, x: &mut [f64]) {
        debug_assert_eq!(x.len(), self.cols, "one unknown per column");
        let (n, r) = (self.cols, self.rank);
        for k in 0..r {
            let mut sum = b(self.row_order[k]);
            for j in 0..k {
                sum -= self.lu[k * n + j] * self.scratch[j];
            }
            self.scratch[k] = sum;
        }
        for k in (0..r).rev() {
            let mut sum = self.scratch[k];
            for j in k + 1..r {
                sum -= self.lu[k * n + j] * self.scratch[j];
            }
            self.scratch[k] = sum / self.lu[k * n + k];
        }
        x.fill(0.0);
        for k in 0..r {
            x[self.col_order[k]] = self.scratch[k];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn redundant_rows_are_found_and_left_out() {
        // rows 0 and 1 span the plane, row 2 repeats row 0, row 3 is their sum
        let a = [[2.0, 1.0], [0.0, 3.0], [2.0, 1.0], [2.0, 4.0]];
        let x_true = [0.7, -1.3];
        let mut e = Elimination::new(4, 2);
        e.factor(|i, j| a[i][j]);
        assert_eq!(e.rank(), 2);
        let mut x = [0.0; 2];
        e.solve(|i| a[i][0] * x_true[0] + a[i][1] * x_true[1], &mut x);
        assert!((x[0] - x_true[0]).abs() < 1e-14 && (x[1] - x_true[1]).abs() < 1e-14);
    }

    #[test]
    fn a_free_column_is_named() {
        let a = [[1.0, 2.0, 0.0], [0.0, 1.0, 0.0]];
        let mut e = Elimination::new(2, 3);
        e.factor(|i, j| a[i][j]);
        assert_eq!((e.rank(), e.free_columns()), (2, [2].as_slice()));
    }

    #[test]
    fn not_a_number_gives_rank_zero_and_no_panic() {
        let mut e = Elimination::new(2, 2);
        e.factor(|_, _| f64::NAN);
        assert_eq!(e.rank(), 0);
    }
}
