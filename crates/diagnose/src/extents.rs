//! How far and how fast the fitted motions go: what the shapes that are tried are scaled with.

use pkm_dyn::effects::Robot;

use crate::motion::{Motion, softness_widths, top_speed};
use crate::settings::SOFTNESS;
use crate::verdict::Use;

/// Motions that are fitted: a held-out one must not shape what is tried.
fn fitted(motions: &[Motion]) -> impl Iterator<Item = &Motion> {
    motions.iter().filter(|m| m.segment.used != Use::Holdout)
}

/// Largest widths of smoothed directions over fitted motions: [softness][tree joint] `[m/s | rad/s]`.
pub(crate) fn largest_widths(robot: &Robot, motions: &[Motion]) -> Vec<Vec<f64>> {
    let mut out = vec![vec![0.0_f64; robot.model.nv()]; SOFTNESS.len()];
    for segment in fitted(motions).map(|m| softness_widths(&robot.model, m)) {
        for (sum, widths) in out.iter_mut().zip(segment) {
            for (s, w) in sum.iter_mut().zip(widths) {
                *s = s.max(w);
            }
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
