//! The algorithms of `pkm-dyn` sample by sample.

use std::thread;

use nalgebra::DMatrix;
use pkm_dyn::inverse_dynamics::{actuated_regressor, closed_loop_motion, friction_regressor, rigid_effort};
use pkm_dyn::loops::{Closure, assemble, walk_to};
use pkm_dyn::{Data, Model, loops, regressor, rnea};
use pkm_ident::bulk::{Bulk, LANES};
use pkm_ident::gram::{Gram, Products};
use pyo3::PyErr;

use crate::array::{Motion, Samples};
use crate::error;
use crate::mechanics::{push_loop_efforts, push_rows};

/// A drive that moves farther than this between two samples `[m | rad]` is walked there in small parts: over a long way one Newton
/// jump can land on another assembly of the same loops.
const FAR: f64 = 0.05;

/// Samples that are worth a thread.
const LEAST_SAMPLES: usize = 2048;

/// Loops that do not close, and at which sample.
pub(crate) struct Open {
    sample: Option<usize>,
    dependent: usize,
    closure: Closure,
}

impl From<Open> for PyErr {
    fn from(open: Open) -> Self {
        let Closure { gap, row, rank, iterations, .. } = open.closure;
        let at = open.sample.map_or("assembly".to_string(), |i| format!("sample {i}"));
        error::value(if rank == open.dependent && gap < 1e-9 {
            format!("{at}: not determined: a freedom has no inertia, or a number is not finite")
        } else if rank < open.dependent {
            format!("{at}: the drives determine {rank} of {} passive joints here (all are needed; loops {gap:.3e} open)", open.dependent)
        } else {
            format!("{at}: loops stay {gap:.3e} m or rad open in constraint row {row} after {iterations} iterations (limit 1e-9)")
        })
    }
}

/// The closure's failure as an error that names the sample.
pub(crate) fn checked(data: &Data, closure: Closure, sample: Option<usize>) -> Result<(), Open> {
    if closure.is_closed { Ok(()) } else { Err(Open { sample, dependent: data.dependent.len(), closure }) }
}

/// Tree coordinates near the stated assembly with every loop closed.
pub(crate) fn assembled(model: &Model) -> Result<Data, Open> {
    let mut data = Data::new(model);
    let closure = assemble(model, &mut data);
    checked(&data, closure, None)?;
    Ok(data)
}

/// Calls `each` after the tree motion of every sample is in the data.
fn along(model: &Model, motion: &Motion, mut each: impl FnMut(&mut Data)) -> Result<(), Open> {
    let mut data = assembled(model)?;
    for i in 0..motion.len() {
        let q = motion.q.row(i);
        let is_far = model.actuators.iter().zip(q).any(|(&j, q)| (q - data.q[j]).abs() > FAR);
        if is_far {
            let closure = walk_to(model, &mut data, q);
            checked(&data, closure, Some(i))?;
        }
        let closure = closed_loop_motion(model, &mut data, q, motion.v.row(i), motion.a.row(i));
        checked(&data, closure, Some(i))?;
        each(&mut data);
    }
    Ok(())
}

/// Calls `each` after the closed pose of every sample is in `data.q`.
pub(crate) fn along_positions(model: &Model, motion: &Motion, mut each: impl FnMut(&mut Data)) -> Result<(), Open> {
    along(model, motion, |data| each(data))
}

/// Efforts of the drives, `n_samples × drives`.
pub(crate) fn inverse_dynamics(model: &Model, motion: &Motion) -> Result<Vec<f64>, Open> {
    let mut out = Vec::with_capacity(motion.len() * model.n_act());
    along(model, motion, |data| {
        rigid_effort(model, data);
        out.extend_from_slice(&data.tau_act);
    })?;
    Ok(out)
}

/// Threads over parts of the samples of a robot whose samples do not need each other, so that each has work to do.
fn threads(samples: usize) -> usize {
    thread::available_parallelism().map_or(1, usize::from).min(samples / LEAST_SAMPLES).max(1)
}

/// Regressors of the independent coordinates, `n_samples × independent × 10·bodies`, into `out`.
///
/// Without loops no sample depends on the one before it, and every processor takes a part of them.
pub(crate) fn actuated_regressors(model: &Model, motion: &Motion, out: &mut [f64]) -> Result<(), Open> {
    let size = out.len() / motion.len().max(1);
    let Some(bulk) = Bulk::of(model) else {
        let mut rows = out.chunks_exact_mut(size.max(1));
        return along(model, motion, |data| {
            let all = actuated_regressor(model, data);
            if let Some(out) = rows.next() {
                copy_rows(out, all);
            }
        });
    };
    let samples = motion.len().div_ceil(threads(motion.len())).next_multiple_of(LANES);
    thread::scope(|scope| {
        let mut parts = out.chunks_mut(samples.max(1) * size.max(1)).enumerate();
        let own = parts.next();
        let write = |(k, out): (usize, &mut [f64])| {
            let from = k * samples;
            bulk.clone().write_all(motion.rows(from..from + out.len() / size), out);
        };
        for part in parts {
            scope.spawn(move || write(part));
        }
        own.map(write);
    });
    Ok(())
}

/// Parts that the samples of a robot without loops are summed in: as many whatever the processors, so that the sums are the same bits.
const PARTS: usize = 8;

/// Products of the regressors of [`actuated_regressors`] and efforts of the independent coordinates, nothing else kept.
pub(crate) fn products(model: &Model, motion: &Motion, tau: &Samples) -> Result<Products, Open> {
    let Some(bulk) = Bulk::of(model) else {
        let (mut sum, mut at) = (Gram::new(model), 0);
        along(model, motion, |data| {
            sum.push(actuated_regressor(model, data), tau.row(at));
            at += 1;
        })?;
        return Ok(sum.products());
    };
    let parts = PARTS.min(motion.len() / LEAST_SAMPLES).max(1);
    let threads = threads(motion.len()).min(parts);
    let part = |k: usize| {
        let samples = k * motion.len() / parts..(k + 1) * motion.len() / parts;
        let (mut sum, from, size) = (Gram::new(model), samples.start, bulk.size());
        bulk.clone().blocks(motion.rows(samples), |at, block| {
            block.chunks_exact(size).enumerate().for_each(|(l, one)| sum.push_rows(one, tau.row(from + at + l)));
        });
        sum
    };
    let own = |t: usize| (t..parts).step_by(threads).map(part).collect::<Vec<_>>();
    let by_thread: Vec<Vec<_>> = thread::scope(|scope| {
        let others: Vec<_> = (1..threads).map(|t| scope.spawn(move || own(t))).collect();
        let others: Vec<_> = core::iter::once(own(0))
            .chain(others.into_iter().map(|s| s.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))))
            .collect();
        others
    });
    let mut by_thread: Vec<_> = by_thread.into_iter().map(Vec::into_iter).collect();
    let mut all = Gram::new(model);
    (0..parts).filter_map(|k| by_thread[k % threads].next()).for_each(|sum| all.absorb(sum));
    Ok(all.products())
}

/// A matrix row by row into `out`.
fn copy_rows(out: &mut [f64], matrix: &DMatrix<f64>) {
    let n = matrix.ncols();
    for (j, column) in matrix.column_iter().enumerate() {
        for (i, x) in column.iter().enumerate() {
            out[i * n + j] = *x;
        }
    }
}

/// Columns of rotor inertia, viscous and Coulomb friction, `n_samples × independent × 3·nv`.
pub(crate) fn friction_regressors(model: &Model, motion: &Motion) -> Result<Vec<f64>, Open> {
    let mut out = Vec::new();
    along(model, motion, |data| push_rows(&mut out, friction_regressor(model, data)))?;
    Ok(out)
}

/// Efforts of the loops, `n_samples × rows`.
pub(crate) fn loop_efforts(model: &Model, motion: &Motion) -> Result<Vec<f64>, Open> {
    let mut out = Vec::new();
    along(model, motion, |data| push_loop_efforts(model, data, &mut out))?;
    Ok(out)
}

/// Wrenches of the joints of the tree, loops closed, `n_samples × nv × 6`.
pub(crate) fn joint_wrenches(model: &Model, motion: &Motion) -> Result<Vec<f64>, Open> {
    let (mut out, mut efforts) = (Vec::new(), Vec::new());
    along(model, motion, |data| {
        efforts.clear();
        push_loop_efforts(model, data, &mut efforts);
        let wrenches = loops::joint_wrenches(model, data);
        wrenches.iter().for_each(|w| out.extend(w.linear.iter().chain(w.angular.iter())));
    })?;
    Ok(out)
}

/// Wrenches of the loops, `n_samples × loops × 6`.
pub(crate) fn loop_wrenches(model: &Model, motion: &Motion) -> Result<Vec<f64>, Open> {
    let (mut out, mut efforts) = (Vec::new(), Vec::new());
    along(model, motion, |data| {
        efforts.clear();
        push_loop_efforts(model, data, &mut efforts);
        for l in 0..model.loops.len() {
            let wrench = loops::loop_wrench(model, data, l);
            out.extend(wrench.linear.iter().chain(wrench.angular.iter()));
        }
    })?;
    Ok(out)
}

/// A matrix at a pose whose loops are closed, left in the data.
pub(crate) type AtPose = for<'d> fn(&Model, &'d mut Data) -> &'d DMatrix<f64>;

/// A matrix of every pose, row by row, and its shape.
pub(crate) fn matrices_along(model: &Model, motion: &Motion, matrix: AtPose) -> Result<(Vec<f64>, [usize; 2]), Open> {
    // Of no pose at all the shape is still that of the robot.
    let (mut out, (rows, columns)) = (Vec::new(), matrix(model, &mut Data::new(model)).shape());
    along(model, motion, |data| push_rows(&mut out, matrix(model, data)))?;
    Ok((out, [rows, columns]))
}

/// Joint indices of the independent coordinates at every pose, `n_samples × independent`.
pub(crate) fn independents(model: &Model, motion: &Motion) -> Result<Vec<usize>, Open> {
    let mut out = Vec::new();
    along(model, motion, |data| out.extend_from_slice(&data.independent))?;
    Ok(out)
}

/// Positions, velocities and accelerations of the tree, `n_samples × nv` each.
pub(crate) fn tree_motion(model: &Model, motion: &Motion) -> Result<[Vec<f64>; 3], Open> {
    let mut out = [Vec::new(), Vec::new(), Vec::new()];
    along(model, motion, |data| {
        for (all, one) in out.iter_mut().zip([&data.q, &data.v, &data.a]) {
            all.extend_from_slice(one);
        }
    })?;
    Ok(out)
}

/// Efforts of the spanning tree, `n_samples × nv`.
pub(crate) fn tree_efforts(model: &Model, motion: &Motion) -> Vec<f64> {
    let mut data = Data::new(model);
    let mut out = Vec::with_capacity(motion.len() * model.nv());
    for i in 0..motion.len() {
        out.extend_from_slice(rnea::rnea(model, &mut data, motion.q.row(i), motion.v.row(i), motion.a.row(i)));
    }
    out
}

/// Regressors of the spanning tree, `n_samples × nv × 10·bodies`.
pub(crate) fn tree_regressors(model: &Model, motion: &Motion) -> Vec<f64> {
    let mut data = Data::new(model);
    let mut out = Vec::with_capacity(motion.len() * model.nv() * 10 * model.nv());
    for i in 0..motion.len() {
        let (q, v, a) = (motion.q.row(i), motion.v.row(i), motion.a.row(i));
        push_rows(&mut out, regressor::joint_torque_regressor(model, &mut data, q, v, a));
    }
    out
}
