//! Base parameters as readable combinations: which parameters are kept, which are eliminated, and into which kept ones they go.
//!
//! Columns that depend on others are eliminated: with `W_e = W_k·B` the effort `W_k·θ_k + W_e·θ_e` depends on `θ_k + B·θ_e` alone \[Gautier1991\].
//! Any set of independent columns will do for prediction, but not for numbers: the choice of the eliminated set changes the condition of
//! what is left by orders of magnitude. Pivoted QR gives a good set, exchanges of one kept for one eliminated column improve it.

use faer::Mat;
use faer::linalg::solvers::SolveLstsq;
use pkm_dyn::effects::Robot;
use pkm_dyn::inverse_dynamics::closed_loop_motion;
use pkm_dyn::{Data, math};

use crate::base::{ACCELERATION, BaseError, Range, SPEED};
use crate::columns::Columns;
use crate::factor::Factor;

/// A column shorter than this share of the longest one does not act at all: it is rounding.
const ACTS: f64 = 1e-10;

/// Coefficients of the grouping below this share of the largest in scaled units are rounding.
const COEFFICIENT: f64 = 1e-8;

/// Exchanges below this entry of the scaled grouping shrink the volume of the kept columns tenfold: not tried.
const EXCHANGE: f64 = 0.1;

/// Condition numbers computed while looking for a better set, at most.
const TRIES: usize = 600;

/// A set of independent columns and how the others go into it. Indices are those of the columns.
#[derive(Debug, Clone)]
pub struct BaseSet {
    /// Independent columns, ascending.
    pub kept: Vec<usize>,
    /// Columns that depend on them, ascending.
    pub eliminated: Vec<usize>,
    /// Columns that are zero.
    pub silent: Vec<usize>,
    /// `θ_base = θ_kept + grouping · θ_eliminated`; kept × eliminated.
    pub grouping: Mat<f64>,
    /// Share of the largest pivot below which one counts as zero.
    pub tolerance: f64,
    /// Last pivot that counts over the first that does not; infinite when none is left over.
    pub gap: f64,
    /// Condition number of the kept columns at length one.
    pub condition: f64,
    /// Condition number of the kept columns as they are, in SI units.
    pub condition_raw: f64,
}

/// Which columns to keep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice<'c> {
    /// The set with the lowest condition number that the search finds.
    BestConditioned,
    /// All acting columns but these.
    Without(&'c [usize]),
}

impl BaseSet {
    /// Of the columns `among` in a triangle of [`Factor::triangle`] (or any matrix with the same row space); `None` when none acts, or
    /// when the columns stated to be eliminated do not leave an independent set that spans the others.
    #[must_use]
    pub fn new(triangle: &Mat<f64>, among: &[usize], tolerance: f64, choice: Choice<'_>) -> Option<Self> {
        let lengths: Vec<f64> = among.iter().map(|&j| triangle.col(j).norm_l2()).collect();
        let longest = lengths.iter().copied().fold(0.0, f64::max);
        let (acting, silent): (Vec<usize>, Vec<usize>) = (0..among.len()).partition(|&j| lengths[j] > ACTS * longest);
        if acting.is_empty() || !longest.is_finite() {
            return None;
        }
        let scaled = Mat::from_fn(triangle.nrows(), acting.len(), |i, j| triangle[(i, among[acting[j]])] / lengths[acting[j]]);
        let pivoted = scaled.col_piv_qr();
        let r = pivoted.R();
        let size = r.nrows().min(r.ncols());
        let pivot = |i: usize| r[(i, i)].abs();
        let rank = (0..size).take_while(|&i| pivot(i) > tolerance * pivot(0)).count();
        let gap = if rank < size { pivot(rank - 1) / pivot(rank).max(f64::MIN_POSITIVE) } else { f64::INFINITY };
        let order: Vec<usize> = pivoted.P().arrays().0.to_vec();
        let is_dropped = |j: &usize, list: &[usize]| list.contains(&among[acting[*j]]);
        let mut kept: Vec<usize> = match choice {
            Choice::BestConditioned => exchange(&scaled, order[..rank].to_vec(), order[rank..].to_vec()),
            Choice::Without(list) => (0..acting.len()).filter(|j| !is_dropped(j, list)).collect(),
        };
        kept.sort_unstable();
        let dropped: Vec<usize> = (0..acting.len()).filter(|j| !kept.contains(j)).collect();
        let (condition, grouping) = (condition(&columns(&scaled, &kept)), express(&scaled, &kept, &dropped));
        if matches!(choice, Choice::Without(_)) && (kept.len() != rank || condition >= 1.0 / tolerance) {
            return None;
        }
        let length = |j: usize| lengths[acting[j]];
        let top = grouping.norm_max();
        let clean = |x: f64| if x.abs() > COEFFICIENT * top { x } else { 0.0 };
        let grouping = Mat::from_fn(kept.len(), dropped.len(), |i, j| clean(grouping[(i, j)]) * length(dropped[j]) / length(kept[i]));
        let raw = Mat::from_fn(triangle.nrows(), kept.len(), |i, j| triangle[(i, among[acting[kept[j]]])]);
        let named = |list: &[usize]| list.iter().map(|&j| among[acting[j]]).collect::<Vec<_>>();
        Some(Self {
            condition_raw: self::condition(&raw),
            kept: named(&kept),
            eliminated: named(&dropped),
            silent: silent.iter().map(|&j| among[j]).collect(),
            grouping,
            tolerance,
            gap,
            condition,
        })
    }

    /// Number of independent combinations.
    #[must_use]
    pub fn rank(&self) -> usize {
        self.kept.len()
    }

    /// Base parameters of every column of `all`, which has a row per parameter.
    #[must_use]
    pub fn combinations(&self, all: &Mat<f64>) -> Mat<f64> {
        Mat::from_fn(self.rank(), all.ncols(), |i, c| {
            let moved: f64 = self.eliminated.iter().enumerate().map(|(j, &e)| self.grouping[(i, j)] * all[(e, c)]).sum();
            all[(self.kept[i], c)] + moved
        })
    }

    /// Whether base parameter `i` is one parameter and no combination.
    #[must_use]
    pub fn is_alone(&self, i: usize) -> bool {
        (0..self.eliminated.len()).all(|j| self.grouping[(i, j)].abs() <= 0.0)
    }

    /// Base parameters of the parameters `theta`.
    #[must_use]
    pub fn project(&self, theta: &[f64]) -> Vec<f64> {
        let moved = |i: usize| -> f64 { self.eliminated.iter().enumerate().map(|(j, &e)| self.grouping[(i, j)] * theta[e]).sum() };
        self.kept.iter().enumerate().map(|(i, &k)| theta[k] + moved(i)).collect()
    }

    /// Base parameter `i` as a combination of named parameters.
    #[must_use]
    pub fn text(&self, i: usize, columns: &Columns) -> String {
        let mut out = columns.list[self.kept[i]].name.clone();
        for (j, &e) in self.eliminated.iter().enumerate() {
            let x = self.grouping[(i, j)];
            if x.abs() > 0.0 {
                let sign = if x < 0.0 { '-' } else { '+' };
                let factor = if (x.abs() - 1.0).abs() < 1e-9 { String::new() } else { format!("{}·", significant(x.abs())) };
                out += &format!(" {sign} {factor}{}", columns.list[e].name);
            }
        }
        out
    }
}

/// Four significant digits without trailing zeros.
fn significant(x: f64) -> String {
    let digits = [1000.0, 100.0, 10.0, 1.0, 0.1, 0.01].iter().take_while(|&&limit| x < limit).count();
    if x < 1e-3 { format!("{x:.3e}") } else { format!("{x:.digits$}") }
}

fn columns(m: &Mat<f64>, list: &[usize]) -> Mat<f64> {
    Mat::from_fn(m.nrows(), list.len(), |i, j| m[(i, list[j])])
}

/// Largest over smallest singular value; infinite for a singular matrix.
fn condition(m: &Mat<f64>) -> f64 {
    let Ok(values) = m.singular_values() else { return f64::INFINITY };
    match (values.first(), values.last()) {
        (Some(first), Some(last)) if *last > 0.0 => first / last,
        _ => f64::INFINITY,
    }
}

/// The dropped columns in terms of the kept ones.
fn express(scaled: &Mat<f64>, kept: &[usize], dropped: &[usize]) -> Mat<f64> {
    let (a, b) = (columns(scaled, kept), columns(scaled, dropped));
    if dropped.is_empty() || kept.is_empty() || a.nrows() < a.ncols() {
        return Mat::zeros(kept.len(), dropped.len());
    }
    a.qr().solve_lstsq(&b).subrows(0, kept.len()).to_owned()
}

/// Exchanges kept for dropped columns as long as the condition number falls.
fn exchange(scaled: &Mat<f64>, mut kept: Vec<usize>, mut dropped: Vec<usize>) -> Vec<usize> {
    let mut best = condition(&columns(scaled, &kept));
    let mut tries = 0;
    loop {
        let t = express(scaled, &kept, &dropped);
        let mut pairs: Vec<(usize, usize)> = (0..kept.len()).flat_map(|i| (0..dropped.len()).map(move |j| (i, j))).collect();
        pairs.retain(|&(i, j)| t[(i, j)].abs() > EXCHANGE);
        pairs.sort_by(|a, b| t[*b].abs().total_cmp(&t[*a].abs()));
        let mut found = None;
        for (i, j) in pairs {
            tries += 1;
            if tries > TRIES {
                return kept;
            }
            let mut other = kept.clone();
            other[i] = dropped[j];
            let c = condition(&columns(scaled, &other));
            if c < 0.999 * best {
                (best, found) = (c, Some((i, j)));
                if kept.len() > 40 {
                    break;
                }
            }
        }
        let Some((i, j)) = found else { return kept };
        core::mem::swap(&mut kept[i], &mut dropped[j]);
    }
}

/// The largest well-conditioned subset: columns in the order of pivoted QR, as many as keep the condition number (of columns at length
/// one) below `limit`.
#[must_use]
pub fn well_conditioned(triangle: &Mat<f64>, among: &[usize], limit: f64) -> Vec<usize> {
    let lengths: Vec<f64> = among.iter().map(|&j| triangle.col(j).norm_l2()).collect();
    let longest = lengths.iter().copied().fold(0.0, f64::max);
    let acting: Vec<usize> = (0..among.len()).filter(|&j| lengths[j] > ACTS * longest).collect();
    let scaled = Mat::from_fn(triangle.nrows(), acting.len(), |i, j| triangle[(i, among[acting[j]])] / lengths[acting[j]]);
    let order: Vec<usize> = scaled.col_piv_qr().P().arrays().0.to_vec();
    // The condition number grows with every column, so the largest number that keeps the limit is found by halving.
    let (mut good, mut bad) = (0, order.len() + 1);
    while bad - good > 1 {
        let n = good.midpoint(bad);
        if condition(&columns(&scaled, &order[..n])) < limit { good = n } else { bad = n }
    }
    let mut out: Vec<usize> = order[..good].iter().map(|&j| among[acting[j]]).collect();
    out.sort_unstable();
    out
}

/// The factor of the regressor over `states` random states that the robot can take: what any motion could show.
///
/// `uniform` gives independent numbers in [0, 1).
///
/// # Errors
/// A robot whose loops do not close, or that cannot move from its assembly.
pub fn structural_factor(robot: &Robot, columns: &Columns, states: usize, uniform: &mut dyn FnMut() -> f64) -> Result<Factor, BaseError> {
    let model = &robot.model;
    let (n_act, p) = (model.n_act(), columns.len());
    let mut range = Range::try_new(model)?;
    let mut data = Data::new(model);
    let mut out = Factor::new(p);
    for _ in 0..states {
        let q = range.draw(model, &mut data, uniform)?;
        let mut about = |size: f64| -> Vec<f64> { (0..n_act).map(|_| size * (2.0 * uniform() - 1.0)).collect() };
        let (v, a) = (about(SPEED), about(ACCELERATION));
        let _closed_by_draw = closed_loop_motion(model, &mut data, &q, &v, &a);
        let direction: Vec<f64> = data.v.iter().map(|v| math::sign(*v)).collect();
        let mut rows = vec![vec![0.0; p]; n_act];
        columns.fill(model, &mut data, &direction, &mut |k, c, x| rows[k][c] = x);
        if rows.iter().flatten().any(|x| !x.is_finite()) {
            return Err(BaseError::NotFinite);
        }
        for row in &rows {
            out.push(row, 0.0, 0.0);
        }
    }
    Ok(out)
}
