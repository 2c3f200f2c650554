//! More drives than freedoms: how the drives share an effort, and what they can do to each other without moving anything.

use nalgebra::DMatrix;

use crate::data::Data;
use crate::model::Model;
use crate::small;

/// `B` with `v_act = B·v_ind` at the pose of the last [`crate::loops::solve_positions`], drives × independent: `data.drive_jacobian`.
///
/// The identity unless there are more drives than freedoms.
pub fn drive_jacobian<'d>(model: &Model, data: &'d mut Data) -> &'d DMatrix<f64> {
    for (i, &j) in model.actuators.iter().enumerate() {
        for k in 0..data.n_ind() {
            data.drive_jacobian[(i, k)] = data.reduction[(j, k)];
        }
    }
    &data.drive_jacobian
}

/// Efforts of the drives that supply `data.tau_ind`, `Bᵀ·tau_act = tau_ind`: `data.tau_act` `[N | N·m]`.
///
/// Of more drives than freedoms the smallest such efforts, `tau_act = B·(Bᵀ·B)⁻¹·tau_ind`: the pseudo-inverse of [McDaid, eq. 8.2];
/// any sum of [`internal_efforts`] may be added. Where an independent coordinate has no drive, its effort is left out.
pub fn distribute(model: &Model, data: &mut Data) {
    if data.independent == model.actuators {
        data.tau_act.copy_from_slice(&data.tau_ind);
        return;
    }
    if model.n_act() < data.n_ind() || !gram(model, data) {
        let Data { independent, tau_ind, tau_act, .. } = data;
        for (effort, drive) in tau_act.iter_mut().zip(&model.actuators) {
            *effort = independent.iter().position(|j| j == drive).map_or(0.0, |k| tau_ind[k]);
        }
        return;
    }
    let Data { gram, scratch, tau_ind, tau_act, drive_jacobian, .. } = data;
    let x = &mut scratch[..tau_ind.len()];
    x.copy_from_slice(tau_ind);
    small::solve(gram, x);
    for (i, effort) in tau_act.iter_mut().enumerate() {
        *effort = x.iter().enumerate().map(|(k, x)| drive_jacobian[(i, k)] * x).sum();
    }
}

/// The factor of `Bᵀ·B` in `data.gram`; whether the drives hold every freedom.
fn gram(model: &Model, data: &mut Data) -> bool {
    drive_jacobian(model, data);
    let Data { gram, drive_jacobian, .. } = data;
    gram.gemm_tr(1.0, drive_jacobian, drive_jacobian, 0.0);
    small::cholesky(gram)
}

/// Least-squares motion of the independent coordinates for one given per drive, `(Bᵀ·B)⁻¹·Bᵀ·x_act`, in `data.scratch`; whether the
/// drives determine it.
pub(crate) fn fitted(model: &Model, data: &mut Data, x_act: &[f64]) -> bool {
    let is_sound = gram(model, data);
    let Data { gram, scratch, drive_jacobian, .. } = data;
    let x = &mut scratch[..drive_jacobian.ncols()];
    for (x, column) in x.iter_mut().zip(drive_jacobian.column_iter()) {
        *x = column.iter().zip(x_act).map(|(b, x)| b * x).sum();
    }
    if is_sound {
        small::solve(gram, x);
    }
    is_sound
}

/// `D` with `tau_act = D·tau_ind` at the pose of the last [`crate::loops::solve_positions`], drives × independent: `data.distribution`.
///
/// Of more drives than freedoms `D = B·(Bᵀ·B)⁻¹`, the smallest efforts ([`distribute`]); zero where the drives do not hold every freedom.
/// The identity where the drives are the independent coordinates.
pub fn distribution<'d>(model: &Model, data: &'d mut Data) -> &'d DMatrix<f64> {
    if model.n_act() <= data.n_ind() {
        for (i, drive) in model.actuators.iter().enumerate() {
            for (k, j) in data.independent.iter().enumerate() {
                data.distribution[(i, k)] = f64::from(u8::from(drive == j));
            }
        }
        return &data.distribution;
    }
    let is_sound = gram(model, data);
    let Data { gram, scratch, drive_jacobian, distribution, .. } = data;
    let (n, n_ind) = drive_jacobian.shape();
    let x = &mut scratch[..n_ind];
    for i in 0..n {
        for (k, x) in x.iter_mut().enumerate() {
            *x = if is_sound { drive_jacobian[(i, k)] } else { 0.0 };
        }
        if is_sound {
            small::solve(gram, x);
        }
        for (k, x) in x.iter().enumerate() {
            distribution[(i, k)] = *x;
        }
    }
    &data.distribution
}

/// `R = G·Dᵀ` at the pose of the last [`crate::loops::solve_positions`], nv × drives: motion of each joint of the tree per motion of each
/// drive, and by `Rᵀ·tau` the effort of each drive under efforts of the tree: `data.drive_reduction`, [`distribution`] beside it.
///
/// The reduction itself where the drives are the independent coordinates. Of more drives than freedoms a drive's motion moves the others
/// in the least-squares sense, and the rows of the drives are `P = B·(Bᵀ·B)⁻¹·Bᵀ`, which keeps what moves the robot of the drives'
/// efforts and takes [`internal_efforts`] away.
pub fn drive_reduction<'d>(model: &Model, data: &'d mut Data) -> &'d DMatrix<f64> {
    distribution(model, data);
    let Data { reduction, distribution, drive_reduction, .. } = data;
    drive_reduction.fill(0.0);
    for i in 0..distribution.nrows() {
        for k in 0..distribution.ncols() {
            let share = distribution[(i, k)];
            if share.abs() > 0.0 {
                for j in 0..reduction.nrows() {
                    drive_reduction[(j, i)] += reduction[(j, k)] * share;
                }
            }
        }
    }
    &data.drive_reduction
}

/// Efforts of the drives that move nothing, `Bᵀ·tau_act = 0`, as orthonormal columns, drives × (drives − freedoms):
/// `data.internal_efforts`. The largest entry of a column is positive.
///
/// For the 4-UPS robot the one column is `v0` of [McDaid, eq. 8.7]: the legs pull the platform together.
pub fn internal_efforts<'d>(model: &Model, data: &'d mut Data) -> &'d DMatrix<f64> {
    let (n, found) = (model.n_act(), data.internal_efforts.ncols());
    if found == 0 || !gram(model, data) {
        data.internal_efforts.fill(0.0);
        return &data.internal_efforts;
    }
    for column in 0..found {
        // Of the unit efforts, the one that the drives' motion and the columns so far leave most of.
        let mut best = (0.0, 0);
        for unit in 0..n {
            let left = remainder(data, unit, column);
            if left > best.0 {
                best = (left, unit);
            }
        }
        let _ = remainder(data, best.1, column);
        let largest = data.scratch[..n].iter().fold(0.0_f64, |top, x| if x.abs() > top.abs() { *x } else { top });
        let length = crate::math::sqrt(best.0) * crate::math::sign(largest);
        for i in 0..n {
            data.internal_efforts[(i, column)] = data.scratch[i] / length;
        }
    }
    &data.internal_efforts
}

/// What is left of the effort of drive `unit` alone when its motion part and the first `columns` columns are taken away, in
/// `data.scratch`; its square.
fn remainder(data: &mut Data, unit: usize, columns: usize) -> f64 {
    let Data { gram, scratch, step, drive_jacobian, internal_efforts, .. } = data;
    let (n, n_ind) = drive_jacobian.shape();
    let (x, out) = (&mut step[..n_ind], &mut scratch[..n]);
    for k in 0..n_ind {
        x[k] = drive_jacobian[(unit, k)];
    }
    small::solve(gram, x);
    for (i, o) in out.iter_mut().enumerate() {
        let moves: f64 = (0..n_ind).map(|k| drive_jacobian[(i, k)] * x[k]).sum();
        let taken: f64 = (0..columns).map(|c| internal_efforts[(unit, c)] * internal_efforts[(i, c)]).sum();
        *o = f64::from(u8::from(i == unit)) - moves - taken;
    }
    out.iter().map(|x| x * x).sum()
}
