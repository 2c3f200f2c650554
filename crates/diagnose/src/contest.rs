//! One decision: which candidate, if any, is worth adding, judged against what chance alone achieves on the same data.

use alloc::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::alternatives::is_wider_law;
use crate::columns::{self, Family};
use crate::design::{ColumnId, View};
use crate::gram::{Cross, Targets};
use crate::isolability::projected;
use crate::screen::{self, Base, Fitted, Gains, Set};
use crate::settings::Settings;
use crate::solve::{Over, products};
use crate::wins::{Tally, tally};
use crate::work::{Pick, Variant, Work};
use crate::worth::size;

/// A set of columns candidates are added to, at one softness.
pub(crate) struct Ground {
    pub(crate) softness: usize,
    pub(crate) columns: Vec<ColumnId>,
    pub(crate) prior: Vec<f64>,
}

/// A candidate's best shape and its numbers.
#[derive(Debug, Clone)]
pub(crate) struct Score {
    pub(crate) candidate: usize,
    pub(crate) variant: Variant,
    /// Ground it was fitted on.
    pub(crate) ground: usize,
    /// Held-out squared error it takes away, over all joints.
    pub(crate) taken: f64,
    /// The same as a share of the error of the joints it acts on.
    pub(crate) gain: f64,
    /// Logarithm of the ratio of errors without and with it, in standard deviations of the same in null runs, above their mean.
    pub(crate) surprise: f64,
    /// Folds in which it helped.
    pub(crate) tally: Tally,
    /// Why it was not accepted; empty when it could be.
    pub(crate) why_not: String,
    /// Whether its size is all that speaks against it.
    pub(crate) is_small: bool,
    /// Its other shapes, best first, for when the best one reads as impossible.
    pub(crate) others: Vec<Trial>,
}

/// One shape of a candidate on one ground.
#[derive(Debug, Clone)]
pub(crate) struct Trial {
    variant: Variant,
    ground: usize,
    taken: f64,
    gain: f64,
    tally: Tally,
}

/// The outcome of one decision.
pub(crate) struct Contest {
    /// Every candidate, best first.
    pub(crate) scores: Vec<Score>,
    /// Largest surprise of any candidate in each null run, ascending.
    pub(crate) null: Vec<f64>,
}

impl Contest {
    /// Surprise that a share `1 - level` of the null runs stays below.
    pub(crate) fn threshold(&self, level: f64) -> f64 {
        let n = self.null.len();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of null runs")]
        let above = (level * (n + 1) as f64).floor() as usize;
        if above == 0 { f64::INFINITY } else { self.null[n - above.min(n)] }
    }

    /// What a candidate must reach.
    fn bar(&self, work: &Work, settings: &Settings) -> Bar {
        let [threshold, sure] = [settings.search_level, settings.confirm_level].map(|level| self.threshold(level));
        Bar { threshold, sure, n_folds: work.gram.n_filled() }
    }

    fn pick(&self, s: &Score) -> Pick {
        let p_search = self.p_value(s.surprise);
        Pick { candidate: s.candidate, variant: s.variant.clone(), p_search, p_confirm: 1.0, wins: s.tally.wins }
    }

    /// Share of null runs (and the recording itself) that reach a surprise.
    pub(crate) fn p_value(&self, surprise: f64) -> f64 {
        let reached = self.null.iter().filter(|g| **g >= surprise).count();
        (1 + reached) as f64 / (1 + self.null.len()) as f64
    }
}

/// Runs the contest of `pool` on `grounds`. `null_left` is what a null run is made of: [joint][segment][row].
pub(crate) fn contest(work: &Work, pool: &[usize], grounds: &[Ground], null_left: &[Vec<Vec<f64>>], settings: &Settings) -> Contest {
    let softnesses: Vec<usize> = grounds.iter().map(|g| g.softness).collect();
    let mut targets = work.real_targets(&softnesses);
    targets.extend(surrogates(work, null_left, settings));
    let cross = work.gram.cross(&work.design, &targets);
    let bases: Vec<Base> = grounds.iter().map(|g| Base::new(&work.gram, &cross, &g.columns, &g.prior)).collect();
    let n_real = grounds.len();
    let best_of = |target: &dyn Fn(usize) -> usize| {
        (0..n_real).min_by(|&a, &b| bases[a].total(target(a)).total_cmp(&bases[b].total(target(b)))).unwrap_or(0)
    };
    let best_ground = best_of(&|i| i);
    let null_best: Vec<usize> = (0..settings.null_runs).map(|b| best_of(&|_| n_real + b)).collect();
    let arena = Arena { work, grounds, bases: &bases, cross: &cross, best_ground, null_best: &null_best };
    let judged = arena.judge(pool);
    let mut null = vec![f64::NEG_INFINITY; settings.null_runs];
    let mut scores = Vec::new();
    for (mut score, gains) in judged {
        // Joints differ in how much chance can do there: each candidate is judged in units of its own null runs.
        let gains: Vec<f64> = gains.into_iter().map(log_ratio).collect();
        let (mean, sd) = mean_and_sd(&gains);
        null.iter_mut().zip(&gains).for_each(|(n, g)| *n = n.max((g - mean) / sd));
        score.surprise = (log_ratio(score.gain) - mean) / sd;
        scores.push(score);
    }
    null.sort_by(f64::total_cmp);
    scores.sort_by(|a, b| b.taken.total_cmp(&a.taken));
    Contest { scores, null }
}

/// Logarithm of error without over error with a candidate that takes away a share `gain` of it.
///
/// A share ends at one. Where what is left is slow, chance alone takes away half of it now and then, and the whole of it would be no
/// surprise; the ratio of errors has no such end.
pub(crate) fn log_ratio(gain: f64) -> f64 {
    -pkm_dyn::math::ln((1.0 - gain).max(1e-12))
}

/// Mean and standard deviation, the latter never so small that rounding counts as surprise.
pub(crate) fn mean_and_sd(x: &[f64]) -> (f64, f64) {
    let n = x.len().max(1) as f64;
    let mean = x.iter().sum::<f64>() / n;
    let variance = x.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n;
    (mean, pkm_dyn::math::sqrt(variance).max(1e-6))
}

/// What one candidate needs to be judged.
struct Arena<'a> {
    work: &'a Work<'a>,
    grounds: &'a [Ground],
    bases: &'a [Base],
    cross: &'a Cross,
    best_ground: usize,
    null_best: &'a [usize],
}

/// One shape of a candidate, to be tried on one ground.
struct Shape<'a> {
    candidate: usize,
    variant: &'a Variant,
    ground: usize,
}

/// Candidates that are fitted at once: enough for wide products of matrices, few enough for the cores to share a hundred of them.
const AT_ONCE: usize = 8;

impl Arena<'_> {
    /// Each candidate's best shape on the recording, and its best gain in every null run.
    fn judge(&self, pool: &[usize]) -> Vec<(Score, Vec<f64>)> {
        let mut by_scope: BTreeMap<&[usize], Vec<usize>> = BTreeMap::new();
        for &c in pool {
            by_scope.entry(&self.work.candidates[c].scope).or_default().push(c);
        }
        let groups: Vec<(&[usize], &[usize])> =
            by_scope.iter().flat_map(|(scope, all)| all.chunks(AT_ONCE).map(|some| (*scope, some))).collect();
        let tried: Vec<(usize, Trial, Vec<f64>)> = groups.par_iter().flat_map_iter(|(scope, some)| self.attempt_all(scope, some)).collect();
        let mut each: BTreeMap<usize, (Vec<Trial>, Vec<f64>)> = BTreeMap::new();
        for (candidate, trial, gains) in tried {
            let none = || (Vec::new(), vec![f64::NEG_INFINITY; self.null_best.len()]);
            let (trials, null) = each.entry(candidate).or_insert_with(none);
            trials.push(trial);
            null.iter_mut().zip(gains).for_each(|(n, g)| *n = n.max(g));
        }
        let best_of = |(candidate, (mut trials, null)): (usize, (Vec<Trial>, Vec<f64>))| {
            trials.sort_by(|a, b| b.taken.total_cmp(&a.taken));
            prefer_simple(&mut trials);
            let mut trials = trials.into_iter();
            trials.next().map(|best| (Score::of(candidate, best, trials.take(MAX_OTHERS).collect()), null))
        };
        each.into_iter().filter_map(best_of).collect()
    }

    /// Every shape of some candidates of one scope: the candidate, its numbers on the recording and its gain in every null run.
    fn attempt_all(&self, scope: &[usize], candidates: &[usize]) -> Vec<(usize, Trial, Vec<f64>)> {
        // Efforts and other positions each have their own errors: a candidate is judged where it does most.
        let parts = self.work.kinds_of_rows(scope);
        let mut out = Vec::new();
        for (i, ground) in self.grounds.iter().enumerate() {
            let is_here = |v: &Variant| v.softness.map_or(i == self.best_ground, |w| w == ground.softness);
            let shapes = candidates.iter().flat_map(|&candidate| {
                let variants = self.work.candidates[candidate].variants.iter().filter(|v| is_here(v));
                variants.map(move |variant| Shape { candidate, variant, ground: i })
            });
            let (shapes, sets): (Vec<Shape>, Vec<Set>) = shapes
                .filter_map(|shape| {
                    let (columns, prior) = own_columns(self.work, shape.variant, &ground.columns);
                    (!columns.is_empty()).then_some((shape, Set { columns, prior }))
                })
                .unzip();
            if sets.is_empty() {
                continue;
            }
            let each = |part: &Vec<usize>| screen::gains_each(&self.work.gram, self.cross, &self.bases[i], &sets, part);
            let gains: Vec<Vec<Gains>> = parts.iter().map(each).collect();
            for (n, shape) in shapes.iter().enumerate() {
                let there: Vec<(&[usize], &Gains)> = parts.iter().zip(&gains).map(|(part, g)| (part.as_slice(), &g[n])).collect();
                out.extend(self.numbers(shape, &there).map(|(trial, nulls)| (shape.candidate, trial, nulls)));
            }
        }
        out
    }

    /// A shape's numbers on the recording and its gain in every null run; `parts` are rows of one kind each, and what it gains there.
    fn numbers(&self, shape: &Shape, parts: &[(&[usize], &Gains)]) -> Option<(Trial, Vec<f64>)> {
        let i = shape.ground;
        let (base, best_base, n_real) = (&self.bases[i], &self.bases[self.best_ground], self.grounds.len());
        // Squared error that is taken away from some rows, between a target before and one after, as a share of what was there.
        let share = |best: &Base, [before, after]: [usize; 2]| {
            let each = parts.iter().map(|(part, g)| {
                let there = best.over(part, before);
                (there - base.over(part, after) + g.scope[after]) / there.max(f64::MIN_POSITIVE)
            });
            each.fold(f64::NEG_INFINITY, f64::max)
        };
        let nulls = (0..self.null_best.len()).map(|b| share(&self.bases[self.null_best[b]], [n_real + b; 2])).collect();
        let Gains { all, due, .. } = parts.first()?.1;
        let taken = best_base.total(self.best_ground) - base.total(i) + all.iter().map(|f| f[i]).sum::<f64>();
        let taken_from_fold = |f: usize| fold_taken(self.bases, self.best_ground, i, f) + all[f][i];
        let folds = 0..self.work.gram.n_folds;
        let tally = tally(&folds.clone().map(|f| due[f][i]).collect::<Vec<_>>(), &folds.map(taken_from_fold).collect::<Vec<_>>());
        let gain = share(best_base, [self.best_ground, i]);
        Some((Trial { variant: shape.variant.clone(), ground: i, taken, gain, tally }, nulls))
    }
}

/// A shape with fewer coefficients that does practically as well goes first.
fn prefer_simple(trials: &mut [Trial]) {
    let Some(best) = trials.first().map(|t| t.taken) else { return };
    let as_good = trials.iter().take_while(|t| t.taken >= AS_GOOD * best).count();
    let simplest = (0..as_good).min_by_key(|&i| (trials[i].variant.columns.len(), i)).unwrap_or(0);
    trials[..=simplest].rotate_right(1);
}

/// What takes away this share of what the best takes away does practically as well.
const AS_GOOD: f64 = 0.98;

/// Shapes of a candidate that are kept as a fall-back.
const MAX_OTHERS: usize = 5;

impl Score {
    fn of(candidate: usize, t: Trial, others: Vec<Trial>) -> Self {
        let Trial { variant, ground, taken, gain, tally } = t;
        Self { candidate, variant, ground, taken, gain, surprise: 0.0, tally, why_not: String::new(), is_small: false, others }
    }

    /// Puts the next shape in place of the best one.
    fn fall_back(&mut self) -> bool {
        if self.others.is_empty() {
            return false;
        }
        let t = self.others.remove(0);
        // Surprise is in units of the same null runs, so it shrinks with the gain.
        self.surprise *= (log_ratio(t.gain) / log_ratio(self.gain)).clamp(0.0, 1.0);
        (self.variant, self.ground, self.taken) = (t.variant, t.ground, t.taken);
        (self.gain, self.tally) = (t.gain, t.tally);
        true
    }
}

fn fold_taken(bases: &[Base], best: usize, i: usize, fold: usize) -> f64 {
    let sum = |base: &Base, target: usize| base.sse[fold].iter().map(|j| j[target]).sum::<f64>();
    sum(&bases[best], best) - sum(&bases[i], i)
}

/// Columns of a variant that the ground does not have already.
pub(crate) fn own_columns(work: &Work, variant: &Variant, ground: &[ColumnId]) -> (Vec<ColumnId>, Vec<f64>) {
    let new = variant.columns.iter().zip(&variant.prior).filter(|(id, _)| !ground.contains(id));
    new.map(|(&id, &sd)| (id, work.inverse_variance(id, sd))).unzip()
}

/// Null runs: what is left, with its spectrum kept and its phases drawn anew, the same for all joints of a recording.
pub(crate) fn surrogates(work: &Work, left: &[Vec<Vec<f64>>], settings: &Settings) -> Targets {
    let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
    let phases: Vec<Vec<Vec<f64>>> =
        (0..settings.null_runs).map(|_| work.design.rows.iter().map(|rows| random_phases(rows.time.len(), &mut rng)).collect()).collect();
    phases
        .par_iter()
        .map(|phases| {
            left.iter().map(|joint| joint.iter().zip(phases).map(|(x, p)| pkm_ident::spectrum::phase_randomised(x, p)).collect()).collect()
        })
        .collect()
}

/// A phase for each frequency of a series of `n` `[rad]`.
pub(crate) fn random_phases(n: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
    (0..n / 2 + 1).map(|_| core::f64::consts::TAU * rng.random::<f64>()).collect()
}

/// The first candidate, best first, that is real, worth having and physical; the reasons of those before it are noted.
pub(crate) fn decide(work: &Work, contest: &mut Contest, grounds: &[Ground], settings: &Settings) -> Option<Pick> {
    let bar = contest.bar(work, settings);
    for s in &mut contest.scores {
        weigh(work, s, grounds, &bar, settings);
    }
    contest.scores.sort_by(|a, b| b.taken.total_cmp(&a.taken));
    stand_aside(work, &mut contest.scores);
    let first = contest.scores.iter().position(|s| s.why_not.is_empty())?;
    Some(contest.pick(&contest.scores[simplest(work, contest, first)]))
}

/// Fuller shapes of a candidate that was decided for, those that the numbers support as well. A simple one that does as well where it was fitted may lack
/// what another motion shows: where a limb rests.
pub(crate) fn fuller(work: &Work, contest: &Contest, candidate: usize, grounds: &[Ground], settings: &Settings) -> Vec<Pick> {
    let bar = contest.bar(work, settings);
    let Some(score) = contest.scores.iter().find(|s| s.candidate == candidate) else { return Vec::new() };
    let mut out = Vec::new();
    for shape in score.others.iter().filter(|t| t.variant.n_own > score.variant.n_own) {
        let mut tried = Score { others: vec![shape.clone()], ..score.clone() };
        tried.fall_back();
        weigh(work, &mut tried, grounds, &bar, settings);
        if tried.why_not.is_empty() {
            out.push(contest.pick(&tried));
        }
    }
    out
}

/// Notes why a candidate is not acceptable, in the best of its shapes that reads as possible and large enough.
fn weigh(work: &Work, s: &mut Score, grounds: &[Ground], bar: &Bar, settings: &Settings) {
    let is_ordinary = matches!(work.candidates[s.candidate].effect.family(), Family::Standard | Family::Shift);
    loop {
        s.why_not = objection(s, settings, bar, is_ordinary);
        if let Some(simpler) = s.variant.limit.filter(|_| s.why_not.is_empty()) {
            s.why_not = format!("fits best where it is {simpler}");
        }
        if !s.why_not.is_empty() {
            return;
        }
        (s.why_not, s.is_small) = read(work, s, grounds, settings).map_or_else(|no| (no.why, no.is_small), |()| (String::new(), false));
        if s.why_not.is_empty() || !s.fall_back() {
            return;
        }
    }
}

/// What explains less than something real that is too small for a name, at the same joints, has no better claim to one: a scale fits a small
/// friction worse than the friction does, and looks larger. A law that the small one contains has: the
/// fuller one explains a little more whatever is there, and must be larger for a name. `scores` come best first.
fn stand_aside(work: &Work, scores: &mut [Score]) {
    for i in 0..scores.len() {
        let (small, after) = scores[i..].split_first_mut().map_or((None, [].as_mut_slice()), |(s, rest)| (Some(&*s), rest));
        let Some(small) = small.filter(|s| s.is_small) else { continue };
        let better = &work.candidates[small.candidate];
        for s in after.iter_mut().filter(|s| s.why_not.is_empty() && !is_wider_law(work, small.candidate, s.candidate)) {
            if work.candidates[s.candidate].scope.iter().any(|j| better.scope.contains(j)) {
                s.why_not = format!("{} at {} explains more, and is too small for a name", better.effect_name(), better.name);
            }
        }
    }
}

/// What a candidate must reach.
struct Bar {
    /// Surprise of the search, and of a search that is sure by itself.
    threshold: f64,
    sure: f64,
    n_folds: usize,
}

/// Why the numbers do not support a candidate; empty when they do.
///
/// Ordinary parameters act wherever the robot moves and must help in most blocks. Play, dead zones, obstacles and pushes act at some moments and
/// do nothing between: helping where they act is enough for them, where the search alone is sure.
fn objection(s: &Score, settings: &Settings, &Bar { threshold, sure, n_folds }: &Bar, is_ordinary: bool) -> String {
    if s.gain <= settings.floor {
        let (gain, floor) = (100.0 * s.gain, 100.0 * settings.floor);
        return format!("would take away {gain:.1} % of the squared error, less than the {floor:.0} % worth naming");
    }
    if s.surprise <= threshold {
        return format!("its gain of {:.1} % is {:.1} sigma above chance, and null runs reach {threshold:.1}", 100.0 * s.gain, s.surprise);
    }
    let is_enough = !is_ordinary && s.tally.is_steady && s.surprise > sure;
    if s.tally.wins < (3 * n_folds).div_ceil(4) && !is_enough {
        return format!("helps in {} of {n_folds} blocks only", s.tally.wins);
    }
    String::new()
}

/// Among acceptable candidates that do practically as well as the best, the one with the fewest coefficients, then the commonest; of pushes at one time
/// the outermost: what pushes a robot meets its end, and links nearer to the root feel the same.
fn simplest(work: &Work, contest: &Contest, first: usize) -> usize {
    let (scores, best) = (&contest.scores, contest.scores[first].taken);
    let as_good = || (first..scores.len()).filter(|&i| scores[i].why_not.is_empty() && scores[i].taken >= AS_GOOD * best);
    let simplest = as_good().min_by_key(|&i| {
        let s = &scores[i];
        let scope = work.candidates[s.candidate].scope.len();
        (s.variant.columns.len(), scope, s.candidate)
    });
    let simplest = simplest.unwrap_or(first);
    let same_push = |i: &usize| pushed_together(work, &scores[*i], &scores[simplest]);
    // Pushes are proposed at drives first, then at links from the root on.
    as_good().filter(same_push).max_by_key(|&i| scores[i].candidate).unwrap_or(simplest)
}

/// Whether two candidates are pushes at the same time.
fn pushed_together(work: &Work, a: &Score, b: &Score) -> bool {
    let is_push = |s: &Score| work.candidates[s.candidate].effect_name() == "external_force";
    is_push(a) && is_push(b) && columns::external_force::are_together(&a.variant.values, &b.variant.values)
}

/// Why a candidate that the numbers support is not accepted.
struct Refusal {
    why: String,
    is_small: bool,
}

/// Reads a candidate's coefficients, fitted on all folds on its ground; `Err` is the physical veto, or that nobody would feel it.
fn read(work: &Work, s: &Score, grounds: &[Ground], settings: &Settings) -> Result<(), Refusal> {
    let ground = &grounds[s.ground];
    let (own, own_prior) = own_columns(work, &s.variant, &ground.columns);
    let mut ids = ground.columns.clone();
    let mut prior = ground.prior.clone();
    ids.extend(&own);
    prior.extend(&own_prior);
    let cross = work.gram.cross(&work.design, &vec![work.measured_minus_nominal(ground.softness, View::Fit)]);
    let fitted = Fitted::new(&work.gram, &cross, ids, &prior);
    let coefficient = |id| fitted.coefficient(id);
    reading(work, s.candidate, &s.variant, &coefficient).map_err(|why| Refusal { why, is_small: false })?;
    let shown = shown_share(work, ground, &own, &coefficient);
    if shown < SHOWN {
        let why = format!("only {:.3} % of it shows beside what the model can do anyway", 100.0 * shown);
        return Err(Refusal { why, is_small: false });
    }
    let (size, tolerance) = (size(work, s.candidate, &s.variant, &coefficient), settings.tolerance_of(s.variant.n_own));
    if size > tolerance {
        return Ok(());
    }
    let why = format!("its size is {:.2} % of the effort, less than the {:.1} % worth naming", 100.0 * size, 100.0 * tolerance);
    Err(Refusal { why, is_small: true })
}

/// Share of an effect's power below which what shows of it is the error of its own column: filters and derivatives are right to some percent of
/// amplitude.
pub(crate) const SHOWN: f64 = 1e-3;

/// Share of the squared length of the candidate's own part that the ground cannot imitate.
fn shown_share(work: &Work, ground: &Ground, own: &[ColumnId], coefficient: &dyn Fn(ColumnId) -> f64) -> f64 {
    let left = projected(&work.gram, &ground.columns, &ground.prior, own);
    let whole = products(&work.gram, own, own, Over::All);
    let scaled: Vec<f64> = own.iter().map(|&id| coefficient(id) / work.gram.scale[id].max(f64::MIN_POSITIVE)).collect();
    let squared = |m: &faer::Mat<f64>| -> f64 {
        (0..own.len()).flat_map(|i| (0..own.len()).map(move |j| (i, j))).map(|(i, j)| scaled[i] * m[(i, j)] * scaled[j]).sum()
    };
    squared(&left) / squared(&whole).max(f64::MIN_POSITIVE)
}

/// A candidate's parameters from coefficients by column.
pub(crate) fn reading(
    work: &Work,
    candidate: usize,
    variant: &Variant,
    coefficient: &dyn Fn(ColumnId) -> f64,
) -> Result<Vec<(&'static str, f64)>, String> {
    let c = &work.candidates[candidate];
    let drive = work.drive(candidate);
    let softness = variant.softness.unwrap_or(work.softness);
    // At a drive whose effort scale is wrong, fits are in recorded units and laws in true ones.
    let unit = if c.effect_name() == "torque_constant" { 1.0 } else { 1.0 / (1.0 + scale_error(work, variant, coefficient)) };
    let own: Vec<f64> = variant.columns.iter().take(variant.n_own).map(|&id| unit * coefficient(id)).collect();
    c.effect.read(&columns::View {
        model: &work.baseline,
        own: &own,
        shape: &variant.values,
        place: c.place,
        coulomb_change: drive.map_or(0.0, |k| unit * coefficient(work.standard.coulomb[softness][k])),
        viscous_change: drive.map_or(0.0, |k| unit * coefficient(work.standard.viscous[k])),
        chain: drive.map(|k| work.design.chain[k]).unwrap_or_default(),
    })
}

/// Share by which recorded efforts are too large where a variant acts: the mean over drives of the scale errors picked there, each drive
/// counting by how much of the variant's own columns it carries. A link's columns lie at several drives, a joint's at its own.
fn scale_error(work: &Work, variant: &Variant, coefficient: &dyn Fn(ColumnId) -> f64) -> f64 {
    let wrong: Vec<(usize, f64)> = work
        .picks
        .iter()
        .filter(|p| work.candidates[p.candidate].effect_name() == "torque_constant")
        .map(|p| (work.candidates[p.candidate].scope[0], coefficient(p.variant.columns[0]).max(-0.9)))
        .collect();
    if wrong.is_empty() {
        return 0.0;
    }
    let own = &variant.columns[..variant.n_own];
    let carried: Vec<f64> = (0..work.design.n_joints).map(|j| own.iter().map(|&id| work.gram.power(id, j)).sum()).collect();
    let total: f64 = carried.iter().sum();
    if total > 0.0 { wrong.iter().map(|(j, error)| error * carried[*j]).sum::<f64>() / total } else { 0.0 }
}
