//! Sums of squares by Levenberg and Marquardt, with the gain-controlled damping of Nielsen \[Madsen2004, algorithm 3.16\]; derivatives by
//! central differences.

use faer::linalg::solvers::{Solve, SolveLstsq};
use faer::{Mat, Side};

use super::{Bounds, Ending};

/// When to stop, and how to take differences.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Steps, at most.
    pub iterations: usize,
    /// Step that is none any more, in units of the scales.
    pub step: f64,
    /// Share of the cost by which a step must be expected to lower it.
    pub cost: f64,
    /// Step of the differences, in units of the scales.
    pub difference: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { iterations: 100, step: 1e-8, cost: 1e-12, difference: 1e-4 }
    }
}

/// Where the search ended.
#[derive(Debug, Clone)]
pub struct Squares {
    /// The best parameters.
    pub x: Vec<f64>,
    /// Residuals there.
    pub residual: Vec<f64>,
    /// Half their sum of squares.
    pub cost: f64,
    /// Derivatives of the residuals there, per unit of each parameter; residuals × parameters.
    pub jacobian: Mat<f64>,
    /// Steps taken, refused ones included.
    pub iterations: usize,
    /// Evaluations of the residuals.
    pub evaluations: usize,
    /// How it ended.
    pub ending: Ending,
}

/// Minimises half the sum of squares of `residual` from `start`; `scales` are the sizes by which parameters matter. A residual of `None`
/// is infinitely bad. `bounds` are one per parameter, or none at all.
///
/// # Panics
/// When `scales`, or `bounds` that are not empty, are not one per parameter.
pub fn levenberg_marquardt(
    residual: &mut dyn FnMut(&[f64]) -> Option<Vec<f64>>,
    start: &[f64],
    scales: &[f64],
    bounds: &[Bounds],
    options: &Options,
) -> Squares {
    let n = start.len();
    assert!(scales.len() == n && (bounds.is_empty() || bounds.len() == n), "one scale and one pair of bounds per parameter");
    let mut search = Search { residual, scales, bounds, options, evaluations: 0 };
    let x: Vec<f64> = (0..n).map(|k| search.clamped(k, start[k])).collect();
    let mut out = Squares {
        jacobian: Mat::zeros(0, n),
        x,
        residual: Vec::new(),
        cost: f64::INFINITY,
        iterations: 0,
        evaluations: 0,
        ending: Ending::NoStart,
    };
    if let Some(e) = search.evaluate(&out.x) {
        (out.cost, out.residual) = (half_square(&e), e);
        search.descend(&mut out);
    }
    out.evaluations = search.evaluations;
    out
}

fn half_square(e: &[f64]) -> f64 {
    0.5 * e.iter().map(|e| e * e).sum::<f64>()
}

struct Search<'s> {
    residual: &'s mut dyn FnMut(&[f64]) -> Option<Vec<f64>>,
    scales: &'s [f64],
    bounds: &'s [Bounds],
    options: &'s Options,
    evaluations: usize,
}

impl Search<'_> {
    fn clamped(&self, k: usize, x: f64) -> f64 {
        self.bounds.get(k).map_or(x, |b| b.clamp(x))
    }

    fn evaluate(&mut self, x: &[f64]) -> Option<Vec<f64>> {
        self.evaluations += 1;
        (self.residual)(x).filter(|e| e.iter().all(|e| e.is_finite()))
    }

    /// Derivatives per scale; one-sided where a bound or a failure is in the way, zero where both sides fail.
    fn jacobian(&mut self, x: &[f64], here: &[f64]) -> Mat<f64> {
        let mut out = Mat::zeros(here.len(), x.len());
        for k in 0..x.len() {
            let h = self.options.difference * self.scales[k];
            let mut side = |sign: f64| {
                let mut there = x.to_vec();
                there[k] = self.clamped(k, x[k] + sign * h);
                let e = if there[k].to_bits() == x[k].to_bits() { None } else { self.evaluate(&there) };
                e.filter(|e| e.len() == here.len()).map(|e| (there[k], e))
            };
            let (low, high) = (side(-1.0), side(1.0));
            let here = (x[k], here.to_vec());
            let (low, high) = (low.unwrap_or_else(|| here.clone()), high.unwrap_or(here));
            let width = (high.0 - low.0) / self.scales[k];
            if width > 0.0 {
                for (i, (b, a)) in high.1.iter().zip(&low.1).enumerate() {
                    out[(i, k)] = (b - a) / width;
                }
            }
        }
        out
    }

    /// The derivatives without those of parameters that would leave their bounds downhill: they stay, and the others find their way.
    fn free_columns(&self, scaled: &Mat<f64>, gradient: &Mat<f64>, x: &[f64]) -> Mat<f64> {
        let is_held = |k: usize| {
            let Some(b) = self.bounds.get(k) else { return false };
            (x[k] <= b.lower && gradient[(k, 0)] > 0.0) || (x[k] >= b.upper && gradient[(k, 0)] < 0.0)
        };
        Mat::from_fn(scaled.nrows(), scaled.ncols(), |i, k| if is_held(k) { 0.0 } else { scaled[(i, k)] })
    }

    fn descend(&mut self, out: &mut Squares) {
        let n = out.x.len();
        let mut scaled = self.jacobian(&out.x, &out.residual);
        let top = (0..n).map(|k| scaled.col(k).squared_norm_l2()).fold(0.0, f64::max);
        let (mut damping, mut growth) = (1e-3 * top.max(f64::MIN_POSITIVE), 2.0);
        out.ending = Ending::OutOfBudget;
        while out.iterations < self.options.iterations {
            out.iterations += 1;
            let e = Mat::from_fn(out.residual.len(), 1, |i, _| out.residual[i]);
            let gradient = scaled.transpose() * &e;
            let free = self.free_columns(&scaled, &gradient, &out.x);
            let step = damped_step(&free, &e, damping);
            let there: Vec<f64> = (0..n).map(|k| self.clamped(k, out.x[k] + self.scales[k] * step[(k, 0)])).collect();
            // What is left of the step inside the bounds.
            let step = Mat::from_fn(n, 1, |k, _| (there[k] - out.x[k]) / self.scales[k]);
            let foretold = -(step.transpose() * &gradient)[(0, 0)] - 0.5 * (&scaled * &step).squared_norm_l2();
            if step.norm_max() <= self.options.step || foretold.abs() <= self.options.cost * out.cost {
                out.ending = Ending::Settled;
                break;
            }
            let found = self.evaluate(&there);
            let cost = found.as_ref().map_or(f64::INFINITY, |e| half_square(e));
            let gain = (out.cost - cost) / foretold;
            if let Some(e) = found.filter(|_| cost < out.cost) {
                (out.x, out.residual, out.cost) = (there, e, cost);
                scaled = self.jacobian(&out.x, &out.residual);
                let bent = 2.0 * gain - 1.0;
                damping *= (1.0 - bent * bent * bent).max(1.0 / 3.0);
                growth = 2.0;
            } else {
                damping *= growth;
                growth *= 2.0;
            }
        }
        out.jacobian = Mat::from_fn(scaled.nrows(), n, |i, k| scaled[(i, k)] / self.scales[k]);
    }
}

/// The step that minimises `½·‖e + J·s‖² + ½·damping·‖s‖²`, from the stacked rows and not from the normal equations.
fn damped_step(jacobian: &Mat<f64>, e: &Mat<f64>, damping: f64) -> Mat<f64> {
    let (m, n) = (jacobian.nrows(), jacobian.ncols());
    let soft = damping.sqrt();
    let rows = Mat::from_fn(m + n, n, |i, j| if i < m { jacobian[(i, j)] } else { soft * f64::from(u8::from(i - m == j)) });
    let target = Mat::from_fn(m + n, 1, |i, _| if i < m { -e[(i, 0)] } else { 0.0 });
    rows.qr().solve_lstsq(&target).subrows(0, n).to_owned()
}

/// Inverse of `JᵀJ` of residuals in units of their noise: the covariance of the parameters. `None` when some combination of the parameters
/// leaves the residuals alone.
#[must_use]
pub fn covariance(jacobian: &Mat<f64>) -> Option<Mat<f64>> {
    let n = jacobian.ncols();
    let lengths: Vec<f64> = (0..n).map(|k| jacobian.col(k).norm_l2()).collect();
    if lengths.iter().any(|l| l.is_nan() || *l <= 0.0) {
        return None;
    }
    let scaled = Mat::from_fn(jacobian.nrows(), n, |i, k| jacobian[(i, k)] / lengths[k]);
    let gram = scaled.transpose() * &scaled;
    let inverse = gram.llt(Side::Lower).ok()?.solve(Mat::<f64>::identity(n, n));
    Some(Mat::from_fn(n, n, |i, j| inverse[(i, j)] / (lengths[i] * lengths[j])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_covariance_of_a_line_is_that_of_the_normal_equations() {
        // y = a + b·t at t = 0..9: JᵀJ = [10 45; 45 285], inverse by hand.
        let mut line = |x: &[f64]| Some((0..10).map(|t| x[0] + x[1] * f64::from(t) - 3.0).collect());
        let out = levenberg_marquardt(&mut line, &[0.0, 1.0], &[1.0; 2], &[], &Options::default());
        let c = covariance(&out.jacobian).unwrap();
        let determinant = 10.0 * 285.0 - 45.0 * 45.0;
        assert!((c[(0, 0)] - 285.0 / determinant).abs() < 1e-8 && (c[(0, 1)] + 45.0 / determinant).abs() < 1e-8);
        assert!((out.x[0] - 3.0).abs() < 1e-8 && out.x[1].abs() < 1e-8);
        // Two parameters that act as one have no covariance.
        let mut twin = |x: &[f64]| Some((0..10).map(|t| (x[0] + x[1]) * f64::from(t) - 3.0).collect());
        let out = levenberg_marquardt(&mut twin, &[0.0, 1.0], &[1.0; 2], &[], &Options::default());
        assert!(covariance(&out.jacobian).is_none_or(|c| c[(0, 0)] > 1e6));
    }

    #[test]
    fn a_residual_that_cannot_be_computed_is_stepped_back_from() {
        let mut edge = |x: &[f64]| (x[0] < 1.2).then(|| vec![x[0] * x[0] * x[0] - 1.0, 0.1 * x[0]]);
        let out = levenberg_marquardt(&mut edge, &[0.3], &[1.0], &[], &Options::default());
        assert!(out.ending == Ending::Settled && (out.x[0] - 1.0).abs() < 0.01, "{out:?}");
        let nothing = levenberg_marquardt(&mut |_| None, &[0.3], &[1.0], &[], &Options::default());
        assert_eq!(nothing.ending, Ending::NoStart);
    }
}
