//! Screening: what each candidate would gain on blocks it was not fitted on, for the recording and for null runs alike.

use faer::Mat;
use rayon::prelude::*;

use crate::design::ColumnId;
use crate::gram::{Cross, Gram};
use crate::solve::{Factor, Over, products, targets};

/// A set of columns every candidate is fitted together with, solved once per fold.
pub(crate) struct Base {
    pub(crate) columns: Vec<ColumnId>,
    folds: Vec<FoldBase>,
    /// Held-out squared error per fold, joint and target: [fold][joint][target].
    pub(crate) sse: Vec<Vec<Vec<f64>>>,
}

struct FoldBase {
    fold: usize,
    factor: Factor,
    coefficients: Mat<f64>,
    /// Products of the columns among themselves and with what is left, on the fold's rows: all joints, then each joint.
    parts: Vec<(Mat<f64>, Mat<f64>)>,
}

impl Base {
    /// Fits `columns` with inverse prior variances `prior` (scaled units) on all but each fold.
    pub(crate) fn new(gram: &Gram, cross: &Cross, columns: &[ColumnId], prior: &[f64]) -> Self {
        Self::on_folds(gram, cross, columns, prior, 0..gram.n_folds)
    }

    /// Fits on every fold and judges on what is held out: one fold.
    pub(crate) fn held_out(gram: &Gram, cross: &Cross, columns: &[ColumnId], prior: &[f64]) -> Self {
        Self::on_folds(gram, cross, columns, prior, gram.n_folds..gram.n_folds + 1)
    }

    fn on_folds(gram: &Gram, cross: &Cross, columns: &[ColumnId], prior: &[f64], which: core::ops::Range<usize>) -> Self {
        let folds: Vec<FoldBase> = which
            .into_par_iter()
            .map(|f| {
                let factor = Factor::new(products(gram, columns, columns, Over::AllBut(f)), prior);
                let coefficients = factor.solve(&targets(gram, cross, columns, Over::AllBut(f)));
                let part = |over| {
                    let own = products(gram, columns, columns, over);
                    let left = targets(gram, cross, columns, over) - &own * &coefficients;
                    (own, left)
                };
                let mut parts = vec![part(Over::Only(f))];
                parts.extend((0..gram.active.len()).map(|j| part(Over::OnlyJoint(f, j))));
                FoldBase { fold: f, factor, coefficients, parts }
            })
            .collect();
        let sse = folds.par_iter().map(|fold| fold_errors(gram, cross, columns, fold.fold, &fold.coefficients)).collect();
        Self { columns: columns.to_vec(), folds, sse }
    }

    /// Held-out squared error of a target, over folds and joints.
    pub(crate) fn total(&self, target: usize) -> f64 {
        self.sse.iter().flatten().map(|t| t[target]).sum()
    }

    /// Held-out squared error of a target over some joints.
    pub(crate) fn over(&self, joints: &[usize], target: usize) -> f64 {
        self.sse.iter().map(|fold| joints.iter().map(|&j| fold[j][target]).sum::<f64>()).sum()
    }
}

fn fold_errors(gram: &Gram, cross: &Cross, columns: &[ColumnId], f: usize, coefficients: &Mat<f64>) -> Vec<Vec<f64>> {
    let n_targets = coefficients.ncols();
    (0..gram.active.len())
        .map(|j| {
            let local: Vec<(usize, usize)> = columns.iter().enumerate().filter_map(|(i, &id)| gram.local[j][id].map(|l| (i, l))).collect();
            let scale = |i: usize| gram.scale[columns[i]];
            let xx = Mat::from_fn(local.len(), local.len(), |a, b| {
                gram.xx[f][j][(local[a].1, local[b].1)] * scale(local[a].0) * scale(local[b].0)
            });
            let c = Mat::from_fn(local.len(), n_targets, |a, b| coefficients[(local[a].0, b)]);
            let xc = &xx * &c;
            (0..n_targets)
                .map(|b| {
                    let fit: f64 = (0..local.len())
                        .map(|a| c[(a, b)] * (xc[(a, b)] - 2.0 * scale(local[a].0) * cross.xy[f][j][(local[a].1, b)]))
                        .sum();
                    (cross.yy[f][j][b] + fit).max(0.0)
                })
                .collect()
        })
        .collect()
}

/// Held-out squared error a candidate takes away.
pub(crate) struct Gains {
    /// Over all joints: [fold][target].
    pub(crate) all: Vec<Vec<f64>>,
    /// Over the joints it acts on: [fold][target].
    pub(crate) scope: Vec<Vec<f64>>,
}

/// Fits `columns` on top of `base` on all but each fold and judges on that fold; `scope` are the joints they act on.
pub(crate) fn gains(gram: &Gram, cross: &Cross, base: &Base, columns: &[ColumnId], prior: &[f64], scope: &[usize]) -> Gains {
    let mut out = Gains { all: Vec::new(), scope: Vec::new() };
    for fold in &base.folds {
        let f = fold.fold;
        let with = products(gram, &base.columns, columns, Over::AllBut(f));
        let a = fold.factor.solve(&with);
        let own = products(gram, columns, columns, Over::AllBut(f)) - with.transpose() * &a;
        let rhs = targets(gram, cross, columns, Over::AllBut(f)) - with.transpose() * &fold.coefficients;
        let g = Factor::new(own, prior).solve(&rhs);
        let judge = |over: Over, (own, left): &(Mat<f64>, Mat<f64>)| -> Vec<f64> {
            let with = products(gram, &base.columns, columns, over);
            let bent = with.transpose() * &a;
            let square = products(gram, columns, columns, over) - &bent - bent.transpose() + a.transpose() * (own * &a);
            let linear = targets(gram, cross, columns, over) - with.transpose() * &fold.coefficients - a.transpose() * left;
            let moved = &square * &g;
            (0..g.ncols()).map(|b| (0..columns.len()).map(|i| g[(i, b)] * (2.0 * linear[(i, b)] - moved[(i, b)])).sum()).collect()
        };
        let all = judge(Over::Only(f), &fold.parts[0]);
        // Where a candidate acts on every row, its rows are all rows.
        out.scope.push(if scope.is_empty() || scope.len() == gram.active.len() {
            all.clone()
        } else {
            let each: Vec<Vec<f64>> = scope.iter().map(|&j| judge(Over::OnlyJoint(f, j), &fold.parts[1 + j])).collect();
            (0..all.len()).map(|b| each.iter().map(|part| part[b]).sum()).collect()
        });
        out.all.push(all);
    }
    out
}

/// Coefficients of `columns` on the rows of `over`, in physical units: columns × targets.
pub(crate) fn fit(gram: &Gram, cross: &Cross, columns: &[ColumnId], prior: &[f64], over: Over) -> Mat<f64> {
    let factor = Factor::new(products(gram, columns, columns, over), prior);
    let mut c = factor.solve(&targets(gram, cross, columns, over));
    for (i, &id) in columns.iter().enumerate() {
        for b in 0..c.ncols() {
            c[(i, b)] *= gram.scale[id];
        }
    }
    c
}
