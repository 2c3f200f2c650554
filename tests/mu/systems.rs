//! Small systems put together from transfer functions, for the problems of the μ tests.

#![allow(dead_code, reason = "each of the test programs that share this file uses its part")]

use nalgebra::{Complex, DMatrix};
use pkm_ctrl::design::mu::{CMatrix, StateSpace};

/// A continuous system under construction.
#[derive(Debug, Clone)]
pub(crate) struct Sys {
    pub(crate) a: DMatrix<f64>,
    pub(crate) b: DMatrix<f64>,
    pub(crate) c: DMatrix<f64>,
    pub(crate) d: DMatrix<f64>,
}

impl Sys {
    /// A constant gain.
    pub(crate) fn gain(d: DMatrix<f64>) -> Self {
        Self { a: DMatrix::zeros(0, 0), b: DMatrix::zeros(0, d.ncols()), c: DMatrix::zeros(d.nrows(), 0), d }
    }

    /// A proper transfer function; coefficients from the highest power down, padded to equal length.
    pub(crate) fn tf(numerator: &[f64], denominator: &[f64]) -> Self {
        let n = denominator.len() - 1;
        let monic: Vec<f64> = denominator.iter().map(|x| x / denominator[0]).collect();
        let mut top = vec![0.0; n + 1 - numerator.len()];
        top.extend(numerator.iter().map(|x| x / denominator[0]));
        let a = DMatrix::from_fn(n, n, |i, j| {
            if i + 1 == j {
                1.0
            } else if i + 1 == n {
                -monic[n - j]
            } else {
                0.0
            }
        });
        let b = DMatrix::from_fn(n, 1, |i, _| if i + 1 == n { 1.0 } else { 0.0 });
        let c = DMatrix::from_fn(1, n, |_, j| top[n - j] - monic[n - j] * top[0]);
        Self { a, b, c, d: DMatrix::from_element(1, 1, top[0]) }
    }

    /// `self` after `before`.
    pub(crate) fn after(&self, before: &Self) -> Self {
        let (n, m) = (self.a.nrows(), before.a.nrows());
        let mut a = DMatrix::zeros(n + m, n + m);
        a.view_mut((0, 0), (n, n)).copy_from(&self.a);
        a.view_mut((0, n), (n, m)).copy_from(&(&self.b * &before.c));
        a.view_mut((n, n), (m, m)).copy_from(&before.a);
        let b = rows(&(&self.b * &before.d), &before.b);
        let c = columns(&self.c, &(&self.d * &before.c));
        Self { a, b, c, d: &self.d * &before.d }
    }

    /// Side by side: inputs and outputs of both.
    pub(crate) fn beside(&self, other: &Self) -> Self {
        let diagonal = |x: &DMatrix<f64>, y: &DMatrix<f64>| {
            let mut out = DMatrix::zeros(x.nrows() + y.nrows(), x.ncols() + y.ncols());
            out.view_mut((0, 0), x.shape()).copy_from(x);
            out.view_mut(x.shape(), y.shape()).copy_from(y);
            out
        };
        Self {
            a: diagonal(&self.a, &other.a),
            b: diagonal(&self.b, &other.b),
            c: diagonal(&self.c, &other.c),
            d: diagonal(&self.d, &other.d),
        }
    }

    /// `copies` of it side by side.
    pub(crate) fn times(&self, copies: usize) -> Self {
        (1..copies).fold(self.clone(), |all, _| all.beside(self))
    }

    /// As the analysis takes it.
    pub(crate) fn space(self) -> StateSpace {
        StateSpace::try_new([self.a, self.b, self.c, self.d], None).expect("dimensions that fit")
    }
}

fn rows(top: &DMatrix<f64>, below: &DMatrix<f64>) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(top.nrows() + below.nrows(), top.ncols());
    out.rows_mut(0, top.nrows()).copy_from(top);
    out.rows_mut(top.nrows(), below.nrows()).copy_from(below);
    out
}

fn columns(left: &DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    rows(&left.transpose(), &right.transpose()).transpose()
}

/// A complex matrix from (re, im), row by row.
pub(crate) fn matrix(rows: usize, entries: &[(f64, f64)]) -> CMatrix {
    let cols = entries.len() / rows;
    CMatrix::from_fn(rows, cols, |i, j| Complex::new(entries[i * cols + j].0, entries[i * cols + j].1))
}

/// Numbers of one seed.
pub(crate) struct Draw(pub(crate) u64);

impl Draw {
    /// Uniform in [-1, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let bits = (self.0 ^ (self.0 >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 11;
        bits as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// A complex matrix of independent entries.
    pub(crate) fn complex(&mut self, rows: usize, cols: usize) -> CMatrix {
        CMatrix::from_fn(rows, cols, |_, _| Complex::new(self.unit(), self.unit()))
    }

    /// A whole number below `n`.
    pub(crate) fn below(&mut self, n: usize) -> usize {
        let share = (self.unit() + 1.0) / 2.0;
        (1..n).take_while(|&k| share * n as f64 >= k as f64).count()
    }
}
