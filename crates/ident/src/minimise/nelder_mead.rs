//! The simplex of Nelder and Mead \[Nelder1965\], with the adaptive coefficients of Gao and Han \[Gao2012\]: no derivatives, so that the
//! ripple that friction and event handling put on a simulation's cost does no harm.

use super::{Bounds, Ending};

/// Share of the first cost that is nothing any more.
const NOTHING: f64 = 1e-8;

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Evaluations, at most.
    pub evaluations: usize,
    /// Largest extent of the settled simplex, in units of the first step.
    pub step: f64,
    /// Largest difference of costs over the settled simplex, as a share of the lowest.
    pub cost: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { evaluations: 2000, step: 1e-6, cost: 1e-10 }
    }
}

/// Where the search ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Minimum {
    /// The best parameters.
    pub x: Vec<f64>,
    /// Their cost.
    pub cost: f64,
    /// Evaluations.
    pub evaluations: usize,
    /// How it ended.
    pub ending: Ending,
}

/// Minimises `cost` from `start`; the first simplex has one corner a step of `steps` away along every axis. Corners are moved into
/// `bounds` (one per parameter, or none at all).
///
/// # Panics
/// When `steps`, or `bounds` that are not empty, are not one per parameter.
pub fn nelder_mead(cost: &mut dyn FnMut(&[f64]) -> f64, start: &[f64], steps: &[f64], bounds: &[Bounds], options: &Options) -> Minimum {
    let n = start.len();
    assert!(steps.len() == n && (bounds.is_empty() || bounds.len() == n), "one step and one pair of bounds per parameter");
    let mut search = Simplex { cost, bounds, corners: Vec::new(), first: 0.0, evaluations: 0 };
    search.add(start.to_vec());
    search.first = if search.corners[0].0.is_finite() { search.corners[0].0.abs() } else { 0.0 };
    for (k, step) in steps.iter().enumerate() {
        let mut x = search.corners[0].1.clone();
        let there = x[k] + step;
        // A step that a bound swallows goes the other way.
        x[k] = if search.clamped(k, there).to_bits() == x[k].to_bits() { x[k] - step } else { there };
        search.add(x);
    }
    if !search.corners[0].0.is_finite() && search.corners.iter().all(|c| !c.0.is_finite()) {
        return Minimum { x: start.to_vec(), cost: f64::INFINITY, evaluations: search.evaluations, ending: Ending::NoStart };
    }
    let mut ending = Ending::OutOfBudget;
    while search.evaluations < options.evaluations {
        search.corners.sort_by(|a, b| a.0.total_cmp(&b.0));
        if search.is_settled(steps, options) {
            ending = Ending::Settled;
            break;
        }
        search.advance();
    }
    search.corners.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (cost, x) = search.corners.swap_remove(0);
    Minimum { x, cost, evaluations: search.evaluations, ending }
}

struct Simplex<'s> {
    cost: &'s mut dyn FnMut(&[f64]) -> f64,
    bounds: &'s [Bounds],
    /// Costs and corners.
    corners: Vec<(f64, Vec<f64>)>,
    /// Cost at the start, where it has one.
    first: f64,
    evaluations: usize,
}

impl Simplex<'_> {
    fn clamped(&self, k: usize, x: f64) -> f64 {
        self.bounds.get(k).map_or(x, |b| b.clamp(x))
    }

    fn evaluate(&mut self, mut x: Vec<f64>) -> (f64, Vec<f64>) {
        for (k, x) in x.iter_mut().enumerate() {
            *x = self.clamped(k, *x);
        }
        self.evaluations += 1;
        let cost = (self.cost)(&x);
        (if cost.is_nan() { f64::INFINITY } else { cost }, x)
    }

    fn add(&mut self, x: Vec<f64>) {
        let corner = self.evaluate(x);
        self.corners.push(corner);
    }

    fn is_settled(&self, steps: &[f64], options: &Options) -> bool {
        let (low, best) = &self.corners[0];
        let reach = |x: &Vec<f64>| x.iter().zip(best).zip(steps).map(|((a, b), s)| ((a - b) / s).abs()).fold(0.0, f64::max);
        let extent = self.corners.iter().map(|c| reach(&c.1)).fold(0.0, f64::max);
        let spread = self.corners[self.corners.len() - 1].0 - low;
        // A cost that falls to zero has no share of itself left: then a tiny share of the first one counts.
        extent <= options.step && spread <= options.cost * low.abs().max(NOTHING * self.first)
    }

    /// One step with sorted corners: reflect the worst one, and expand, contract or shrink as that turns out.
    fn advance(&mut self) {
        let n = self.corners.len() - 1;
        let size = n as f64;
        // Gao and Han's coefficients; those of Nelder and Mead for n = 2.
        let (expand, contract, shrink) = (1.0 + 2.0 / size, (0.75 - 0.5 / size).max(0.25), (1.0 - 1.0 / size).max(0.5));
        let mean: Vec<f64> = (0..n).map(|k| self.corners[..n].iter().map(|c| c.1[k]).sum::<f64>() / size).collect();
        let worst = self.corners[n].clone();
        let along = |factor: f64| -> Vec<f64> { (0..n).map(|k| mean[k] + factor * (mean[k] - worst.1[k])).collect() };
        let reflected = self.evaluate(along(1.0));
        let next = if reflected.0 < self.corners[0].0 {
            let expanded = self.evaluate(along(expand));
            Some(if expanded.0 < reflected.0 { expanded } else { reflected })
        } else if reflected.0 < self.corners[n - 1].0 {
            Some(reflected)
        } else {
            let inside = reflected.0 >= worst.0;
            let limit = worst.0.min(reflected.0);
            let contracted = self.evaluate(along(if inside { -contract } else { contract }));
            (contracted.0 < limit || (!inside && contracted.0 <= limit)).then_some(contracted)
        };
        if let Some(corner) = next {
            self.corners[n] = corner;
            return;
        }
        for i in 1..=n {
            let x = (0..n).map(|k| self.corners[0].1[k] + shrink * (self.corners[i].1[k] - self.corners[0].1[k])).collect();
            self.corners[i] = self.evaluate(x);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rosenbrock(x: &[f64]) -> f64 {
        x.windows(2).map(|w| 100.0 * (w[1] - w[0] * w[0]) * (w[1] - w[0] * w[0]) + (1.0 - w[0]) * (1.0 - w[0])).sum()
    }

    #[test]
    fn the_bottom_of_a_bent_valley_is_found() {
        for n in [2, 4] {
            let start = vec![-1.2; n];
            let out = nelder_mead(&mut |x| rosenbrock(x), &start, &vec![0.5; n], &[], &Options { evaluations: 8000, ..Options::default() });
            assert!(out.ending == Ending::Settled && out.x.iter().all(|x| (x - 1.0).abs() < 1e-5), "{out:?}");
        }
    }

    #[test]
    fn bounds_hold_and_failures_are_walked_around() {
        // The bottom at (1, 1) is cut off: on the bound x <= 0.5 it is at (0.5, 0.25). A quadrant fails.
        let mut seen = f64::NEG_INFINITY;
        let mut cost = |x: &[f64]| {
            seen = seen.max(x[0]);
            if x[1] < -0.2 { f64::NAN } else { rosenbrock(x) }
        };
        let bounds = [Bounds { lower: -2.0, upper: 0.5 }, Bounds::NONE];
        let out = nelder_mead(&mut cost, &[-1.0, 1.0], &[0.3, 0.3], &bounds, &Options::default());
        assert!((out.x[0] - 0.5).abs() < 1e-5 && (out.x[1] - 0.25).abs() < 1e-4 && seen <= 0.5, "{out:?}");
        let nowhere = nelder_mead(&mut |_| f64::NAN, &[0.0], &[1.0], &[], &Options::default());
        assert_eq!(nowhere.ending, Ending::NoStart);
    }

    #[test]
    fn an_exhausted_budget_is_said() {
        let out = nelder_mead(&mut |x| rosenbrock(x), &[-1.2, 1.0], &[0.5, 0.5], &[], &Options { evaluations: 20, ..Options::default() });
        assert!(out.ending == Ending::OutOfBudget && out.evaluations < 26, "{out:?}");
    }
}
