//! How many different motions the recordings show: the same motion twice proves a finding for that motion only.

use pkm_dyn::math;

use crate::motion::Motion;
use crate::segment::Segment;

/// Points of the shorter recording at which two are compared.
const POINTS: usize = 200;

/// Share of the travel within which two motions are one: a controller repeats a reference far better, another motion differs far more.
const SAME: f64 = 0.05;

/// Share of the range of efforts within which they are the same, where their noise is smaller: a motion that is disturbed, or made with
/// another load, is another one.
const SAME_EFFORT: f64 = 0.005;

/// Standard deviations of noise that efforts of the same motion differ by at most.
const NOISE: f64 = 3.0;

/// Number of different motions; another load or another base orientation makes a motion another one.
pub(crate) fn different_motions(motions: &[Motion]) -> usize {
    let mut kinds: Vec<&Segment> = Vec::new();
    for m in motions {
        if !kinds.iter().any(|k| is_same(k, &m.segment)) {
            kinds.push(&m.segment);
        }
    }
    kinds.len()
}

/// Whether one recording repeats the other, wherever each begins.
fn is_same(a: &Segment, b: &Segment) -> bool {
    if a.load != b.load || a.gravity != b.gravity {
        return false;
    }
    let length = |s: &Segment| s.dt * s.valid.len() as f64;
    let step = length(a).min(length(b)) / POINTS as f64;
    let [q_a, q_b] = [a, b].map(|s| thinned(&s.q, s.dt, step));
    let [tau_a, tau_b] = [a, b].map(|s| thinned(&s.tau, s.dt, step));
    let same_effort = (NOISE * math::hypot(noise(a, &tau_a, step), noise(b, &tau_b, step))).max(SAME_EFFORT);
    let half = POINTS / 2;
    // Every shift at which at least half of the shorter one lies on the other.
    let (n_a, n_b) = (q_a.first().map_or(0, Vec::len), q_b.first().map_or(0, Vec::len));
    (half..(n_a + n_b).saturating_sub(half)).any(|end| {
        let from = (end.saturating_sub(n_b), n_b.saturating_sub(end));
        let n = (n_a - from.0.min(n_a)).min(n_b - from.1);
        n >= half && distance(&q_a, &q_b, from, n) < SAME && distance(&tau_a, &tau_b, from, n) < same_effort
    })
}

/// Means over stretches of one step, of every drive: noise that is independent from sample to sample is averaged out.
fn thinned(x: &[Vec<f64>], dt: f64, step: f64) -> Vec<Vec<f64>> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of the recording's length")]
    let n = ((step / dt) as usize).max(1);
    x.iter().map(|x| x.chunks_exact(n).map(|c| c.iter().sum::<f64>() / n as f64).collect()).collect()
}

/// rms over time and drives of the difference of two stretches, as a share of the larger range.
fn distance(a: &[Vec<f64>], b: &[Vec<f64>], (from_a, from_b): (usize, usize), n: usize) -> f64 {
    let (mut sum, mut drives) = (0.0, 0_usize);
    for (a, b) in a.iter().zip(b) {
        let travel = range(a).max(range(b));
        if travel > 0.0 {
            let square: f64 = a[from_a..from_a + n].iter().zip(&b[from_b..from_b + n]).map(|(a, b)| (a - b) * (a - b)).sum();
            sum += square / (n as f64 * travel * travel);
            drives += 1;
        }
    }
    math::sqrt(sum / drives.max(1) as f64)
}

/// Noise of the means of efforts, as a share of their range: from second differences of the samples.
fn noise(s: &Segment, means: &[Vec<f64>], step: f64) -> f64 {
    let (mut sum, mut drives) = (0.0, 0_usize);
    for (tau, means) in s.tau.iter().zip(means).filter(|(_, m)| range(m) > 0.0) {
        let square: f64 = tau.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]).map(|d| d * d / 6.0).sum();
        let of_mean = square / tau.len().max(1) as f64 * (s.dt / step).min(1.0);
        sum += of_mean / (range(means) * range(means));
        drives += 1;
    }
    math::sqrt(sum / drives.max(1) as f64)
}

fn range(x: &[f64]) -> f64 {
    let (low, high) = x.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
    if high > low { high - low } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shelf::Shelf;
    use crate::verdict::Use;

    fn recorded(q: impl Fn(f64) -> f64, n: usize) -> Segment {
        let dt = 0.01;
        Segment {
            name: String::new(),
            samples: n,
            duration: dt * n as f64,
            used: Use::Train,
            start: 0.0,
            dt,
            q: vec![(0..n).map(|i| q(i as f64 * dt)).collect()],
            v: Vec::new(),
            a: Vec::new(),
            tau: vec![(0..n).map(|i| 3.0 * q(i as f64 * dt)).collect()],
            band: 5.0,
            wrenches: Vec::new(),
            channels: Vec::new(),
            extra: alloc::collections::BTreeMap::default(),
            warmth: Vec::new(),
            valid: vec![true; n],
            gravity: None,
            load: None,
            shelf: Shelf::default(),
        }
    }

    #[test]
    fn a_motion_that_starts_elsewhere_is_the_same_and_another_one_is_not() {
        let wave = |t: f64| math::sin(3.0 * t) + 0.4 * math::sin(7.1 * t);
        let first = recorded(wave, 1000);
        assert!(is_same(&first, &recorded(|t| wave(t) + 1e-3 * math::sin(500.0 * t), 1000)), "noise");
        assert!(is_same(&first, &recorded(|t| wave(t + 2.5), 1400)), "later and longer");
        assert!(!is_same(&first, &recorded(|t| wave(0.5 * t), 1000)), "half the speed");
        assert!(!is_same(&first, &recorded(|t| math::sin(2.0 * t) + 0.7 * math::sin(5.3 * t), 1000)), "other frequencies");
        assert!(!is_same(&first, &recorded(|t| wave(t) + 1.0, 1000)), "about another centre");
        let mut disturbed = recorded(wave, 1000);
        disturbed.tau[0].iter_mut().skip(300).take(200).for_each(|t| *t += 2.0);
        assert!(!is_same(&first, &disturbed), "pushed while it moves");
        let mut tilted = recorded(wave, 1000);
        tilted.gravity = Some([0.0, 1.0, -9.7]);
        assert!(!is_same(&first, &tilted), "another base orientation");
    }
}
