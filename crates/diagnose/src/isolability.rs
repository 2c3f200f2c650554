//! Which effects these motions can tell apart, whatever was measured: how much of each effect the parameters that every model has cannot
//! imitate, and the angle between what is left of any two. Computed from sums of products of the columns alone.

use faer::{Mat, Side};
use pkm_dyn::math;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::columns::Family;
use crate::design::ColumnId;
use crate::gram::Gram;
use crate::solve::{Factor, Over, products};
use crate::work::{Candidate, Variant, Work};

/// Cosine of the angle from which on two effects count as one.
pub const ALIAS_COSINE: f64 = 0.95;

/// Surviving share below which an effect counts as imitated by the parameters that every model has.
pub const LEAST_SURVIVING: f64 = 0.05;

/// Share of a column's squared length below which what survives is rounding.
const ROUNDING: f64 = 1e-6;

/// An effect at a place, as far as it can be seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Seen {
    /// Effect name.
    pub effect: String,
    /// Where.
    #[serde(rename = "where")]
    pub place: Vec<String>,
    /// Share of its squared length that friction, offsets and inertias of the model cannot imitate, 0 to 1.
    pub kappa: f64,
    /// Whether it is a finding.
    #[serde(default)]
    pub found: bool,
}

/// Angles between all effects that are looked for.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Isolability {
    /// How far inertial parameters were taken to be off, as a share of their size; 0 takes them as exact.
    pub prior: f64,
    /// The effects.
    pub effects: Vec<Seen>,
    /// Cosine of the smallest angle between what survives of two effects, 0 to 1, in the order of `effects`; symmetric, 1 on the diagonal.
    pub cosines: Vec<Vec<f64>>,
}

impl Isolability {
    /// Whether there is nothing in it.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.effects.is_empty()
    }

    /// Pairs of effects closer than [`ALIAS_COSINE`], closest first: indices into `effects`, and the cosine.
    #[must_use]
    pub fn aliases(&self) -> Vec<(usize, usize, f64)> {
        let n = self.effects.len();
        let all = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j)));
        let mut out: Vec<_> = all.map(|(i, j)| (i, j, self.cosines[i][j])).filter(|p| p.2 > ALIAS_COSINE).collect();
        out.sort_by(|a, b| b.2.total_cmp(&a.2));
        out
    }
}

/// Products of `ids` among themselves after what `base`, with inverse prior variances `prior`, can imitate is taken out.
pub(crate) fn projected(gram: &Gram, base: &[ColumnId], prior: &[f64], ids: &[ColumnId]) -> Mat<f64> {
    let with = products(gram, base, ids, Over::All);
    let imitated = Factor::new(products(gram, base, base, Over::All), prior).solve(&with);
    products(gram, ids, ids, Over::All) - with.transpose() * &imitated
}

/// One shape: its own columns, and columns that it is always sought together with.
#[derive(Debug, Clone)]
struct Block {
    own: Vec<ColumnId>,
    companions: Vec<ColumnId>,
}

/// Columns of an effect itself. A free parameter that every model has, inside another effect (the constant of a spring), is a companion.
fn block(c: &Candidate, v: &Variant, free: &[ColumnId]) -> Block {
    let is_own = |i: usize, id: &ColumnId| i < v.n_own && (c.effect.family() == Family::Standard || !free.contains(id));
    let (own, companions): (Vec<_>, Vec<_>) = v.columns.iter().copied().enumerate().partition(|(i, id)| is_own(*i, id));
    let ids = |x: Vec<(usize, ColumnId)>| x.into_iter().map(|(_, id)| id).collect();
    Block { own: ids(own), companions: ids(companions) }
}

/// A shape and what of it is the same in every pair.
struct Placed<'b> {
    block: &'b Block,
    /// Where its own columns are among those in question.
    at: Vec<usize>,
    /// Coordinates of what survives of them after inertias and every free column; none where a free column is its own.
    white: Option<Mat<f64>>,
}

/// Products of all columns in question, with inertias taken out, and the free columns still in them.
struct Bench {
    /// Columns in question, free ones last.
    ids: Vec<ColumnId>,
    free: Vec<ColumnId>,
    /// Products after inertias.
    soft: Mat<f64>,
    /// Products after inertias and every free column.
    all: Mat<f64>,
    /// Squared length of each column as it is.
    raw: Vec<f64>,
}

impl Bench {
    fn new(work: &Work, blocks: &[Vec<Block>]) -> Self {
        let free = work.every_model_has(work.softness);
        let mut ids: Vec<ColumnId> = blocks.iter().flatten().flat_map(|b| b.own.iter().copied()).filter(|id| !free.contains(id)).collect();
        ids.sort_unstable();
        ids.dedup();
        let n = ids.len();
        ids.extend(&free);
        let (base, prior) = work.with_rigid(Vec::new(), work.kappa);
        let soft = projected(&work.gram, &base, &prior, &ids);
        let raw = (0..ids.len()).map(|i| (0..work.design.n_joints).map(|j| work.gram.power(ids[i], j)).sum()).collect();
        let at: Vec<usize> = (0..n).collect();
        let out: Vec<usize> = (n..ids.len()).collect();
        let all = without(&soft, &at, &out);
        Self { ids, free, soft, all, raw }
    }

    fn index(&self, ids: &[ColumnId]) -> Vec<usize> {
        ids.iter().filter_map(|id| self.ids.iter().position(|i| i == id)).collect()
    }

    fn place<'b>(&self, block: &'b Block) -> Placed<'b> {
        let at = self.index(&block.own);
        let is_free = block.own.iter().any(|id| self.free.contains(id));
        let white = (!is_free).then(|| whitened(&part(&self.all, &at, &at), self.longest(&at)));
        Placed { block, at, white }
    }

    /// Squared length of the longest of some columns.
    fn longest(&self, at: &[usize]) -> f64 {
        at.iter().map(|&i| self.raw[i]).fold(0.0, f64::max)
    }

    /// Products among shapes after everything that is not theirs is taken out, in the order of their columns.
    fn beside(&self, placed: &[&Placed]) -> Mat<f64> {
        let at: Vec<usize> = placed.iter().flat_map(|p| p.at.iter().copied()).collect();
        if placed.iter().all(|p| p.white.is_some()) {
            return part(&self.all, &at, &at);
        }
        let is_own =
            |id: &ColumnId| placed.iter().any(|p| p.block.own.contains(id)) && !placed.iter().any(|p| p.block.companions.contains(id));
        let rest: Vec<ColumnId> = self.free.iter().copied().filter(|id| !is_own(id)).collect();
        without(&self.soft, &at, &self.index(&rest))
    }

    /// Share of a block's squared length that survives.
    fn kappa(&self, placed: &Placed) -> f64 {
        let left = self.beside(&[placed]);
        let raw: f64 = placed.at.iter().map(|&i| self.raw[i]).sum();
        let share = (0..placed.at.len()).map(|i| left[(i, i)]).sum::<f64>() / raw.max(f64::MIN_POSITIVE);
        if share > ROUNDING { share.min(1.0) } else { 0.0 }
    }

    /// Cosine of the smallest angle between what survives of two blocks; 0 where nothing does.
    fn cosine(&self, a: &Placed, b: &Placed) -> f64 {
        if let (Some(u), Some(v)) = (&a.white, &b.white) {
            return closest(u, &part(&self.all, &a.at, &b.at), v);
        }
        let left = self.beside(&[a, b]);
        let (first, second): (Vec<usize>, Vec<usize>) = (0..left.nrows()).partition(|i| *i < a.at.len());
        let of = |rows: &[usize], at: &[usize]| whitened(&part(&left, rows, rows), self.longest(at));
        closest(&of(&first, &a.at), &part(&left, &first, &second), &of(&second, &b.at))
    }
}

/// Largest cosine between two sets of coordinates with these products between their columns.
fn closest(u: &Mat<f64>, between: &Mat<f64>, v: &Mat<f64>) -> f64 {
    if u.ncols() == 0 || v.ncols() == 0 {
        return 0.0;
    }
    let between = u.transpose() * between * v;
    // The only singular value of a single row or column is its length.
    let largest =
        if between.nrows().min(between.ncols()) == 1 { between.norm_l2() } else { between.singular_values().map_or(0.0, |s| s[0]) };
    largest.clamp(0.0, 1.0)
}

/// Some rows and columns of a matrix.
fn part(g: &Mat<f64>, rows: &[usize], columns: &[usize]) -> Mat<f64> {
    Mat::from_fn(rows.len(), columns.len(), |i, j| g[(rows[i], columns[j])])
}

/// Products among the columns `at` after the columns `out` are taken out of them.
fn without(g: &Mat<f64>, at: &[usize], out: &[usize]) -> Mat<f64> {
    let with = part(g, out, at);
    let imitated = Factor::new(part(g, out, out), &vec![0.0; out.len()]).solve(&with);
    part(g, at, at) - with.transpose() * &imitated
}

/// Coordinates in which products `g` are the identity; directions shorter than rounding of `raw` are left out.
fn whitened(g: &Mat<f64>, raw: f64) -> Mat<f64> {
    let Ok(eigen) = g.self_adjoint_eigen(Side::Lower) else { return Mat::zeros(g.nrows(), 0) };
    let values: Vec<f64> = eigen.S().column_vector().iter().copied().collect();
    let kept: Vec<usize> = (0..values.len()).filter(|&i| values[i] > ROUNDING * raw).collect();
    Mat::from_fn(g.nrows(), kept.len(), |i, k| eigen.U()[(i, kept[k])] / math::sqrt(values[kept[k]]))
}

/// Shapes of a candidate that are in question: as found, or all that may be tried.
fn shapes(work: &Work, candidate: usize) -> Vec<Block> {
    let c = &work.candidates[candidate];
    let free = work.every_model_has(work.softness);
    let found = work.picks.iter().find(|p| p.candidate == candidate).map(|p| &p.variant);
    // Of a spring the straight one: how much a real one hardens nobody knows before it is found.
    let is_straight = |v: &&Variant| c.effect_name() != "spring" || v.values.len() == 1;
    let all = c.variants.iter().filter(is_straight).filter(|v| v.softness.is_none_or(|w| w == work.softness));
    let variants: Vec<&Variant> = found.map_or_else(|| all.collect(), |v| vec![v]);
    variants.into_iter().map(|v| block(c, v, &free)).filter(|b| !b.own.is_empty()).collect()
}

/// Angles between all candidates. Of a candidate that may take several shapes, the shape nearest to the other one counts: a shape that
/// imitates another effect is enough to be mistaken for it.
pub(crate) fn isolability(work: &Work) -> Isolability {
    let of_each: Vec<(usize, Vec<Block>)> = (0..work.candidates.len()).map(|c| (c, shapes(work, c))).filter(|s| !s.1.is_empty()).collect();
    let blocks: Vec<Vec<Block>> = of_each.iter().map(|(_, b)| b.clone()).collect();
    let bench = Bench::new(work, &blocks);
    let placed: Vec<Vec<Placed>> = blocks.par_iter().map(|shapes| shapes.iter().map(|b| bench.place(b)).collect()).collect();
    let effects = of_each
        .iter()
        .zip(&placed)
        .map(|((c, _), shapes)| {
            let candidate = &work.candidates[*c];
            Seen {
                effect: candidate.effect_name().to_string(),
                place: vec![candidate.name.clone()],
                kappa: rounded(shapes.iter().map(|b| bench.kappa(b)).fold(0.0, f64::max)),
                found: work.picks.iter().any(|p| p.candidate == *c),
            }
        })
        .collect();
    let n = placed.len();
    let upper: Vec<Vec<f64>> =
        (0..n).into_par_iter().map(|i| (i + 1..n).map(|j| rounded(nearest(&bench, &placed[i], &placed[j]))).collect()).collect();
    let at = |i: usize, j: usize| if i < j { upper[i][j - i - 1] } else { upper[j][i - j - 1] };
    let cosines = (0..n).map(|i| (0..n).map(|j| if i == j { 1.0 } else { at(i, j) }).collect()).collect();
    Isolability { prior: work.kappa, effects, cosines }
}

/// Cosine between two sets of shapes of which any may be true.
fn nearest(bench: &Bench, a: &[Placed], b: &[Placed]) -> f64 {
    a.iter().flat_map(|a| b.iter().map(move |b| bench.cosine(a, b))).fold(0.0, f64::max)
}

/// Cosine between one shape of each of two candidates.
pub(crate) fn cosine_of(work: &Work, a: (usize, &Variant), b: (usize, &Variant)) -> f64 {
    let free = work.every_model_has(work.softness);
    let [a, b] = [a, b].map(|(c, v)| block(&work.candidates[c], v, &free));
    if a.own.is_empty() || b.own.is_empty() {
        return 0.0;
    }
    let blocks = [vec![a], vec![b]];
    let bench = Bench::new(work, &blocks);
    bench.cosine(&bench.place(&blocks[0][0]), &bench.place(&blocks[1][0]))
}

/// Four digits: more would be noise of the motion.
fn rounded(x: f64) -> f64 {
    (x * 1e4).round() / 1e4
}
