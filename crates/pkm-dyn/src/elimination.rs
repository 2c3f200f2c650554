//! Rank-revealing Gaussian elimination with complete pivoting, in place and without allocation once built.
//!
//! Loop constraints are often redundant (a planar loop closed by a pin in space): the rows that carry information are found here,
//! the others are left out, and the rank is reported. nalgebra's dynamic LU allocates on every call, so it cannot serve the loop.

use alloc::vec;
use alloc::vec::Vec;

/// Factors `A` (m × n) and solves `A·X = B` for consistent systems, and `Aᵀ·Y = C`.
///
/// The order of pivots is kept from one factoring to the next while every pivot stays near the size it had when the order was chosen:
/// along a motion the search for pivots would be most of the work.
#[derive(Debug, Clone, PartialEq)]
pub struct Elimination {
    rows: usize,
    cols: usize,
    lu: Vec<f64>,
    row_order: Vec<usize>,
    col_order: Vec<usize>,
    /// Pivots when the order was chosen; empty when there is no order to keep.
    chosen: Vec<f64>,
    inverse_pivots: Vec<f64>,
    rank: usize,
    smallest_pivot_ratio: f64,
    scratch: Vec<f64>,
    /// Unknowns of up to four right sides.
    work: Vec<f64>,
}

/// Pivots below this share of the largest entry count as zero: far above rounding (1e-16) and far below any pivot of a
/// mechanism away from a singularity.
pub const RANK_TOLERANCE: f64 = 1e-9;

/// A pivot that has shrunk below this share of its first size calls for a new order. Multipliers stay below ten or so.
const KEPT_SHARE: f64 = 0.3;

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
            chosen: Vec::with_capacity(rows.min(cols)),
            inverse_pivots: vec![0.0; rows.min(cols)],
            rank: 0,
            smallest_pivot_ratio: 0.0,
            scratch: vec![0.0; rows.max(cols)],
            work: vec![0.0; 4 * cols],
        }
    }

    /// Forgets the order of pivots: what follows then depends on nothing that was before.
    pub fn forget(&mut self) {
        self.chosen.clear();
    }

    /// Factors the matrix whose entry (i, j) is `entry(i, j)`.
    pub fn factor(&mut self, entry: impl Fn(usize, usize) -> f64) {
        if !self.factor_in_kept_order(&entry) {
            self.factor_in_new_order(&entry);
        }
    }

    fn factor_in_kept_order(&mut self, entry: &impl Fn(usize, usize) -> f64) -> bool {
        // With columns left over, a rank that grows again would go unseen.
        if self.chosen.len() < self.cols || self.rank < self.cols {
            return false;
        }
        let n = self.cols;
        let mut largest = 0.0_f64;
        for (row, &i) in self.lu.chunks_exact_mut(n.max(1)).zip(&self.row_order) {
            for (x, &j) in row.iter_mut().zip(&self.col_order) {
                *x = entry(i, j);
                largest = largest.max(x.abs());
            }
        }
        let mut smallest = f64::INFINITY;
        for k in 0..self.rank {
            let pivot = self.lu[k * n + k].abs();
            let is_sound = pivot >= KEPT_SHARE * self.chosen[k];
            if !is_sound {
                return false;
            }
            smallest = smallest.min(pivot);
            self.eliminate(k);
        }
        self.smallest_pivot_ratio = if self.rank > 0 { smallest / largest } else { 0.0 };
        true
    }

    fn factor_in_new_order(&mut self, entry: &impl Fn(usize, usize) -> f64) {
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
        self.chosen.clear();
        for k in 0..m.min(n) {
            let (value, i, j) = self.largest_from(k);
            if value.is_nan() || value <= RANK_TOLERANCE * largest {
                break;
            }
            self.swap_rows(k, i);
            self.swap_columns(k, j);
            self.eliminate(k);
            self.rank = k + 1;
            self.chosen.push(value);
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

    #[inline]
    fn eliminate(&mut self, k: usize) {
        let n = self.cols;
        let (above, below) = self.lu.split_at_mut((k + 1) * n);
        let pivot_row = &above[k * n..];
        let inverse = 1.0 / pivot_row[k];
        self.inverse_pivots[k] = inverse;
        for row in below.chunks_exact_mut(n) {
            // Legs of a parallel robot meet at the platform only: most entries below a pivot are zero.
            if row[k] != 0.0 {
                let factor = row[k] * inverse;
                row[k] = factor;
                for (x, p) in row[k + 1..].iter_mut().zip(&pivot_row[k + 1..]) {
                    *x -= factor * p;
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

    /// Rows without a pivot: what they say follows from the other rows.
    #[must_use]
    pub fn redundant_rows(&self) -> &[usize] {
        &self.row_order[self.rank..]
    }

    /// Solves `A·x = b` with the independent rows; columns without a pivot get zero.
    ///
    /// # Panics
    /// With slices of other lengths than the matrix was built for (debug builds).
    #[inline]
    pub fn solve(&mut self, b: impl Fn(usize) -> f64, x: &mut [f64]) {
        debug_assert_eq!(x.len(), self.cols, "one unknown per column");
        let (n, r) = (self.cols, self.rank);
        for k in 0..r {
            let row = &self.lu[k * n..k * n + k];
            let sum: f64 = row.iter().zip(&self.scratch).fold(b(self.row_order[k]), |sum, (l, y)| sum - l * y);
            self.scratch[k] = sum;
        }
        for k in (0..r).rev() {
            let row = &self.lu[k * n..k * n + r];
            let sum = row[k + 1..].iter().zip(&self.scratch[k + 1..r]).fold(self.scratch[k], |sum, (u, x)| sum - u * x);
            self.scratch[k] = sum * self.inverse_pivots[k];
        }
        if r < n {
            x.fill(0.0);
        }
        for k in 0..r {
            x[self.col_order[k]] = self.scratch[k];
        }
    }

    /// As [`Elimination::solve`], for several right sides: `b(i, k)` is entry `i` of right side `k`, and `put(j, k, x)` receives unknown
    /// `j` of it. A pass over the factors serves up to four of them.
    pub fn solve_many(&mut self, n_sides: usize, b: impl Fn(usize, usize) -> f64, mut put: impl FnMut(usize, usize, f64)) {
        let mut first = 0;
        while first < n_sides {
            match n_sides - first {
                1 => self.solve_block::<1>(first, &b, &mut put),
                2 => self.solve_block::<2>(first, &b, &mut put),
                3 => self.solve_block::<3>(first, &b, &mut put),
                _ => self.solve_block::<4>(first, &b, &mut put),
            }
            first += 4;
        }
    }

    fn solve_block<const M: usize>(&mut self, first: usize, b: &impl Fn(usize, usize) -> f64, put: &mut impl FnMut(usize, usize, f64)) {
        let (n, r) = (self.cols, self.rank);
        let (work, _) = self.work.as_chunks_mut::<M>();
        for k in 0..r {
            let row = self.row_order[k];
            let mut sum: [f64; M] = core::array::from_fn(|s| b(row, first + s));
            for (l, y) in self.lu[k * n..k * n + k].iter().zip(work.iter()) {
                for s in 0..M {
                    sum[s] -= l * y[s];
                }
            }
            work[k] = sum;
        }
        for k in (0..r).rev() {
            let mut sum = work[k];
            for (u, y) in self.lu[k * n + k + 1..k * n + r].iter().zip(&work[k + 1..r]) {
                for s in 0..M {
                    sum[s] -= u * y[s];
                }
            }
            for (s, x) in sum.iter_mut().enumerate() {
                *x *= self.inverse_pivots[k];
                put(self.col_order[k], first + s, *x);
            }
            work[k] = sum;
        }
        for &j in &self.col_order[r..] {
            for s in 0..M {
                put(j, first + s, 0.0);
            }
        }
    }

    /// Solves `Aᵀ·y = c` with the independent columns; rows without a pivot get zero.
    ///
    /// # Panics
    /// With slices of other lengths than the matrix was built for (debug builds).
    pub fn solve_transposed(&mut self, c: impl Fn(usize) -> f64, y: &mut [f64]) {
        debug_assert_eq!(y.len(), self.rows, "one unknown per row");
        let (n, r) = (self.cols, self.rank);
        for k in 0..r {
            self.scratch[k] = c(self.col_order[k]);
        }
        for k in 0..r {
            let z = self.scratch[k] * self.inverse_pivots[k];
            self.scratch[k] = z;
            for j in k + 1..r {
                self.scratch[j] -= self.lu[k * n + j] * z;
            }
        }
        for k in (0..r).rev() {
            let w = self.scratch[k];
            for j in 0..k {
                self.scratch[j] -= self.lu[k * n + j] * w;
            }
        }
        y.fill(0.0);
        for k in 0..r {
            y[self.row_order[k]] = self.scratch[k];
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

    #[test]
    fn the_transposed_system_is_solved_with_the_rows_that_carry_information() {
        let a = [[2.0, 1.0, 0.3], [0.0, 3.0, -1.0], [2.0, 1.0, 0.3], [0.5, 4.0, 2.0]];
        let c = [0.4, -1.1, 2.0];
        let mut e = Elimination::new(4, 3);
        e.factor(|i, j| a[i][j]);
        assert_eq!(e.redundant_rows().len(), 1);
        let mut y = [0.0; 4];
        e.solve_transposed(|j| c[j], &mut y);
        for j in 0..3 {
            let sum: f64 = (0..4).map(|i| a[i][j] * y[i]).sum();
            assert!((sum - c[j]).abs() < 1e-14);
        }
    }

    #[test]
    fn many_right_sides_are_solved_as_each_alone() {
        let a = [[2.0, 1.0, 0.0], [0.0, 3.0, -1.0], [2.0, 1.0, 0.0], [0.5, 4.0, 2.0]];
        let b = |i: usize, k: usize| (0..3).map(|j| a[i][j] * [[0.7, -1.3, 0.2], [1.0, 0.0, 4.0]][k][j]).sum::<f64>();
        let mut e = Elimination::new(4, 3);
        e.factor(|i, j| a[i][j]);
        // Six sides: a block of four, then one of two.
        let (mut x, mut one) = ([[f64::NAN; 3]; 6], [0.0; 3]);
        e.solve_many(6, |i, k| b(i, k % 2) * k as f64, |j, k, value| x[k][j] = value);
        for (k, x) in x.iter().enumerate() {
            e.solve(|i| b(i, k % 2) * k as f64, &mut one);
            assert!((0..3).all(|j| (one[j] - x[j]).abs() < 1e-14), "{x:?} {one:?}");
        }
    }

    #[test]
    fn a_kept_order_solves_as_well_as_a_new_one_and_is_left_when_a_pivot_shrinks() {
        let at = |t: f64| move |i: usize, j: usize| [[t, 1.0], [1.0, -0.5]][i][j];
        let mut e = Elimination::new(2, 2);
        e.factor(at(3.0));
        for t in [2.0, 1.0, 0.5, 0.0] {
            e.factor(at(t));
            let mut x = [0.0; 2];
            e.solve(|i| at(t)(i, 0) * 0.7 + at(t)(i, 1) * -1.3, &mut x);
            assert!((x[0] - 0.7).abs() < 1e-14 && (x[1] + 1.3).abs() < 1e-14, "{t}: {x:?}");
        }
        assert_eq!(e.rank(), 2);
    }
}
