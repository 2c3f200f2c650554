//! Reduction of the tree to its drives.

use crate::data::Data;
use crate::model::Model;

/// `G = dv_tree/dv_act` at the pose of the last [`crate::loops::solve_positions`], nv × drives: `data.reduction`.
///
/// `J·G = 0`, so the unknown loop forces drop out of `Gᵀ·tau_tree` and no sensor in a passive joint is needed [Valera2017, eq. 2].
pub fn reduction<'d>(model: &Model, data: &'d mut Data) -> &'d nalgebra::DMatrix<f64> {
    data.reduction.fill(0.0);
    for (k, &j) in model.actuators.iter().enumerate() {
        data.reduction[(j, k)] = 1.0;
    }
    if model.is_constrained() {
        let Data { loop_jacobian, elimination, passive, step, reduction, .. } = data;
        for (k, &driven) in model.actuators.iter().enumerate() {
            elimination.solve(|i| -loop_jacobian[(i, driven)], step);
            for (&j, s) in passive.iter().zip(step.iter()) {
                reduction[(j, k)] = *s;
            }
        }
    }
    &data.reduction
}
