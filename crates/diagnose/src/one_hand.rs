//! Do drives that scatter do so together, as a force on one link makes them, or each on its own, as amplifiers do?
//!
//! One force F at a point is felt by all drives at once, y = A F with the lever A of that point, so products of two drives' scatter follow
//! A C Aᵀ with the force's covariance C. C is fitted by least squares, and how much of y yᵀ it explains is compared with null runs in which the
//! sign of every excursion between two zeros is drawn anew for every drive: each keeps its size, its place in the motion and its memory, and
//! loses what it had in common with the others.

use nalgebra::{DMatrix, Matrix6, Vector3, Vector6};
use pkm_dyn::math;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Direction pairs of a symmetric 3x3 matrix.
const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

/// Share of the largest eigenvalue below which drives do not feel a direction of the covariance.
const FELT: f64 = 1e-9;

/// The scatter of the drives, in truth and in null runs, and what forces at some points explain of it.
pub(crate) struct Together<'a> {
    /// [drive][row]
    scatter: &'a [Vec<f64>],
    /// [run][drive][row]; of the first run, the truth, all are positive.
    is_flipped: Vec<Vec<Vec<bool>>>,
    /// Per point: products of the six unit covariances with each other, and per run with the scatter's.
    points: Vec<(Matrix6<f64>, Vec<Vector6<f64>>)>,
}

impl<'a> Together<'a> {
    /// From the scatter of all drives, `[drive][row]`, cut at the rows `starts`, in order, where others begin that do not follow on those before.
    pub(crate) fn new(scatter: &'a [Vec<f64>], starts: &[usize], points: usize, (runs, seed): (usize, u64)) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let truth = scatter.iter().map(|y| vec![false; y.len()]).collect();
        let drawn = (0..runs).map(|_| scatter.iter().map(|y| flips(y, starts, &mut rng)).collect());
        let is_flipped: Vec<_> = core::iter::once(truth).chain(drawn).collect();
        let points = vec![(Matrix6::zeros(), vec![Vector6::zeros(); is_flipped.len()]); points];
        Self { scatter, is_flipped, points }
    }

    /// Adds a row, with the lever of the force at a point: drives x 3.
    pub(crate) fn add(&mut self, row: usize, point: usize, lever: &DMatrix<f64>) {
        let (own, with) = &mut self.points[point];
        let square = lever.transpose() * lever;
        for (p, &(i, j)) in PAIRS.iter().enumerate() {
            for (q, &(k, l)) in PAIRS.iter().enumerate() {
                // tr(E M E' M), where a unit covariance beside the diagonal is a sum of two.
                let once = square[(j, k)] * square[(l, i)] + square[(j, l)] * square[(k, i)];
                own[(p, q)] += once * if i == j { 0.5 } else { 1.0 } * if k == l { 1.0 } else { 2.0 };
            }
        }
        for (with, is_flipped) in with.iter_mut().zip(&self.is_flipped) {
            let mut felt = Vector3::zeros();
            for (k, y) in self.scatter.iter().enumerate() {
                let y = if is_flipped[k][row] { -y[row] } else { y[row] };
                felt += lever.fixed_columns::<3>(0).row(k).transpose() * y;
            }
            for (p, &(i, j)) in PAIRS.iter().enumerate() {
                with[p] += felt[i] * felt[j] * if i == j { 1.0 } else { 2.0 };
            }
        }
    }

    /// Share of runs, the truth among them, in which a force at the best of the points stands out as far as in truth. A point stands out of what it explains
    /// in all runs: one that few drives feel explains much of them, and the same in each.
    pub(crate) fn chance(&self) -> f64 {
        let runs = self.is_flipped.len();
        let mut best = vec![0.0_f64; runs];
        for (own, with) in &self.points {
            let inverse = pseudo_inverse(own);
            let explained: Vec<f64> = with.iter().map(|w| w.dot(&(inverse * w))).collect();
            let mean = explained.iter().sum::<f64>() / runs as f64;
            let spread = math::sqrt(explained.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / runs as f64);
            // What no sign changes says nothing; rounding is no spread.
            if spread > 1e-9 * mean {
                best.iter_mut().zip(&explained).for_each(|(best, x)| *best = best.max((x - mean) / spread));
            }
        }
        best.iter().filter(|x| **x >= best[0]).count() as f64 / runs as f64
    }
}

/// A sign for every excursion between two zeros.
fn flips(y: &[f64], starts: &[usize], rng: &mut ChaCha8Rng) -> Vec<bool> {
    let mut out = Vec::with_capacity(y.len());
    let mut is_flipped = false;
    for (i, x) in y.iter().enumerate() {
        if i == 0 || starts.binary_search(&i).is_ok() || (*x < 0.0) != (y[i - 1] < 0.0) {
            is_flipped = rng.random::<bool>();
        }
        out.push(is_flipped);
    }
    out
}

fn pseudo_inverse(a: &Matrix6<f64>) -> Matrix6<f64> {
    let eigen = a.symmetric_eigen();
    let most = eigen.eigenvalues.max();
    let inverse = eigen.eigenvalues.map(|x| if x > FELT * most && x > 0.0 { 1.0 / x } else { 0.0 });
    eigen.eigenvectors * Matrix6::from_diagonal(&inverse) * eigen.eigenvectors.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: usize = 1200;

    /// Slow noise with a memory of twenty rows.
    fn wandering(rng: &mut ChaCha8Rng) -> Vec<f64> {
        let mut x = 0.0;
        let mut next = || {
            // The sum of twelve uniform numbers is as good as normal.
            let white: f64 = (0..12).map(|_| rng.random::<f64>() - 0.5).sum();
            x = 0.95 * x + math::sqrt(1.0 - 0.95 * 0.95) * white;
            x
        };
        (0..ROWS).map(|_| next()).collect()
    }

    /// Levers of a point on an arm of two drives in a plane, as it swings, and of one that only the first drive feels.
    fn levers(row: usize) -> [DMatrix<f64>; 2] {
        let [a, b] = [0.6, 0.9].map(|rate| math::sin(rate * row as f64 / 40.0));
        let outer = [-math::sin(a + b), math::cos(a + b)];
        let whole = [outer[0] - math::sin(a), outer[1] + math::cos(a)];
        [
            DMatrix::from_row_slice(2, 3, &[whole[0], whole[1], 0.0, outer[0], outer[1], 0.0]),
            DMatrix::from_row_slice(2, 3, &[-math::sin(a), math::cos(a), 0.0, 0.0, 0.0, 0.0]),
        ]
    }

    fn chance_of(scatter: &[Vec<f64>]) -> f64 {
        let mut together = Together::new(scatter, &[ROWS / 2], 2, (199, 1));
        for row in 0..ROWS {
            levers(row).iter().enumerate().for_each(|(point, lever)| together.add(row, point, lever));
        }
        together.chance()
    }

    #[test]
    fn a_force_at_the_end_of_an_arm_is_told_from_drives_that_scatter_alone() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        for run in 0..5 {
            let force = [wandering(&mut rng), wandering(&mut rng)];
            let felt = |drive: usize| {
                let noise = wandering(&mut rng);
                (0..ROWS).map(|i| (0..2).map(|k| levers(i)[0][(drive, k)] * force[k][i]).sum::<f64>() + 0.3 * noise[i]).collect()
            };
            let scatter: Vec<Vec<f64>> = [0, 1].map(felt).into();
            let p = chance_of(&scatter);
            assert!(p <= 0.01, "run {run}: {p}");
        }
    }

    #[test]
    fn drives_that_scatter_alone_are_hardly_ever_called_one_force() {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        // Loud at the same instants, as friction at reversals is: that alone is nothing in common.
        let loud = |i: usize| 1.0 + 0.9 * math::sin(i as f64 / 30.0);
        let mut each = || -> Vec<f64> { wandering(&mut rng).iter().enumerate().map(|(i, x)| loud(i) * x).collect() };
        let p: Vec<f64> = (0..60).map(|_| chance_of(&[each(), each()])).collect();
        // Of sixty, 5 % or fewer in two runs would be three or fewer; more than eight are chance once in a hundred times.
        assert!(p.iter().filter(|p| **p <= 0.05).count() <= 8, "{p:?}");
        assert!(p.iter().filter(|p| **p > 0.5).count() >= 15, "{p:?}");
    }

    #[test]
    fn one_drive_says_nothing() {
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let p = chance_of(&[wandering(&mut rng), vec![0.0; ROWS]]);
        assert!((p - 1.0).abs() < 1e-12, "{p}");
    }
}
