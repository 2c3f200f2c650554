//! Reduction of the tree to its independent coordinates.

use crate::data::Data;
use crate::model::Model;

/// `data.reduction`, `G = dv_tree/dv_ind`, from the loops' Jacobian and its elimination.
///
/// `J·G = 0`, so the unknown loop forces drop out of `Gᵀ·tau_tree` and no sensor in a passive joint is needed [Valera2017, eq. 2].
pub(crate) fn reduce(model: &Model, data: &mut Data) {
    if model.is_constrained() {
        let Data { loop_jacobian, elimination, independent, dependent, reduction, .. } = data;
        let (rows, nv) = (loop_jacobian.nrows(), reduction.nrows());
        let (jacobian, out) = (loop_jacobian.as_slice(), reduction.as_mut_slice());
        let right = |i: usize, k: usize| -jacobian[independent[k] * rows + i];
        elimination.solve_many(independent.len(), right, |j, k, x| out[k * nv + dependent[j]] = x);
    }
}

/// `out = G·x` with `x` per independent coordinate.
pub(crate) fn expand(data: &Data, x: &[f64], out: &mut [f64]) {
    out.fill(0.0);
    for (column, x) in data.reduction.column_iter().zip(x) {
        for (o, g) in out.iter_mut().zip(column.iter()) {
            *o += g * x;
        }
    }
}

/// `Gᵀ·tau`, one per independent coordinate, written to `out`.
pub(crate) fn reduced(data: &Data, tau: &[f64], out: &mut [f64]) {
    for (o, column) in out.iter_mut().zip(data.reduction.column_iter()) {
        *o = column.iter().zip(tau).map(|(g, t)| g * t).sum();
    }
}
