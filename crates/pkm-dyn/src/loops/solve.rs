//! The passive coordinates that close the loops: positions by Newton, velocities and accelerations by linear solves.

use alloc::vec;
use alloc::vec::Vec;

use crate::data::Data;
use crate::elimination::Elimination;
use crate::kinematics::forward_velocities;
use crate::loops::gap::{loop_drift, loop_gap};
use crate::model::Model;

/// A loop counts as closed below this gap `[m | rad]`: a thousandth of a nanometre, reached by Newton in one step more than needed.
const CLOSED: f64 = 1e-12;

/// Newton stops here; from a neighbouring pose it needs two or three steps.
const MAX_ITERATIONS: usize = 30;

/// Parts of a long way from one pose to another: one Newton jump over a long way can land on another assembly of the same loops.
const WALK_PARTS: usize = 40;

/// How a loop closure ended.
#[derive(Debug, Clone, Copy, PartialEq)]
#[must_use]
pub struct Closure {
    /// Whether every constraint is met and the passive coordinates are determined.
    pub is_closed: bool,
    /// Newton steps taken.
    pub iterations: usize,
    /// Largest remaining gap `[m | rad]`.
    pub gap: f64,
    /// Row of the largest gap (couplings first, then loops).
    pub row: usize,
    /// Rank of the constraints with respect to the passive coordinates.
    pub rank: usize,
    /// Smallest pivot of that elimination over its largest entry: near zero at a singular pose.
    pub pivot_ratio: f64,
}

impl Closure {
    fn of_tree() -> Self {
        Self { is_closed: true, iterations: 0, gap: 0.0, row: 0, rank: 0, pivot_ratio: 1.0 }
    }
}

fn factor_passive(data: &mut Data) {
    let Data { loop_jacobian, passive, elimination, .. } = data;
    elimination.factor(|i, j| loop_jacobian[(i, passive[j])]);
}

fn largest(gap: &[f64]) -> (f64, usize) {
    // A gap that is not a number must not pass for a closed loop.
    gap.iter().enumerate().fold((0.0, 0), |best, (i, g)| if g.abs() > best.0 || g.is_nan() { (g.abs(), i) } else { best })
}

/// Tree coordinates that close the loops for given drives, by Newton from the tree coordinates in `data.q`.
///
/// `q_act` `[m | rad]`, one per drive. The result is `data.q`; on failure it holds the last iterate.
pub fn solve_positions(model: &Model, data: &mut Data, q_act: &[f64]) -> Closure {
    for (&j, &value) in model.actuators.iter().zip(q_act) {
        data.q[j] = value;
    }
    if !model.is_constrained() {
        return Closure::of_tree();
    }
    let mut q = core::mem::take(&mut data.q);
    let mut step = core::mem::take(&mut data.step);
    let mut out = Closure { is_closed: false, ..Closure::of_tree() };
    for iterations in 0..=MAX_ITERATIONS {
        loop_gap(model, data, &q);
        (out.gap, out.row) = largest(&data.loop_gap);
        out.iterations = iterations;
        factor_passive(data);
        out.rank = data.elimination.rank();
        out.pivot_ratio = data.elimination.smallest_pivot_ratio();
        if out.gap <= CLOSED || !out.gap.is_finite() {
            break;
        }
        let Data { loop_gap, elimination, passive, .. } = data;
        elimination.solve(|i| -loop_gap[i], &mut step);
        for (&j, s) in passive.iter().zip(&step) {
            q[j] += s;
        }
    }
    out.is_closed = out.gap <= 1e3 * CLOSED && out.rank == data.passive.len();
    data.q = q;
    data.step = step;
    out
}

/// As [`solve_positions`], but walks from the drives' coordinates in `data.q` in small parts, so that the branch is kept.
///
/// Where the loops do not close at these coordinates (a stated assembly may name passive joints only, and no leg is of length zero)
/// there is nothing to walk from: Newton then jumps from the passive coordinates in `data.q`.
pub fn walk_to(model: &Model, data: &mut Data, q_act: &[f64]) -> Closure {
    if !model.is_constrained() {
        return solve_positions(model, data, q_act);
    }
    let start: Vec<f64> = model.actuators.iter().map(|&j| data.q[j]).collect();
    let rough = data.q.clone();
    let mut out = solve_positions(model, data, &start);
    if !out.is_closed {
        data.q = rough;
        return solve_positions(model, data, q_act);
    }
    let mut way = vec![0.0; q_act.len()];
    for part in 1..=WALK_PARTS {
        let share = part as f64 / WALK_PARTS as f64;
        for k in 0..way.len() {
            way[k] = start[k] + share * (q_act[k] - start[k]);
        }
        out = solve_positions(model, data, &way);
        if !out.is_closed {
            break;
        }
    }
    out
}

/// Closes the loops near the model's stated assembly: the start of every motion. The result is `data.q`.
///
/// Where the stated coordinates of the drives do not close the loops, the drives go to [`mid_pose`]: an assembly may name passive
/// joints only.
pub fn assemble(model: &Model, data: &mut Data) -> Closure {
    data.q.copy_from_slice(&model.assembly);
    let q_act: Vec<f64> = model.actuators.iter().map(|&j| model.assembly[j]).collect();
    let stated = solve_positions(model, data, &q_act);
    if stated.is_closed {
        return stated;
    }
    data.q.copy_from_slice(&model.assembly);
    solve_positions(model, data, &mid_pose(model))
}

/// The drives' coordinates in the middle of their stated travel `[m | rad]`; the assembly's where no finite limits are stated.
#[must_use]
pub fn mid_pose(model: &Model) -> Vec<f64> {
    let mid = |&j: &usize| {
        let l = model.joints[j].limits;
        if l.lower.is_finite() && l.upper.is_finite() && l.upper > l.lower { 0.5 * (l.lower + l.upper) } else { model.assembly[j] }
    };
    model.actuators.iter().map(mid).collect()
}

/// Degrees of freedom at the tree coordinates `q`: coordinates less independent constraints.
#[must_use]
pub fn mobility(model: &Model, data: &mut Data, q: &[f64]) -> usize {
    loop_gap(model, data, q);
    let mut all = Elimination::new(model.n_constraints(), model.nv());
    all.factor(|i, j| data.loop_jacobian[(i, j)]);
    model.nv() - all.rank()
}

/// Tree velocities from the drives' `v_act` `[m/s | rad/s]`: `data.v`. Call [`solve_positions`] first.
pub fn solve_velocities(model: &Model, data: &mut Data, v_act: &[f64]) {
    data.v.fill(0.0);
    for (&j, &value) in model.actuators.iter().zip(v_act) {
        data.v[j] = value;
    }
    if model.is_constrained() {
        let Data { loop_jacobian, elimination, passive, step, v, .. } = data;
        elimination.solve(|i| -model.actuators.iter().map(|&j| loop_jacobian[(i, j)] * v[j]).sum::<f64>(), step);
        for (&j, s) in passive.iter().zip(step.iter()) {
            v[j] = *s;
        }
    }
    let v = core::mem::take(&mut data.v);
    forward_velocities(model, data, &v);
    data.v = v;
}

/// Tree accelerations from the drives' `a_act` `[m/s² | rad/s²]`: `data.a`. Call [`solve_velocities`] first.
pub fn solve_accelerations(model: &Model, data: &mut Data, a_act: &[f64]) {
    data.a.fill(0.0);
    for (&j, &value) in model.actuators.iter().zip(a_act) {
        data.a[j] = value;
    }
    if model.is_constrained() {
        loop_drift(model, data);
        let Data { loop_jacobian, loop_drift, elimination, passive, step, a, .. } = data;
        elimination.solve(|i| -loop_drift[i] - model.actuators.iter().map(|&j| loop_jacobian[(i, j)] * a[j]).sum::<f64>(), step);
        for (&j, s) in passive.iter().zip(step.iter()) {
            a[j] = *s;
        }
    }
}
