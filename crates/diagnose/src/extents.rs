//! How far and how fast the fitted motions go: what the shapes that are tried are scaled with.

use crate::motion::{Motion, top_speed};
use crate::turning::Turn;
use crate::verdict::Use;

/// Motions that are fitted: a held-out one must not shape what is tried.
fn fitted(motions: &[Motion]) -> impl Iterator<Item = &Motion> {
    motions.iter().filter(|m| m.segment.used != Use::Holdout)
}

/// How directions pass through zero, the widest over fitted motions: [softness][tree joint].
pub(crate) fn widest_turns(motions: &[Motion]) -> Vec<Vec<Turn>> {
    let mut all = fitted(motions).map(|m| &m.turns);
    let mut out = all.next().cloned().unwrap_or_default();
    for segment in all {
        for (sum, turn) in out.iter_mut().flatten().zip(segment.iter().flatten()) {
            *sum = sum.wider(*turn);
        }
    }
    out
}

/// Top speed and travel of each drive over fitted motions.
pub(crate) fn extents(motions: &[Motion], n: usize) -> (Vec<f64>, Vec<f64>) {
    let each = |f: &dyn Fn(&Motion, usize) -> f64| (0..n).map(|k| fitted(motions).map(|m| f(m, k)).fold(0.0, f64::max)).collect();
    let range = |m: &Motion, k: usize| {
        let q = &m.segment.q[k];
        q.iter().copied().fold(f64::NEG_INFINITY, f64::max) - q.iter().copied().fold(f64::INFINITY, f64::min)
    };
    (each(&|m, k| top_speed(&m.segment.v[k])), each(&range))
}

/// Lowest and highest position of each drive over fitted motions.
pub(crate) fn ranges(motions: &[Motion], n: usize) -> Vec<[f64; 2]> {
    let all = |k: usize| fitted(motions).flat_map(move |m| m.segment.q[k].iter().copied());
    (0..n).map(|k| [all(k).fold(f64::INFINITY, f64::min), all(k).fold(f64::NEG_INFINITY, f64::max)]).collect()
}
