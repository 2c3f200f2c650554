//! Reduction of the tree to its independent coordinates.

use crate::data::Data;
use crate::model::Model;

/// `G = dv_tree/dv_ind` at the pose of the last [`crate::loops::solve_positions`], nv × independent: `data.reduction`.
///
/// `J·G = 0`, so the unknown loop forces drop out of `Gᵀ·tau_tree` and no sensor in a passive joint is needed [Valera2017, eq. 2].
pub fn reduction<'d>(model: &Model, data: &'d mut Data) -> &'d nalgebra::DMatrix<f64> {
    if model.is_constrained() {
        let Data { loop_jacobian, elimination, independent, dependent, step, reduction, .. } = data;
        let step = &mut step[..dependent.len()];
        for (k, &j) in independent.iter().enumerate() {
            let column = loop_jacobian.column(j);
            elimination.solve(|i| -column[i], step);
            let mut out = reduction.column_mut(k);
            for (&d, s) in dependent.iter().zip(step.iter()) {
                out[d] = *s;
            }
        }
    }
    &data.reduction
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
