//! Relevant parameters: base parameters that the recordings do not determine are dropped, one by one, the worst first.
//!
//! A badly determined parameter fits noise, moves the well determined ones with it, and is what makes an estimate unphysical
//! \[Diaz2010\]. After every step the rest is estimated anew; the reduction ends when every parameter that is left is significant and
//! some physical robot has these values (the exact matrix inequality, not a scan over masses as in [Valera2017, eq. 9]). Where physics is
//! missing none may have them: significant parameters are dropped for that only as long as the fit does not suffer.

use faer::Mat;

use crate::columns::Columns;
use crate::estimate::feasible::{Space, margin};
use crate::estimate::least_squares;
use crate::estimate::weighted::scatter;
use crate::factor::Factors;
use crate::grouping::BaseSet;
use crate::statistics::Sandwich;

/// Relative standard deviation above which the 95 % interval of a parameter holds zero.
const SIGNIFICANT: f64 = 0.5;

/// Significant parameters are dropped for the sake of feasibility until the fitted residual has grown by this factor.
const GROWTH: f64 = 1.02;

/// One step of the reduction.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Step {
    /// Parameters that are left.
    pub parameters: usize,
    /// What was dropped to get here; empty at the start.
    pub dropped: String,
    /// Largest relative standard deviation of those left.
    pub worst_relative_sd: f64,
    /// Root mean square of the fitted residual in units of the drives' noise.
    pub fitted: f64,
    /// Held-out error: root mean square over the drives of error over effort.
    pub heldout: f64,
    /// Whether some physical robot has these values.
    pub is_feasible: bool,
}

/// What a reduction needs.
pub(crate) struct Reduction<'a> {
    pub(crate) columns: &'a Columns,
    /// Fitted rows, the fixed parameters' effort taken off.
    pub(crate) factors: &'a Factors,
    /// Held-out rows as they are.
    pub(crate) judged: &'a Factors,
    pub(crate) set: &'a BaseSet,
    pub(crate) sandwich: &'a Sandwich,
    pub(crate) space: &'a Space,
    /// Values of the parameters that are not estimated, zero for the others.
    pub(crate) fixed: &'a [f64],
    pub(crate) noise: &'a [f64],
}

impl Reduction<'_> {
    /// All steps, the places (among the set's kept columns) that are left, and the parameters of the last step.
    pub(crate) fn run(&self) -> (Vec<Step>, Vec<usize>, Vec<f64>) {
        let weights: Vec<f64> = self.noise.iter().map(|s| 1.0 / s).collect();
        let factor = self.factors.weighted(&weights);
        let (triangle, rows) = (factor.triangle(), factor.count().max(1));
        let mut places: Vec<usize> = (0..self.set.rank()).collect();
        let (mut steps, mut dropped) = (Vec::new(), String::new());
        // The first step at which all that is left is significant, should no later one be feasible.
        let mut significant: Option<(usize, Vec<usize>, Vec<f64>)> = None;
        loop {
            let kept: Vec<usize> = places.iter().map(|&i| self.set.kept[i]).collect();
            let values = least_squares::ordinary(&triangle, &kept);
            let mut theta = scatter(&values, &kept, self.columns.len());
            let error = crate::factor::squared_error(&triangle, &theta) / rows as f64;
            theta.iter_mut().zip(self.fixed).for_each(|(x, f)| *x += f);
            let relative = self.relative_deviations(&places, &values);
            let worst = (0..places.len()).max_by(|&a, &b| relative[a].total_cmp(&relative[b])).unwrap_or(0);
            let is_feasible = margin(self.space, &self.combinations(&places), &values).is_some_and(|t| t > 0.0);
            steps.push(Step {
                parameters: places.len(),
                dropped,
                worst_relative_sd: relative[worst],
                fitted: error.sqrt(),
                heldout: self.heldout(&theta),
                is_feasible,
            });
            if relative[worst] <= SIGNIFICANT && is_feasible {
                return (steps, places, theta);
            }
            if relative[worst] <= SIGNIFICANT && significant.is_none() {
                significant = Some((steps.len(), places.clone(), theta.clone()));
            }
            if let Some((n, places, theta)) =
                significant.take_if(|(n, ..)| error.sqrt() > GROWTH * steps[*n - 1].fitted || places.len() == 1)
            {
                steps.truncate(n);
                return (steps, places, theta);
            }
            if places.len() == 1 {
                return (steps, places, theta);
            }
            dropped = self.columns.list[self.set.kept[places[worst]]].name.clone();
            places.remove(worst);
        }
    }

    fn relative_deviations(&self, places: &[usize], values: &[f64]) -> Vec<f64> {
        let Some(covariance) = self.sandwich.covariance(places) else { return vec![f64::MAX; values.len()] };
        let relative = |i: usize| covariance[(i, i)].max(0.0).sqrt() / values[i].abs().max(f64::MIN_POSITIVE);
        (0..values.len()).map(|i| relative(i).min(f64::MAX)).collect()
    }

    /// The base parameters that are left, as combinations of all parameters.
    fn combinations(&self, places: &[usize]) -> Mat<f64> {
        let mut out = Mat::zeros(places.len(), self.columns.len());
        for (row, &i) in places.iter().enumerate() {
            out[(row, self.set.kept[i])] = 1.0;
            for (j, &e) in self.set.eliminated.iter().enumerate() {
                out[(row, e)] = self.set.grouping[(i, j)];
            }
        }
        out
    }

    fn heldout(&self, theta: &[f64]) -> f64 {
        let share = |k: usize| {
            let drive = self.judged.drive(k);
            if drive.effort_square() > 0.0 { drive.error_square(theta) / drive.effort_square() } else { 0.0 }
        };
        let n = self.judged.n_drives();
        ((0..n).map(share).sum::<f64>() / n.max(1) as f64).sqrt()
    }
}
