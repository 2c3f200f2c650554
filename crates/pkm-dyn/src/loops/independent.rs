//! Which coordinates are independent: their motion determines all others.

use alloc::vec::Vec;

use nalgebra::DMatrix;

use crate::data::Data;
use crate::elimination::RANK_TOLERANCE;
use crate::loops::gap::loop_gap;
use crate::loops::reduce::reduce;
use crate::loops::solve::{assemble, factor};
use crate::model::Model;

/// A rough assembly counts as closed below this gap `[m | rad]`.
const CLOSED: f64 = 1e-9;

/// How to choose the independent coordinates of a closed-loop robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// The drives. Where there are more of them than freedoms (redundant actuation) those that determine the motion best; where there
    /// are fewer, the drives alone: the rest is then not determined, and closing the loops says so.
    Drives,
    /// As many as there are freedoms: drives first, then the coordinates that the constraints determine worst. For mechanisms that move
    /// with coordinates no drive holds.
    Freedoms,
    /// As many as there are freedoms, whichever are best conditioned, driven or not.
    Pivoting,
}

/// Independent coordinates at the model's stated assembly, as joint indices: drives first and in their order, then others ascending.
///
/// By elimination with complete pivoting; coordinates without a pivot are the independent ones. `data` is used for it.
#[must_use]
pub fn choose_independent(model: &Model, data: &mut Data, choice: Choice) -> Vec<usize> {
    let drives = &model.actuators;
    if !model.is_constrained() {
        let others = (0..model.nv()).filter(|j| choice != Choice::Drives && !drives.contains(j));
        return drives.iter().copied().chain(others).collect();
    }
    // Of an open loop the constraints may be of another rank: a linkage that moves only because of its proportions is stiff then.
    let closure = assemble(model, data);
    let at = if closure.gap < CLOSED { data.q.clone() } else { model.assembly.clone() };
    loop_gap(model, data, &at);
    let passive = model.passive();
    let stages = match choice {
        Choice::Drives | Choice::Freedoms => alloc::vec![passive, drives.clone()],
        Choice::Pivoting => alloc::vec![(0..model.nv()).collect()],
    };
    let pivots = pivot_columns(data.loop_jacobian.clone(), &stages);
    let free = |j: &usize| !pivots.contains(j);
    if choice == Choice::Drives && model.nv() - pivots.len() >= drives.len() {
        // Also where a drive is no coordinate of its own at this pose, which may be singular: others need not be.
        return drives.clone();
    }
    let driven: Vec<usize> = drives.iter().copied().filter(free).collect();
    let others = (0..model.nv()).filter(|j| choice != Choice::Drives && !drives.contains(j) && free(j));
    driven.iter().copied().chain(others).collect()
}

/// A dependent coordinate that moves this many times as fast as an independent one takes its place: the smaller of the two motions is
/// then the dependent one, so that no choice is ever near a pose where it fails while another would not.
const FASTER: f64 = 2.0;

/// Exchanges independent coordinates for dependent ones that move much faster, at the pose of the last solution: surplus drives among
/// drives ([`Choice::Drives`]), or any joint of one coordinate ([`Choice::Pivoting`]). Ends at a choice whose volume none exceeds much.
pub(crate) fn choose_anew(model: &Model, data: &mut Data) {
    // As many drives as freedoms: there is nothing to exchange, and this runs in the loop.
    if data.choice == Choice::Drives && model.n_act() <= data.n_ind() {
        return;
    }
    for _ in 0..model.nv() {
        let may_enter = |j: usize| match data.choice {
            Choice::Drives => model.actuators.contains(&j),
            Choice::Freedoms => false,
            Choice::Pivoting => model.joints[j].is_whole(),
        };
        let mut best = (FASTER, None);
        for (at, &d) in data.dependent.iter().enumerate().filter(|(_, d)| may_enter(**d)) {
            for k in 0..data.n_ind() {
                let speed = data.reduction[(d, k)].abs();
                if speed > best.0 && model.joints[data.independent[k]].is_whole() {
                    best = (speed, Some((at, k)));
                }
            }
        }
        let (_, Some((at, k))) = best else { return };
        core::mem::swap(&mut data.dependent[at], &mut data.independent[k]);
        data.dependent.sort_unstable();
        data.elimination.forget();
        data.reduction.fill(0.0);
        for (k, &j) in data.independent.iter().enumerate() {
            data.reduction[(j, k)] = 1.0;
        }
        factor(data);
        reduce(model, data);
    }
}

/// Columns that receive a pivot when those of each stage are used up before those of the next.
fn pivot_columns(mut a: DMatrix<f64>, stages: &[Vec<usize>]) -> Vec<usize> {
    let limit = RANK_TOLERANCE * a.amax();
    let mut rows: Vec<usize> = (0..a.nrows()).collect();
    let mut pivots = Vec::new();
    for stage in stages {
        loop {
            let mut best = (limit, None);
            for (at, &i) in rows.iter().enumerate() {
                for &j in stage.iter().filter(|j| !pivots.contains(*j)) {
                    if a[(i, j)].abs() > best.0 {
                        best = (a[(i, j)].abs(), Some((at, j)));
                    }
                }
            }
            let (_, Some((at, j))) = best else { break };
            let pivot = rows.swap_remove(at);
            for &i in &rows {
                let factor = a[(i, j)] / a[(pivot, j)];
                for column in 0..a.ncols() {
                    a[(i, column)] -= factor * a[(pivot, column)];
                }
            }
            pivots.push(j);
        }
    }
    pivots
}
