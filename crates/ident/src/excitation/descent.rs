//! Descent with limited memory: the quasi-Newton direction of the last steps (L-BFGS, \[Nocedal2006, alg. 7.4\]) and a backtracking search
//! along it that refuses points at which there is no value.

use super::basis::dot;

/// Steps remembered.
const MEMORY: usize = 14;

/// Share of the foretold decrease that a step must bring.
const ENOUGH: f64 = 1e-4;

/// Halvings of a step before the search gives up.
const HALVINGS: usize = 25;

/// Longest first step, in scaled units: nothing is known of the curvature yet.
const FIRST: f64 = 0.05;

/// Relative decrease over [`PATIENCE`] steps below which the search is done.
const DONE: f64 = 1e-4;
const PATIENCE: usize = 6;

/// Value at a point, and its slope where one is asked for.
type Look<'l> = dyn FnMut(&[f64], Option<&mut Vec<f64>>) -> Option<f64> + 'l;

/// Goes down from `x` for at most `steps` steps and returns how many it took. `look` gives the value at a point, and its slope where one is
/// asked for; none where there is no value. `told` hears of every accepted point.
pub(super) fn descend(x: &mut Vec<f64>, steps: usize, look: &mut Look<'_>, told: &mut dyn FnMut()) -> usize {
    let mut slope = vec![0.0; x.len()];
    let Some(mut value) = look(x, Some(&mut slope)) else { return 0 };
    let mut memory: Vec<(Vec<f64>, Vec<f64>)> = Vec::new();
    let mut values = vec![value];
    for taken in 0..steps {
        let mut direction = quasi_newton(&slope, &memory);
        let mut along = dot(&direction, &slope);
        if along >= 0.0 {
            memory.clear();
            direction = slope.iter().map(|g| -g).collect();
            along = -dot(&slope, &slope);
        }
        if along >= 0.0 {
            return taken;
        }
        let length = dot(&direction, &direction).sqrt();
        let mut t = if memory.is_empty() { (FIRST / length).min(1.0) } else { 1.0 };
        let mut found = None;
        for _ in 0..HALVINGS {
            let point: Vec<f64> = x.iter().zip(&direction).map(|(x, d)| x + t * d).collect();
            if let Some(v) = look(&point, None)
                && v <= value + ENOUGH * t * along
            {
                found = Some(point);
                break;
            }
            t *= 0.5;
        }
        let Some(point) = found else { return taken };
        let mut new_slope = vec![0.0; x.len()];
        let Some(new_value) = look(&point, Some(&mut new_slope)) else { return taken };
        let s: Vec<f64> = point.iter().zip(x.iter()).map(|(a, b)| a - b).collect();
        let y: Vec<f64> = new_slope.iter().zip(&slope).map(|(a, b)| a - b).collect();
        // Only a step along which the slope rises says something of the curvature.
        if dot(&s, &y) > 1e-10 * dot(&s, &s).sqrt() * dot(&y, &y).sqrt() {
            memory.push((s, y));
            if memory.len() > MEMORY {
                memory.remove(0);
            }
        }
        (*x, slope, value) = (point, new_slope, new_value);
        told();
        values.push(value);
        if values.len() > PATIENCE && values[values.len() - 1 - PATIENCE] - value < DONE * value.abs().max(1.0) {
            return taken + 1;
        }
    }
    steps
}

/// Minus the slope through the inverse of the curvature that the remembered steps show.
fn quasi_newton(slope: &[f64], memory: &[(Vec<f64>, Vec<f64>)]) -> Vec<f64> {
    let mut d: Vec<f64> = slope.iter().map(|g| -g).collect();
    let mut shares = Vec::with_capacity(memory.len());
    for (s, y) in memory.iter().rev() {
        let share = dot(s, &d) / dot(s, y);
        d.iter_mut().zip(y).for_each(|(d, y)| *d -= share * y);
        shares.push(share);
    }
    if let Some((s, y)) = memory.last() {
        let scale = dot(s, y) / dot(y, y);
        d.iter_mut().for_each(|d| *d *= scale);
    }
    for ((s, y), share) in memory.iter().zip(shares.into_iter().rev()) {
        let back = dot(y, &d) / dot(s, y);
        d.iter_mut().zip(s).for_each(|(d, s)| *d += (share - back) * s);
    }
    d
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bottom_of_a_curved_valley_is_found() {
        // Rosenbrock's valley, with no value left of a wall.
        let mut look = |x: &[f64], slope: Option<&mut Vec<f64>>| {
            let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
            if let Some(g) = slope {
                *g = vec![-2.0 * a - 400.0 * x[0] * b, 200.0 * b];
            }
            (x[0] > -1.5).then_some(a * a + 100.0 * b * b)
        };
        let mut x = vec![-1.2, 1.0];
        let mut count = 0;
        let mut all = 0;
        // The search ends where six steps bring little; here it may begin anew.
        for _ in 0..6 {
            all += descend(&mut x, 200, &mut look, &mut || count += 1);
        }
        assert!((x[0] - 1.0).abs() < 1e-5 && (x[1] - 1.0).abs() < 1e-5, "{x:?}");
        assert!(all == count && all < 150, "{all} {count}");
    }

    #[test]
    fn without_a_value_nothing_moves() {
        let mut x = vec![1.0];
        assert_eq!(descend(&mut x, 5, &mut |_, _| None, &mut || {}), 0);
        assert!((x[0] - 1.0).abs() < 1e-15);
    }
}
