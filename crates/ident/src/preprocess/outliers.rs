//! Single samples that stand out of their neighbourhood \[Pearson2002\].

/// Samples to each side of a sample that its neighbourhood has.
const NEIGHBOURS: usize = 5;

/// Half of the numbers are closer to the median than the median deviation; this makes it the standard deviation of normal noise.
const NORMAL_MAD: f64 = 1.4826;

/// What was replaced.
#[derive(Debug, Clone, PartialEq)]
pub struct Replaced {
    /// Samples, ascending.
    pub replaced: Vec<usize>,
    /// Largest distance from the median around a sample that was replaced; 0 when none was.
    pub largest: f64,
}

/// Replaces samples further than `limit` robust standard deviations from the median around them by that median (the Hampel filter).
///
/// The deviation is that of the distances over the whole signal, not over the neighbourhood, where a signal held between updates has none.
/// What it does to noise: nothing inside the limit. Unknown samples (NaN) stay unknown; the first and the last one have no neighbourhood.
pub fn replace(x: &mut [f64], limit: f64) -> Replaced {
    let n = x.len();
    let median = |mut window: Vec<f64>| {
        window.sort_by(f64::total_cmp);
        let m = window.len();
        if m == 0 { f64::NAN } else { 0.5 * (window[m / 2] + window[(m - 1) / 2]) }
    };
    // Neighbours come in pairs, one from each side: the median of a slope is then its middle, at ends and gaps as well.
    let around = |i: usize| {
        let pair = |j: usize| (i >= j && i + j < n).then(|| [x[i - j], x[i + j]]).filter(|p| p.iter().all(|x| !x.is_nan()));
        let mut window: Vec<f64> = (1..=NEIGHBOURS).filter_map(pair).flatten().collect();
        window.push(x[i]);
        window
    };
    let medians: Vec<f64> = (0..n).map(|i| median(around(i))).collect();
    let distances: Vec<f64> = x.iter().zip(&medians).map(|(x, m)| (x - m).abs()).collect();
    let mut sorted: Vec<f64> = distances.iter().copied().filter(|d| *d > 0.0).collect();
    sorted.sort_by(f64::total_cmp);
    // Distances of exactly zero are those of held values; the others tell the noise.
    let noise = NORMAL_MAD * sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let mut out = Replaced { replaced: Vec::new(), largest: 0.0 };
    for i in 0..n {
        if distances[i] > limit * noise && noise > 0.0 {
            x[i] = medians[i];
            out.largest = out.largest.max(distances[i]);
            out.replaced.push(i);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_dyn::math;

    #[test]
    fn spikes_go_and_everything_else_stays() {
        let clean: Vec<f64> = (0..500).map(|i| math::sin(0.05 * f64::from(i)) + 0.001 * f64::from(i * 37 % 11)).collect();
        let mut x = clean.clone();
        let at = [3, 4, 60, 250, 495];
        at.iter().for_each(|&i| x[i] += 5.0);
        x[100] = f64::NAN;
        let found = replace(&mut x, 10.0);
        assert_eq!(found.replaced, at);
        assert!((found.largest - 5.0).abs() < 0.2 && x[100].is_nan());
        assert!(x.iter().zip(&clean).enumerate().all(|(i, (a, b))| i == 100 || (a - b).abs() < 0.15));
        let mut same = clean.clone();
        assert!(replace(&mut same, 20.0).replaced.is_empty() && same == clean);
    }
}
