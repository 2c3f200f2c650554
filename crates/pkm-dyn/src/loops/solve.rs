//! The dependent coordinates that close the loops: positions by Newton, velocities and accelerations by linear solves.

use alloc::vec;
use alloc::vec::Vec;

use crate::configuration::integrate;
use crate::data::Data;
use crate::elimination::Elimination;
use crate::kinematics::{root_poses, world_velocities};
use crate::loops::actuation::fitted;
use crate::loops::gap::{gap_rows, jacobian_rows, loop_drift, loop_gap};
use crate::loops::independent::choose_anew;
use crate::loops::reduce::{expand, reduce};
use crate::model::Model;

/// A loop counts as closed below this gap `[m | rad]`: a thousandth of a nanometre, reached by Newton in one step more than needed.
const CLOSED: f64 = 1e-12;

/// Newton stops here; from a neighbouring pose it needs two or three steps.
const MAX_ITERATIONS: usize = 30;

/// Parts of a long way from one pose to another: one Newton jump over a long way can land on another assembly of the same loops.
const WALK_PARTS: usize = 40;

/// Below this gap `[m | rad]` the elimination of the pose before serves for a Newton step: what the pose has changed since is of the
/// root of the gap, and so is the share of the gap that the step leaves.
const REUSE_BELOW: f64 = 1e-6;

/// Gauss-Newton stops when the independent coordinates move less than this `[m | rad]`, or after so many steps.
const FITTED: f64 = 1e-11;
const MAX_FITS: usize = 6;

/// How a loop closure ended.
#[derive(Debug, Clone, Copy, PartialEq)]
#[must_use]
pub struct Closure {
    /// Whether every constraint is met and the dependent coordinates are determined.
    pub is_closed: bool,
    /// Newton steps taken.
    pub iterations: usize,
    /// Largest remaining gap `[m | rad]`.
    pub gap: f64,
    /// Row of the largest gap (couplings first, then loops).
    pub row: usize,
    /// Rank of the constraints with respect to the dependent coordinates.
    pub rank: usize,
    /// Smallest pivot of that elimination over its largest entry: near zero at a singular pose.
    pub pivot_ratio: f64,
    /// Largest difference `[m | rad]` between a drive's coordinate as given and as the loops have it: zero unless there are more drives
    /// than freedoms, whose coordinates can contradict each other.
    pub misfit: f64,
}

impl Closure {
    fn of_tree() -> Self {
        Self { is_closed: true, iterations: 0, gap: 0.0, row: 0, rank: 0, pivot_ratio: 1.0, misfit: 0.0 }
    }
}

pub(crate) fn factor(data: &mut Data) {
    let Data { loop_jacobian, dependent, elimination, .. } = data;
    let (rows, jacobian) = (loop_jacobian.nrows(), loop_jacobian.as_slice());
    elimination.factor(|i, j| jacobian[dependent[j] * rows + i]);
}

fn largest(gap: &[f64]) -> (f64, usize) {
    // A gap that is not a number must not pass for a closed loop.
    gap.iter().enumerate().fold((0.0, 0), |best, (i, g)| if g.abs() > best.0 || g.is_nan() { (g.abs(), i) } else { best })
}

/// Tree coordinates that close the loops for given drives, by Newton from the tree coordinates in `data.q`.
///
/// `q_act` `[m | rad]`, one per drive. The result is `data.q` and, at that pose, the reduction; on failure `data.q` holds the last
/// iterate. More drives than freedoms are met in the least-squares sense, and what is left of the contradiction is the result's misfit;
/// which of them are independent follows the pose. Coordinates that are not finite change nothing and count as not closed.
pub fn solve_positions(model: &Model, data: &mut Data, q_act: &[f64]) -> Closure {
    if !q_act.iter().all(|q| q.is_finite()) {
        return Closure { is_closed: false, gap: f64::NAN, ..Closure::of_tree() };
    }
    if !model.is_constrained() {
        for (&j, &value) in model.actuators.iter().zip(q_act) {
            data.q[j] = value;
        }
        return close_at(model, data);
    }
    // At the pose of the last solution its reduction foretells the next, and its elimination serves for one more step.
    let is_near = data.reduced_at == data.q;
    if is_near {
        foretell(model, data, q_act);
    }
    for (&j, &value) in model.actuators.iter().zip(q_act) {
        data.q[j] = value;
    }
    let closure = newton(model, data, is_near);
    if model.n_act() > data.n_ind() { fit_drives(model, data, q_act, closure) } else { closure }
}

/// Moves the independent coordinates until all drives are met as well as they can be, by Gauss-Newton from a closed pose.
fn fit_drives(model: &Model, data: &mut Data, q_act: &[f64], mut closure: Closure) -> Closure {
    for _ in 0..MAX_FITS {
        if !closure.is_closed {
            return closure;
        }
        choose_anew(model, data);
        let mut left = core::mem::take(&mut data.tau_act);
        for (left, (&j, q)) in left.iter_mut().zip(model.actuators.iter().zip(q_act)) {
            *left = q - data.q[j];
        }
        closure.misfit = left.iter().fold(0.0, |top, x| top.max(x.abs()));
        let is_sound = fitted(model, data, &left);
        data.tau_act = left;
        let n = data.n_ind();
        let way = data.scratch[..n].iter().fold(0.0_f64, |top, x| top.max(x.abs()));
        if !is_sound || way < FITTED {
            break;
        }
        for k in 0..n {
            data.q[data.independent[k]] += data.scratch[k];
        }
        let misfit = closure.misfit;
        closure = Closure { misfit, ..newton(model, data, true) };
    }
    closure
}

/// Tree coordinates that close the loops with the independent coordinates as they are in `data.q`, from the others there.
///
/// For mechanisms whose independent coordinates are not all driven ([`crate::loops::Choice`]).
pub fn close_at(model: &Model, data: &mut Data) -> Closure {
    if model.is_constrained() {
        return newton(model, data, false);
    }
    let q = core::mem::take(&mut data.q);
    root_poses(model, data, &q);
    data.q = q;
    Closure::of_tree()
}

/// Moves the passive coordinates as the reduction says for the drives' way to `q_act`.
fn foretell(model: &Model, data: &mut Data, q_act: &[f64]) {
    let Data { q, step, reduction, independent, dependent, .. } = data;
    let step = &mut step[..dependent.len()];
    step.fill(0.0);
    for (k, &j) in independent.iter().enumerate() {
        let Some(drive) = model.actuators.iter().position(|&a| a == j) else { continue };
        let way = q_act[drive] - q[j];
        let column = reduction.column(k);
        for (s, &d) in step.iter_mut().zip(dependent.iter()) {
            *s += column[d] * way;
        }
    }
    apply_step(model, data);
}

/// Adds `data.step`, one entry per dependent coordinate, to `data.q`.
fn apply_step(model: &Model, data: &mut Data) {
    let Data { q, step, scratch, dependent, has_compound, .. } = data;
    if !*has_compound {
        for (&j, s) in dependent.iter().zip(step.iter()) {
            q[j] += s;
        }
        return;
    }
    let dv = &mut scratch[..model.nv()];
    dv.fill(0.0);
    for (&j, s) in dependent.iter().zip(step.iter()) {
        dv[j] = *s;
    }
    integrate(model, q, dv);
}

fn newton(model: &Model, data: &mut Data, may_reuse: bool) -> Closure {
    let mut out = Closure { is_closed: false, ..Closure::of_tree() };
    let mut is_factored = false;
    for iterations in 0..=MAX_ITERATIONS {
        let q = core::mem::take(&mut data.q);
        root_poses(model, data, &q);
        gap_rows(model, data, &q);
        data.q = q;
        (out.gap, out.row) = largest(&data.loop_gap);
        out.iterations = iterations;
        is_factored = false;
        if out.gap <= CLOSED || !out.gap.is_finite() {
            break;
        }
        if !(may_reuse && iterations == 0 && out.gap < REUSE_BELOW) {
            jacobian_rows(model, data);
            factor(data);
            is_factored = true;
        }
        let Data { loop_gap, elimination, step, dependent, .. } = data;
        elimination.solve(|i| -loop_gap[i], &mut step[..dependent.len()]);
        apply_step(model, data);
    }
    if !is_factored {
        jacobian_rows(model, data);
        factor(data);
    }
    out.rank = data.elimination.rank();
    out.pivot_ratio = data.elimination.smallest_pivot_ratio();
    out.is_closed = out.gap <= 1e3 * CLOSED && out.rank == data.dependent.len();
    reduce(model, data);
    if out.is_closed {
        data.reduced_at.copy_from_slice(&data.q);
    } else {
        data.reduced_at.fill(f64::NAN);
    }
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
    // Nothing before this counts: neither the last pose nor the order of pivots found there.
    data.elimination.forget();
    data.reduced_at.fill(f64::NAN);
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

/// Tree velocities from the drives' `v_act` `[m/s | rad/s]`: `data.v`, and the bodies' velocities `data.velocity_w`. Independent
/// coordinates without a drive stand still. Call [`solve_positions`] first.
pub fn solve_velocities(model: &Model, data: &mut Data, v_act: &[f64]) {
    let mut v = core::mem::take(&mut data.v);
    expand_drives(model, data, v_act, &mut v);
    world_velocities(model, data, &v);
    data.v = v;
}

/// `out = G·x`, where `x` is given per drive; of more drives than freedoms in the least-squares sense.
fn expand_drives(model: &Model, data: &mut Data, x_act: &[f64], out: &mut [f64]) {
    let is_fitted = model.n_act() > data.n_ind() && fitted(model, data, x_act);
    let mut x = core::mem::take(&mut data.scratch);
    if !is_fitted {
        for (x, j) in x.iter_mut().zip(&data.independent) {
            *x = model.actuators.iter().position(|a| a == j).map_or(0.0, |k| x_act[k]);
        }
    }
    expand(data, &x, out);
    data.scratch = x;
}

/// Tree accelerations from the drives' `a_act` `[m/s² | rad/s²]`: `data.a`. Call [`solve_velocities`] first.
pub fn solve_accelerations(model: &Model, data: &mut Data, a_act: &[f64]) {
    let mut a = core::mem::take(&mut data.a);
    if !model.is_constrained() || model.n_act() <= data.n_ind() {
        expand_drives(model, data, a_act, &mut a);
        if model.is_constrained() {
            loop_drift(model, data);
            add_drift(data, &mut a);
        }
        data.a = a;
        return;
    }
    // What the velocities alone do to surplus drives is no acceleration of the freedoms.
    loop_drift(model, data);
    a.fill(0.0);
    add_drift(data, &mut a);
    let mut left = core::mem::take(&mut data.tau_act);
    for (left, (&j, given)) in left.iter_mut().zip(model.actuators.iter().zip(a_act)) {
        *left = given - a[j];
    }
    expand_drives(model, data, &left, &mut a);
    data.tau_act = left;
    add_drift(data, &mut a);
    data.a = a;
}

/// Gap, Jacobian and elimination for the poses in `data`, without solving.
pub(crate) fn factor_at(model: &Model, data: &mut Data) -> Closure {
    let mut out = Closure::of_tree();
    // Without drives, or with fewer than freedoms, a tree too has coordinates that the independent ones say nothing of.
    out.is_closed = data.dependent.is_empty();
    if model.is_constrained() {
        let q = core::mem::take(&mut data.q);
        gap_rows(model, data, &q);
        data.q = q;
        (out.gap, out.row) = largest(&data.loop_gap);
        jacobian_rows(model, data);
        factor(data);
        out.rank = data.elimination.rank();
        out.pivot_ratio = data.elimination.smallest_pivot_ratio();
        out.is_closed = out.rank == data.dependent.len() && out.gap.is_finite();
    }
    data.reduced_at.copy_from_slice(&data.q);
    out
}

/// Adds to `a` the accelerations of the dependent coordinates that the velocities alone cause.
pub(crate) fn add_drift(data: &mut Data, a: &mut [f64]) {
    let Data { loop_drift, elimination, dependent, step, .. } = data;
    let step = &mut step[..dependent.len()];
    elimination.solve(|i| -loop_drift[i], step);
    for (&j, s) in dependent.iter().zip(step.iter()) {
        a[j] += *s;
    }
}
