//! From one pose of a robot with loops to another in small parts, without allocating: one Newton jump over a long way can land on
//! another assembly of the same loops, and stays there.

use pkm_dyn::loops::solve_positions;
use pkm_dyn::{Data, Model};

/// Longest way of a drive that is gone at once `[m | rad]`.
const STRIDE: f64 = 0.01;

/// Most parts of a way: a step has to end.
const MOST_PARTS: u32 = 64;

/// Goes from the pose in `data` to positions `q` of the drives when that is far; whether the loops closed all along.
pub(crate) fn walk_if_far<const N: usize>(model: &Model, data: &mut Data, q: &[f64; N]) -> bool {
    let far = model.actuators.iter().zip(q).map(|(&j, q)| (q - data.q[j]).abs()).fold(0.0, f64::max);
    let mut parts = 1;
    while parts < MOST_PARTS && f64::from(parts) * STRIDE < far {
        parts += 1;
    }
    // On the way between two poses surplus drives contradict each other: there is no straight way to go.
    let has_surplus = N > data.n_ind();
    parts == 1 || has_surplus || !model.is_constrained() || walk(model, data, q, parts)
}

/// Goes there in as many equal parts.
pub(crate) fn walk<const N: usize>(model: &Model, data: &mut Data, q: &[f64; N], parts: u32) -> bool {
    let start: [f64; N] = core::array::from_fn(|k| data.q[model.actuators[k]]);
    (1..=parts).all(|part| {
        let share = f64::from(part) / f64::from(parts);
        let way: [f64; N] = core::array::from_fn(|k| start[k] + share * (q[k] - start[k]));
        solve_positions(model, data, &way).is_closed
    })
}
