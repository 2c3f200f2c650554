//! Screening: what each candidate would gain on blocks it was not fitted on, for the recording and for null runs alike.

use faer::{ColRef, Mat};
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
    /// On the fold's rows: all joints, then each joint.
    parts: Vec<Part>,
}

/// Products of the base's columns among themselves and with what is left, on some rows.
#[derive(Clone)]
struct Part {
    own: Mat<f64>,
    left: Mat<f64>,
}

impl FoldBase {
    /// Products on the fold's rows of some joints.
    fn part(&self, joints: &[usize]) -> Option<Part> {
        let mut each = joints.iter().map(|&j| &self.parts[1 + j]);
        let mut sum = each.next()?.clone();
        for part in each {
            sum.own += &part.own;
            sum.left += &part.left;
        }
        Some(sum)
    }
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
                    Part { own, left }
                };
                let joints: Vec<usize> = (0..gram.active.len()).collect();
                let mut parts = vec![part(Over::Only(f))];
                parts.extend(joints.chunks(1).map(|j| part(Over::OnlyJoints(f, j))));
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
#[derive(Default)]
pub(crate) struct Gains {
    /// Over all joints: [fold][target].
    pub(crate) all: Vec<Vec<f64>>,
    /// What it would be over all joints if the fold held the effect as it was fitted on the others: squared length of what the base cannot
    /// imitate, [fold][target].
    pub(crate) due: Vec<Vec<f64>>,
    /// Over the joints it acts on, summed over the folds: [target].
    pub(crate) scope: Vec<f64>,
}

/// Columns that are fitted together on top of a base, with their inverse prior variances.
pub(crate) struct Set {
    pub(crate) columns: Vec<ColumnId>,
    pub(crate) prior: Vec<f64>,
}

/// Fits `columns` on top of `base` on all but each fold and judges on that fold; `scope` are the joints they act on, all when empty.
pub(crate) fn gains(gram: &Gram, cross: &Cross, base: &Base, columns: &[ColumnId], prior: &[f64], scope: &[usize]) -> Gains {
    let set = Set { columns: columns.to_vec(), prior: prior.to_vec() };
    gains_each(gram, cross, base, &[set], scope).pop().unwrap_or_default()
}

/// The same of several sets, each alone: what they share with the base is computed for all of them at once.
pub(crate) fn gains_each(gram: &Gram, cross: &Cross, base: &Base, sets: &[Set], scope: &[usize]) -> Vec<Gains> {
    let mut ids: Vec<ColumnId> = sets.iter().flat_map(|s| s.columns.iter().copied()).collect();
    ids.sort_unstable();
    ids.dedup();
    let at: Vec<Vec<usize>> = sets.iter().map(|s| s.columns.iter().filter_map(|id| ids.binary_search(id).ok()).collect()).collect();
    let mut out: Vec<Gains> = sets.iter().map(|_| Gains::default()).collect();
    // Where candidates act on every row, their rows are all rows.
    let is_everywhere = scope.is_empty() || scope.len() == gram.active.len();
    for fold in &base.folds {
        let f = fold.fold;
        let beside = Beside::new(gram, cross, (base, fold), &ids);
        let all = beside.on(&fold.parts[0], Over::Only(f));
        let part = fold.part(scope).filter(|_| !is_everywhere);
        let there = part.as_ref().map(|part| beside.on(part, Over::OnlyJoints(f, scope)));
        for ((set, at), out) in sets.iter().zip(&at).zip(&mut out) {
            let fitted = beside.fit(set, at);
            let (taken, due) = beside.taken(&all, set, at, &fitted);
            let within = there.as_ref().map_or_else(|| taken.clone(), |there| beside.taken(there, set, at, &fitted).0);
            out.scope.resize(within.len(), 0.0);
            out.scope.iter_mut().zip(within).for_each(|(sum, t)| *sum += t);
            out.all.push(taken);
            out.due.push(due);
        }
    }
    out
}

/// Columns less what the base imitates of them, the base fitted on all but one fold.
struct Beside<'a> {
    gram: &'a Gram,
    cross: &'a Cross,
    base: &'a Base,
    fold: &'a FoldBase,
    ids: &'a [ColumnId],
    /// Coefficients of the base that imitate each column: base × columns.
    imitating: Mat<f64>,
    fitted_on: On<'a>,
}

/// Such columns on some rows.
struct On<'j> {
    over: Over<'j>,
    /// With what the base leaves: columns × targets.
    linear: Mat<f64>,
    /// The base's columns with these: base × columns.
    with: Mat<f64>,
    /// The base's columns with what they imitate of these: base × columns.
    moved: Mat<f64>,
}

impl<'a> Beside<'a> {
    fn new(gram: &'a Gram, cross: &'a Cross, (base, fold): (&'a Base, &'a FoldBase), ids: &'a [ColumnId]) -> Self {
        let over = Over::AllBut(fold.fold);
        let with = products(gram, &base.columns, ids, over);
        let imitating = fold.factor.solve(&with);
        let linear = targets(gram, cross, ids, over) - with.transpose() * &fold.coefficients;
        // What was fitted on imitates as well as it can, priors included.
        let fitted_on = On { over, linear, moved: with.clone(), with };
        Self { gram, cross, base, fold, ids, imitating, fitted_on }
    }

    /// The columns on the rows of `part`.
    fn on<'j>(&self, part: &Part, over: Over<'j>) -> On<'j> {
        let with = products(self.gram, &self.base.columns, self.ids, over);
        let left = targets(self.gram, self.cross, self.ids, over) - with.transpose() * &self.fold.coefficients;
        On { over, linear: left - self.imitating.transpose() * &part.left, with, moved: &part.own * &self.imitating }
    }

    /// Coefficients of a set, the base's own fitted along: columns × targets.
    fn fit(&self, set: &Set, at: &[usize]) -> Mat<f64> {
        let linear = &self.fitted_on.linear;
        let own = Mat::from_fn(at.len(), linear.ncols(), |i, b| linear[(at[i], b)]);
        Factor::new(self.square(&self.fitted_on, set, at), &set.prior).solve(&own)
    }

    /// Products of a set's columns among themselves.
    fn square(&self, on: &On, set: &Set, at: &[usize]) -> Mat<f64> {
        let plain = products(self.gram, &set.columns, &set.columns, on.over);
        let imitated = |m: &Mat<f64>, i: usize, k: usize| dot(m.col(at[i]), self.imitating.col(at[k]));
        Mat::from_fn(at.len(), at.len(), |i, k| {
            plain[(i, k)] - imitated(&on.with, i, k) - imitated(&on.with, k, i) + imitated(&on.moved, i, k)
        })
    }

    /// Squared error that fitted coefficients of a set take away, and that they would if they were right, per target.
    fn taken(&self, on: &On, set: &Set, at: &[usize], fitted: &Mat<f64>) -> (Vec<f64>, Vec<f64>) {
        let moved = self.square(on, set, at) * fitted;
        let sum = |b: usize, of: &dyn Fn(usize) -> f64| (0..at.len()).map(|i| fitted[(i, b)] * of(i)).sum::<f64>();
        let due: Vec<f64> = (0..fitted.ncols()).map(|b| sum(b, &|i| moved[(i, b)])).collect();
        let taken = due.iter().enumerate().map(|(b, due)| 2.0 * sum(b, &|i| on.linear[(at[i], b)]) - due).collect();
        (taken, due)
    }
}

fn dot(a: ColRef<f64>, b: ColRef<f64>) -> f64 {
    a.iter().zip(b.iter()).map(|(x, y)| x * y).sum()
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

/// Columns with their coefficients on all fitted rows.
pub(crate) struct Fitted {
    columns: Vec<ColumnId>,
    coefficients: Mat<f64>,
}

impl Fitted {
    /// Fits `columns` to the first target, with inverse prior variances `prior`.
    pub(crate) fn new(gram: &Gram, cross: &Cross, columns: Vec<ColumnId>, prior: &[f64]) -> Self {
        let coefficients = fit(gram, cross, &columns, prior, Over::All);
        Self { columns, coefficients }
    }

    /// Coefficient of a column, in physical units; 0 when it is not in the fit.
    pub(crate) fn coefficient(&self, id: ColumnId) -> f64 {
        self.columns.iter().position(|&i| i == id).map_or(0.0, |i| self.coefficients[(i, 0)])
    }
}

#[cfg(test)]
mod tests {
    use pkm_dyn::effects::Robot;

    use super::*;
    use crate::design::Design;
    use crate::testing::Bench;
    use crate::work::Work;

    #[test]
    fn what_sets_take_away_is_what_the_error_falls_by_when_each_joins_the_base() {
        let Bench { model, motion } = Bench::pair();
        let robot = Robot { model, effects: Vec::new() };
        let mut motions = vec![motion];
        let design = Design::new(&robot, &motions, 5.0);
        let work = Work::new(&robot, &mut motions, design, 5.0, None);
        let wave = |j: usize, i: usize, t: usize| pkm_dyn::math::sin((0.05 + 0.02 * t as f64) * (i * i) as f64 / 40.0 + j as f64);
        let rows = work.design.rows[0].time.len();
        let target = |t: usize| (0..2).map(|j| vec![(0..rows).map(|i| wave(j, i, t)).collect()]).collect();
        let cross = work.gram.cross(&work.design, &(0..3).map(target).collect());
        let (columns, prior) = work.with_rigid(work.every_model_has(0), 0.5);
        let base = Base::new(&work.gram, &cross, &columns, &prior);
        // What the others imitate but for rounding is not determined, and two ways of computing it need not agree. What acts in one block only is no better
        // where that block is left out, so it is asked of every fold.
        let stays = |own: &[ColumnId]| {
            own.iter().enumerate().all(|(i, &id)| {
                let ids = [&columns[..], &own[..i], &own[i + 1..]].concat();
                let loose = [&prior[..], &vec![0.0; own.len() - 1]].concat();
                let beside = Base::new(&work.gram, &cross, &ids, &loose);
                let (set, least) =
                    (Set { columns: vec![id], prior: vec![0.0] }, 0.01 * (0..2).map(|j| work.gram.power(id, j)).sum::<f64>());
                let left = |fold: &FoldBase| {
                    let b = Beside::new(&work.gram, &cross, (&beside, fold), &set.columns);
                    b.square(&b.fitted_on, &set, &[0])[(0, 0)]
                };
                beside.folds.iter().all(|fold| left(fold) > least)
            })
        };
        for scope in [vec![0], vec![1], vec![0, 1]] {
            let acting = work.candidates.iter().filter(|c| c.scope == scope).flat_map(|c| &c.variants);
            let sets: Vec<Set> = acting
                .map(|v| crate::contest::own_columns(&work, v, &columns))
                .filter(|(own, _)| !own.is_empty() && stays(own))
                .map(|(columns, prior)| Set { columns, prior })
                .collect();
            assert!(sets.len() > 3, "{scope:?}");
            for (set, gains) in sets.iter().zip(gains_each(&work.gram, &cross, &base, &sets, &scope)) {
                let (ids, priors) = ([&columns[..], &set.columns].concat(), [&prior[..], &set.prior].concat());
                let joined = Base::new(&work.gram, &cross, &ids, &priors);
                for t in 0..3 {
                    let is_near = |a: f64, b: f64| (a - b).abs() < 1e-4 * base.total(t);
                    let falls = base.over(&scope, t) - joined.over(&scope, t);
                    assert!(is_near(gains.scope[t], falls), "{} instead of {falls} over {scope:?}", gains.scope[t]);
                    let all: f64 = gains.all.iter().map(|f| f[t]).sum();
                    let falls = base.total(t) - joined.total(t);
                    assert!(is_near(all, falls), "{all} instead of {falls} over all rows");
                }
            }
        }
    }
}
