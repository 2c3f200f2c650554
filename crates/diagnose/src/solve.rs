//! Ridge fits on sums of products, with one fold left out or none.

use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};

use crate::design::ColumnId;
use crate::gram::{Cross, Gram};

/// Which rows a sum runs over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Over<'j> {
    /// Every fitted row.
    All,
    /// Every fitted row but one fold's.
    AllBut(usize),
    /// One fold's rows.
    Only(usize),
    /// One fold's rows of some joints.
    OnlyJoints(usize, &'j [usize]),
}

impl Over<'_> {
    fn has_joint(self, joint: usize) -> bool {
        !matches!(self, Self::OnlyJoints(_, joints) if !joints.contains(&joint))
    }
}

/// Sum of products of `rows` with `columns`, in scaled units.
pub(crate) fn products(gram: &Gram, rows: &[ColumnId], columns: &[ColumnId], over: Over) -> Mat<f64> {
    let mut out = Mat::zeros(rows.len(), columns.len());
    for j in (0..gram.active.len()).filter(|&j| over.has_joint(j)) {
        let local = |ids: &[ColumnId]| -> Vec<(usize, usize)> {
            ids.iter().enumerate().filter_map(|(i, &id)| gram.local[j][id].map(|l| (i, l))).collect()
        };
        let (r, c) = (local(rows), local(columns));
        if r.is_empty() || c.is_empty() {
            continue;
        }
        for &(cj, lc) in &c {
            for &(ri, lr) in &r {
                out[(ri, cj)] += match over {
                    Over::All => gram.xx_all[j][(lr, lc)],
                    // The held-out fold is in no sum over fitted rows, so there is nothing to take off.
                    Over::AllBut(f) if f == gram.n_folds => gram.xx_all[j][(lr, lc)],
                    Over::AllBut(f) => gram.xx_all[j][(lr, lc)] - gram.xx[f][j][(lr, lc)],
                    Over::Only(f) | Over::OnlyJoints(f, _) => gram.xx[f][j][(lr, lc)],
                };
            }
        }
    }
    for (j, &cid) in columns.iter().enumerate() {
        for (i, &rid) in rows.iter().enumerate() {
            out[(i, j)] *= gram.scale[rid] * gram.scale[cid];
        }
    }
    out
}

/// Products of `rows` with every target, in scaled units.
pub(crate) fn targets(gram: &Gram, cross: &Cross, rows: &[ColumnId], over: Over) -> Mat<f64> {
    let n_targets = cross.xy_all.first().map_or(0, Mat::ncols);
    let mut out = Mat::zeros(rows.len(), n_targets);
    for j in (0..gram.active.len()).filter(|&j| over.has_joint(j)) {
        let local: Vec<(usize, usize)> = rows.iter().enumerate().filter_map(|(i, &id)| gram.local[j][id].map(|l| (i, l))).collect();
        let (sum, less) = match over {
            Over::All => (&cross.xy_all[j], None),
            Over::AllBut(f) => (&cross.xy_all[j], (f < gram.n_folds).then(|| &cross.xy[f][j])),
            Over::Only(f) | Over::OnlyJoints(f, _) => (&cross.xy[f][j], None),
        };
        for b in 0..n_targets {
            let (to, sum) = (out.col_as_slice_mut(b), sum.col_as_slice(b));
            match less.map(|x| x.col_as_slice(b)) {
                Some(less) => local.iter().for_each(|&(i, l)| to[i] += sum[l] - less[l]),
                None => local.iter().for_each(|&(i, l)| to[i] += sum[l]),
            }
        }
    }
    for b in 0..n_targets {
        for (i, &id) in rows.iter().enumerate() {
            out[(i, b)] *= gram.scale[id];
        }
    }
    out
}

/// Rounding share added to the diagonal, so that columns that repeat each other do not break the factorisation.
const JITTER: f64 = 1e-10;

/// A factored set of columns on some rows.
pub(crate) struct Factor {
    llt: Option<Llt<f64>>,
    n: usize,
}

impl Factor {
    /// Factors `products + diag(prior)`; `prior` is the inverse prior variance in scaled units.
    pub(crate) fn new(mut g: Mat<f64>, prior: &[f64]) -> Self {
        let n = g.nrows();
        for i in 0..n {
            let own = g[(i, i)];
            g[(i, i)] += prior[i] + JITTER * own.max(1.0);
        }
        Self { llt: if n == 0 { None } else { g.llt(Side::Lower).ok() }, n }
    }

    /// Solves for several right-hand sides; zero when the set is empty or cannot be factored.
    pub(crate) fn solve(&self, rhs: &Mat<f64>) -> Mat<f64> {
        self.llt.as_ref().map_or_else(|| Mat::zeros(self.n, rhs.ncols()), |llt| llt.solve(rhs))
    }
}
