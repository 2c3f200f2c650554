//! Numbers that say something about a series of samples.

use pkm_dyn::math;

/// Mean; not a number of nothing.
pub(crate) fn mean(x: &[f64]) -> f64 {
    x.iter().sum::<f64>() / x.len() as f64
}

/// Root mean square.
pub(crate) fn rms(x: &[f64]) -> f64 {
    math::sqrt(x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64)
}

/// Standard deviation.
pub(crate) fn deviation(x: &[f64]) -> f64 {
    let mean = mean(x);
    rms(&x.iter().map(|x| x - mean).collect::<Vec<f64>>())
}

/// Largest minus smallest.
pub(crate) fn range(x: &[f64]) -> f64 {
    x.iter().fold(f64::MIN, |top, x| top.max(*x)) - x.iter().fold(f64::MAX, |low, x| low.min(*x))
}

/// Median.
pub(crate) fn median(x: &[f64]) -> f64 {
    let mut sorted = x.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    let at = |i: usize| sorted.get(i).copied().unwrap_or(f64::NAN);
    if n % 2 == 1 { at(n / 2) } else { 0.5 * (at((n / 2).wrapping_sub(1)) + at(n / 2)) }
}

/// Largest absolute difference, entry by entry.
pub(crate) fn largest_gap(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0, |top, (a, b)| (a - b).abs().max(top))
}
