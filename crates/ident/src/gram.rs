//! Normal equations without the observation matrix: `WᵀW`, `Wᵀτ` and `τᵀτ` of the rows as they come.
//!
//! A minute at 1 kHz of six drives and six bodies is 173 MB of observation matrix and 30 kB of these. For estimates that need ranks or
//! carry noise through, [`crate::factor::Factor`] is the better summary: its condition is not squared.

use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::{Accum, Mat, Par};
use nalgebra::DMatrix;
use pkm_dyn::parameters::N_INERTIAL;
use pkm_dyn::{Data, Model};

/// Rows that are gathered before they are multiplied: 60 columns of them stay in the second cache.
const GATHERED: usize = 128;

/// Rows of one coordinate: the columns that can act there, and the target after them.
#[derive(Debug, Clone)]
struct Rows {
    columns: Vec<usize>,
    /// A column per row, so that a row is written in one stretch.
    gathered: Mat<f64>,
    filled: usize,
    /// Lower triangle of the product so far.
    product: Mat<f64>,
}

impl Rows {
    fn new(columns: Vec<usize>) -> Self {
        let n = columns.len() + 1;
        Self { columns, gathered: Mat::zeros(n, GATHERED), filled: 0, product: Mat::zeros(n, n) }
    }

    fn push(&mut self, regressor: impl Fn(usize) -> f64, tau: f64) {
        let row = self.gathered.col_as_slice_mut(self.filled);
        row.iter_mut().zip(&self.columns).for_each(|(x, &c)| *x = regressor(c));
        row[self.columns.len()] = tau;
        self.filled += 1;
        if self.filled == GATHERED {
            self.multiply();
        }
    }

    fn multiply(&mut self) {
        let rows = self.gathered.subcols(0, self.filled);
        let (lower, full) = (BlockStructure::TriangularLower, BlockStructure::Rectangular);
        matmul(&mut self.product, lower, Accum::Add, rows, full, rows.transpose(), full, 1.0, Par::Seq);
        self.filled = 0;
    }
}

/// What the rows pushed so far come to.
#[derive(Debug, Clone, PartialEq)]
pub struct Products {
    /// `WᵀW`, symmetric, `10·bodies` square.
    pub w_w: Mat<f64>,
    /// `Wᵀτ`.
    pub w_tau: Vec<f64>,
    /// `τᵀτ`.
    pub tau_tau: f64,
    /// Rows: samples times independent coordinates.
    pub rows: usize,
}

/// The sum of products of regressors and efforts.
#[derive(Debug, Clone)]
pub struct Gram {
    each: Vec<Rows>,
    n: usize,
    rows: usize,
}

impl Gram {
    /// Of no rows, for regressors of [`pkm_dyn::inverse_dynamics::actuated_regressor`].
    #[must_use]
    pub fn new(model: &Model) -> Self {
        let n = N_INERTIAL * model.nv();
        // In an open chain a drive feels the bodies that it carries; through loops it may feel all.
        let is_open = !model.is_constrained() && model.passive().is_empty();
        let acts = |j: usize, body: usize| !is_open || model.supports(j, Some(body));
        let columns = |j: usize| (0..n).filter(|c| acts(j, c / N_INERTIAL)).collect();
        Self { each: Data::new(model).independent.iter().map(|&j| Rows::new(columns(j))).collect(), n, rows: 0 }
    }

    /// Adds one sample as [`Gram::push`] does, its regressor row by row.
    ///
    /// # Panics
    /// As there.
    pub fn push_rows(&mut self, regressor: &[f64], tau: &[f64]) {
        assert!(regressor.len() == self.each.len() * self.n && tau.len() == self.each.len(), "one row per coordinate");
        for (k, (rows, tau)) in self.each.iter_mut().zip(tau).enumerate() {
            let row = &regressor[k * self.n..(k + 1) * self.n];
            rows.push(|c| row[c], *tau);
        }
        self.rows += self.each.len();
    }

    /// Adds one sample: its regressor, independent × 10·bodies, and the efforts of the independent coordinates `[N | N·m]`.
    ///
    /// # Panics
    /// With a regressor or efforts of another robot.
    pub fn push(&mut self, regressor: &DMatrix<f64>, tau: &[f64]) {
        assert!(regressor.shape() == (self.each.len(), self.n) && tau.len() == self.each.len(), "one row per coordinate");
        for (k, (rows, tau)) in self.each.iter_mut().zip(tau).enumerate() {
            rows.push(|c| regressor[(k, c)], *tau);
        }
        self.rows += self.each.len();
    }

    /// Adds all rows of another sum of the same robot.
    pub fn absorb(&mut self, mut other: Self) {
        for (own, rows) in self.each.iter_mut().zip(&mut other.each) {
            rows.multiply();
            own.product += &rows.product;
        }
        self.rows += other.rows;
    }

    /// The products of all rows so far.
    #[must_use]
    pub fn products(mut self) -> Products {
        let mut out = Products { w_w: Mat::zeros(self.n, self.n), w_tau: vec![0.0; self.n], tau_tau: 0.0, rows: self.rows };
        for rows in &mut self.each {
            rows.multiply();
            let (product, last) = (&rows.product, rows.columns.len());
            for (j, &c) in rows.columns.iter().enumerate() {
                out.w_tau[c] += product[(last, j)];
                for (i, &r) in rows.columns.iter().enumerate().skip(j) {
                    out.w_w[(r, c)] += product[(i, j)];
                    if i > j {
                        out.w_w[(c, r)] += product[(i, j)];
                    }
                }
            }
            out.tau_tau += product[(last, last)];
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_dyn::inverse_dynamics::{actuated_regressor, closed_loop_motion};
    use pkm_dyn::loops::{assemble, mid_pose, walk_to};
    use pkm_dyn::math;

    #[test]
    fn products_of_streamed_rows_are_those_of_the_whole_matrix() {
        for name in ["serial_arm", "five_bar"] {
            let found = pkm_robots::find(name).unwrap();
            let model = pkm_dyn::urdf::parse(found.toml, found.urdf, [found.toml_name, found.urdf_name]).unwrap().robot.model;
            let mut data = Data::new(&model);
            let (centre, n) = (mid_pose(&model), N_INERTIAL * model.nv());
            assert!(assemble(&model, &mut data).is_closed && walk_to(&model, &mut data, &centre).is_closed);
            let mut parts = [Gram::new(&model), Gram::new(&model)];
            let (mut rows, mut efforts) = (Vec::new(), Vec::new());
            for i in 0..300 {
                let wave = |size: f64, k: usize| size * math::sin(0.05 * (i * (k + 2)) as f64 + k as f64);
                let at = |size: f64| (0..model.n_act()).map(|k| wave(size, k)).collect::<Vec<_>>();
                let q: Vec<f64> = centre.iter().zip(at(0.05)).map(|(c, x)| c + x).collect();
                assert!(closed_loop_motion(&model, &mut data, &q, &at(1.0), &at(3.0)).is_closed);
                let (w, tau) = (actuated_regressor(&model, &mut data).clone(), at(7.0));
                // Both ways of handing a regressor over.
                if i % 2 == 0 {
                    parts[usize::from(i >= 170)].push(&w, &tau);
                } else {
                    parts[usize::from(i >= 170)].push_rows(w.transpose().as_slice(), &tau);
                }
                for (k, effort) in tau.iter().enumerate() {
                    rows.push(w.row(k).iter().copied().collect::<Vec<_>>());
                    efforts.push(*effort);
                }
            }
            let [mut all, rest] = parts;
            all.absorb(rest);
            let found = all.products();
            let whole = Mat::from_fn(rows.len(), n, |i, j| rows[i][j]);
            let target = Mat::from_fn(rows.len(), 1, |i, _| efforts[i]);
            let (w_w, w_tau) = (whole.transpose() * &whole, whole.transpose() * &target);
            assert!((&found.w_w - &w_w).norm_max() < 1e-12 * w_w.norm_max(), "{name}");
            assert!((0..n).all(|j| (found.w_tau[j] - w_tau[(j, 0)]).abs() < 1e-12 * w_tau.norm_max()), "{name}");
            assert!((found.tau_tau - target.squared_norm_l2()).abs() < 1e-12 * found.tau_tau);
            assert_eq!(found.rows, rows.len());
        }
    }
}
