//! Least squares without the rows: the triangular factor of `[W z]`, updated block by block.
//!
//! All that a linear estimator needs of the rows is `R` with `RᵀR = [W z]ᵀ[W z]`. It is made by Householder reflections, not from normal
//! equations, so its singular values are those of `W` and a rank can be read off them.

use faer::Mat;

use crate::error::InputError;
use crate::observation::{Observation, Rows};

/// Rows gathered before they are reflected into the factor, as a multiple of the columns.
const GATHERED: usize = 3;

/// The triangular factor of all rows pushed so far.
#[derive(Debug, Clone)]
pub struct Factor {
    /// Parameters.
    p: usize,
    /// The factor in the upper rows, gathered rows below.
    rows: Mat<f64>,
    filled: usize,
    /// Rows that were active.
    count: usize,
    /// Sum of the measured effort's squares over them.
    effort_square: f64,
}

impl Factor {
    /// Of no rows, for `p` parameters.
    #[must_use]
    pub fn new(p: usize) -> Self {
        let q = p + 1;
        Self { p, rows: Mat::zeros(q + GATHERED * q, q), filled: q, count: 0, effort_square: 0.0 }
    }

    /// Adds a row and its target; `effort` is the measured effort there.
    ///
    /// # Panics
    /// With a row of another length.
    pub fn push(&mut self, row: &[f64], target: f64, effort: f64) {
        assert_eq!(row.len(), self.p, "one entry per parameter");
        for (c, x) in row.iter().enumerate() {
            self.rows[(self.filled, c)] = *x;
        }
        self.rows[(self.filled, self.p)] = target;
        self.filled += 1;
        self.count += 1;
        self.effort_square += effort * effort;
        if self.filled == self.rows.nrows() {
            self.reflect();
        }
    }

    fn reflect(&mut self) {
        let q = self.p + 1;
        if self.filled == q {
            return;
        }
        let qr = self.rows.as_ref().subrows(0, self.filled).qr();
        let r = qr.R();
        for j in 0..q {
            for i in 0..q {
                self.rows[(i, j)] = if i <= j { r[(i, j)] } else { 0.0 };
            }
        }
        self.filled = q;
    }

    /// The factor, `p + 1` square and upper triangular; its last column belongs to the target.
    #[must_use]
    pub fn triangle(&self) -> Mat<f64> {
        if self.filled == self.p + 1 {
            return self.rows.subrows(0, self.filled).to_owned();
        }
        let mut copy = self.clone();
        copy.reflect();
        copy.rows.subrows(0, self.p + 1).to_owned()
    }

    /// Adds all rows of another factor, each multiplied by `weight`; counts and efforts are added as they are.
    pub fn absorb(&mut self, other: &Self, weight: f64) {
        let triangle = other.triangle();
        let count = (self.count + other.count, self.effort_square + other.effort_square);
        let mut row = vec![0.0; self.p];
        for i in 0..triangle.nrows() {
            for (c, x) in row.iter_mut().enumerate() {
                *x = weight * triangle[(i, c)];
            }
            self.push(&row, weight * triangle[(i, self.p)], 0.0);
        }
        (self.count, self.effort_square) = count;
    }

    /// Number of rows.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// Sum of the measured effort's squares.
    #[must_use]
    pub fn effort_square(&self) -> f64 {
        self.effort_square
    }

    /// Sum of squared residuals with the parameters `theta`.
    #[must_use]
    pub fn error_square(&self, theta: &[f64]) -> f64 {
        squared_error(&self.triangle(), theta)
    }
}

/// Sum of squared residuals that a triangle of [`Factor::triangle`] leaves with `theta`.
#[must_use]
pub(crate) fn squared_error(triangle: &Mat<f64>, theta: &[f64]) -> f64 {
    let p = theta.len();
    let mut sum = 0.0;
    for i in 0..=p {
        let fitted: f64 = (i..p).map(|c| triangle[(i, c)] * theta[c]).sum();
        let e = triangle[(i, p)] - fitted;
        sum += e * e;
    }
    sum
}

/// Factors by drive and fold.
#[derive(Debug, Clone)]
pub struct Factors {
    /// [drive][fold], reflected.
    parts: Vec<Vec<Factor>>,
    /// By drive, all folds: most questions are about these.
    drives: Vec<Factor>,
    p: usize,
}

impl Factors {
    /// Visits all rows of a kind once.
    ///
    /// # Errors
    /// Loops that do not close along a recording.
    pub fn of(observation: &Observation<'_>, rows: Rows, progress: &mut dyn FnMut(f64)) -> Result<Self, InputError> {
        let p = observation.columns().len();
        let n_act = observation.robot().model.n_act();
        let mut parts = vec![vec![Factor::new(p); observation.n_folds()]; n_act];
        observation.each(
            rows,
            &mut |block| {
                for (k, folds) in parts.iter_mut().enumerate() {
                    for i in (0..block.len()).filter(|&i| block.is_active(k, i)) {
                        folds[block.fold[i]].push(block.row(k, i), block.target(k, i), block.effort(k, i));
                    }
                }
            },
            progress,
        )?;
        parts.iter_mut().flatten().for_each(Factor::reflect);
        Ok(Self { drives: parts.iter().map(|folds| joined(folds, p)).collect(), parts, p })
    }

    /// Number of parameters.
    #[must_use]
    pub fn n_columns(&self) -> usize {
        self.p
    }

    /// Number of drives.
    #[must_use]
    pub fn n_drives(&self) -> usize {
        self.parts.len()
    }

    /// The same rows with the effort of the parameters `known` taken off their targets.
    #[must_use]
    pub fn less(&self, known: &[f64]) -> Self {
        let mut out = self.clone();
        for part in out.parts.iter_mut().flatten().chain(&mut out.drives).filter(|part| part.count > 0) {
            for i in 0..part.p {
                let effort: f64 = (i..part.p).map(|c| part.rows[(i, c)] * known[c]).sum();
                part.rows[(i, part.p)] -= effort;
            }
        }
        out
    }

    /// Folds that have rows.
    #[must_use]
    pub fn used_folds(&self) -> Vec<usize> {
        let n = self.parts.first().map_or(0, Vec::len);
        (0..n).filter(|&f| self.parts.iter().any(|folds| folds[f].count() > 0)).collect()
    }

    /// All rows of one drive.
    #[must_use]
    pub fn drive(&self, k: usize) -> &Factor {
        &self.drives[k]
    }

    /// All rows of all drives, each drive's multiplied by its weight.
    #[must_use]
    pub fn weighted(&self, weights: &[f64]) -> Factor {
        let mut out = Factor::new(self.p);
        for (drive, w) in self.drives.iter().zip(weights).filter(|(drive, _)| drive.count() > 0) {
            out.absorb(drive, *w);
        }
        out
    }

    /// The same of the folds that are `wanted`.
    #[must_use]
    pub fn weighted_where(&self, weights: &[f64], wanted: &dyn Fn(usize) -> bool) -> Factor {
        let mut out = Factor::new(self.p);
        for (folds, w) in self.parts.iter().zip(weights) {
            for (_, part) in folds.iter().enumerate().filter(|(f, part)| part.count() > 0 && wanted(*f)) {
                out.absorb(part, *w);
            }
        }
        out
    }
}

/// All rows of several factors of `p` parameters, reflected.
fn joined(parts: &[Factor], p: usize) -> Factor {
    let mut out = Factor::new(p);
    parts.iter().filter(|part| part.count() > 0).for_each(|part| out.absorb(part, 1.0));
    out.reflect();
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_factor_of_many_rows_is_that_of_all_of_them() {
        let p = 4;
        let row = |i: usize| -> Vec<f64> { (0..p).map(|c| ((i * (3 * c + 7) + c) % 13) as f64 - 5.5).collect() };
        let target = |i: usize| (i % 7) as f64;
        let mut streamed = Factor::new(p);
        let mut all = Mat::zeros(200, p + 1);
        for i in 0..200 {
            streamed.push(&row(i), target(i), 2.0);
            row(i).iter().enumerate().for_each(|(c, x)| all[(i, c)] = *x);
            all[(i, p)] = target(i);
        }
        let (r, gram) = (streamed.triangle(), all.transpose() * &all);
        assert!((r.transpose() * &r - &gram).norm_max() < 1e-10 * gram.norm_max());
        let theta = [0.1, -0.2, 0.3, 0.4];
        let direct: f64 = (0..200).map(|i| target(i) - row(i).iter().zip(theta).map(|(w, t)| w * t).sum::<f64>()).map(|e| e * e).sum();
        assert!((streamed.error_square(&theta) - direct).abs() < 1e-9 * direct);
        assert_eq!((streamed.count(), streamed.effort_square()), (200, 800.0));
        let mut doubled = Factor::new(p);
        doubled.absorb(&streamed, 2.0);
        assert!((doubled.error_square(&theta) - 4.0 * direct).abs() < 1e-8 * direct);
        assert_eq!(doubled.count(), 200);
    }
}
