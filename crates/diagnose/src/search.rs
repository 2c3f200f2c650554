//! The search: structure first with every ordinary parameter free, then which ordinary parameters moved.

use crate::columns::Family;
use crate::contest::{Contest, Ground, Score, contest, decide};
use crate::design::{Chain, ColumnId, View};
use crate::gram::{Cross, Gram};
use crate::screen::{self, Base};
use crate::settings::{MAX_SHIFTS, MAX_STRUCTURAL, PRIORS, SOFTNESS, Settings};
use crate::simplify::{fuller_shapes, one_cause};
use crate::solve::Over;
use crate::work::{Pick, Work};

/// What the search leaves behind besides the picks in `Work`.
pub(crate) struct Search {
    /// The last decision about structure and the last about ordinary parameters, for the list of what was ruled out.
    pub(crate) last: Vec<Contest>,
}

/// Ordinary explanations first: friction, offsets, masses, scales that moved. Then structure, judged with every ordinary parameter
/// free, because a refit conceals. Then everything that the whole does not need is taken out, and what that uncovers is looked for
/// once more.
pub(crate) fn search(work: &mut Work, band: f64, settings: &Settings, progress: &mut dyn FnMut(f64)) -> Search {
    work.kappa = choose_prior(work);
    let ground = best_ground(work, &grounds(work, work.kappa));
    work.set_softness(ground);
    shifts(work, settings);
    progress(0.4);
    let structure = structure(work, band, settings, progress);
    prune_or_refit(work, band, settings);
    settle_softness(work, band);
    progress(0.85);
    let ordinary = shifts(work, settings);
    settle_softness(work, band);
    prune(work, band, settings);
    one_cause(work, band, settings);
    crate::confirm::confirm(work, band, settings);
    refine_chain(work, band);
    // What is left after a drop may read differently: nothing impossible or superfluous goes into a verdict.
    prune(work, band, settings);
    progress(0.95);
    Search { last: core::iter::once(structure).chain(ordinary).collect() }
}

/// A step of the search, for whoever asks for it.
fn tell(work: &Work, what: &str, pick: &Pick) {
    let c = &work.candidates[pick.candidate];
    tracing::debug!(effect = c.effect_name(), place = c.name, shape = ?pick.variant.values, what);
}

/// Takes out, worst first, picks that the others make superfluous, that read as impossible, or that a simpler effect replaces.
pub(crate) fn prune(work: &mut Work, band: f64, settings: &Settings) {
    for _ in 0..2 * (MAX_SHIFTS + MAX_STRUCTURAL) {
        let Some(worst) = superfluous(work, settings) else { return };
        drop_pick(work, worst, band);
    }
}

/// Takes out what is superfluous on top of the robot as given, unless the robot as given is what hides it: parameters that were refitted on
/// recordings with an effect in them have taken up most of it, and beside them as they are it explains nothing. What was found with them free
/// and is lost without is kept with them fitted along.
fn prune_or_refit(work: &mut Work, band: f64, settings: &Settings) {
    let (found, chain) = (work.picks.clone(), work.design.chain.clone());
    prune(work, band, settings);
    let is_structure = |work: &Work, p: &Pick| work.candidates[p.candidate].effect.family() != Family::Standard;
    let lost: Vec<usize> = found.iter().filter(|p| is_structure(work, p) && !is_picked(work, p.candidate)).map(|p| p.candidate).collect();
    if lost.is_empty() {
        return;
    }
    let plain = (work.picks.clone(), work.design.chain.clone());
    work.picks = found.into_iter().filter(|p| is_structure(work, p)).collect();
    work.design.chain = chain;
    work.is_refitted = true;
    refresh_chain(work, band);
    prune(work, band, settings);
    if !lost.iter().any(|&c| is_picked(work, c)) {
        (work.picks, work.design.chain) = plain;
        work.is_refitted = false;
        refresh_chain(work, band);
    }
    tracing::debug!(is_refitted = work.is_refitted, "what was lost on top of the robot as given");
}

/// Takes a pick out, its chain included.
pub(crate) fn drop_pick(work: &mut Work, pick: usize, band: f64) {
    let gone = work.picks.remove(pick);
    tell(work, "dropped", &gone);
    let c = &work.candidates[gone.candidate];
    if c.effect.family() == Family::Chain {
        let joint = c.scope[0];
        work.design.chain[joint] = work.design.given_chain[joint];
        refresh_chain(work, band);
    }
}

/// Held-out share of a drive's squared error that its lag or delay takes away. Its column is only an increment about the chain as it
/// stands, so the chain itself is taken out and the rest fitted anew.
fn chain_gain(work: &mut Work, pick: usize) -> f64 {
    chain_gain_judged_by(work, pick, Base::new)
}

/// The same on held-out rows.
pub(crate) fn chain_held_out_gain(work: &mut Work, pick: usize) -> f64 {
    chain_gain_judged_by(work, pick, Base::held_out)
}

fn chain_gain_judged_by(work: &mut Work, pick: usize, judge: fn(&Gram, &Cross, &[ColumnId], &[f64]) -> Base) -> f64 {
    let scope = work.candidates[work.picks[pick].candidate].scope.clone();
    let error = |work: &Work, without: Option<usize>| {
        let cross = work.gram.cross(&work.design, &work.real_targets(&[work.softness]));
        let (columns, prior) = work.picked(without);
        judge(&work.gram, &cross, &columns, &prior).over(&scope, 0)
    };
    let with = error(work, None);
    let (joint, chain) = (scope[0], work.design.chain[scope[0]]);
    work.design.chain[joint] = work.design.given_chain[joint];
    work.rebuild();
    let without = error(work, Some(pick));
    work.design.chain[joint] = chain;
    work.rebuild();
    1.0 - with / without.max(f64::MIN_POSITIVE)
}

/// The pick whose loss costs least, if that is less than a pick must be worth.
fn superfluous(work: &mut Work, settings: &Settings) -> Option<usize> {
    let cross = work.gram.cross(&work.design, &work.real_targets(&[work.softness]));
    let (ids, prior) = work.picked(None);
    let theta = screen::fit(&work.gram, &cross, &ids, &prior, Over::All);
    let value = |id: ColumnId| ids.iter().position(|&i| i == id).map_or(0.0, |i| theta[(i, 0)]);
    let mut worst: Option<(f64, usize)> = None;
    for i in 0..work.picks.len() {
        let p = work.picks[i].clone();
        let (columns, prior) = work.picked(Some(i));
        let base = Base::new(&work.gram, &cross, &columns, &prior);
        let (own, own_prior) = crate::contest::own_columns(work, &p.variant, &columns);
        let scope = &work.candidates[p.candidate].scope.clone();
        let before = base.over(scope, 0).max(f64::MIN_POSITIVE);
        let mut gain = if work.candidates[p.candidate].effect.family() == Family::Chain {
            chain_gain(work, i)
        } else if own.is_empty() {
            0.0
        } else {
            let g = screen::gains(&work.gram, &cross, &base, &own, &own_prior, scope);
            g.scope.iter().map(|f| f[0]).sum::<f64>() / before
        };
        let size = crate::worth::size(work, p.candidate, &p.variant, &value);
        if size <= settings.tolerance_of(p.variant.n_own) {
            gain = gain.min(0.0);
        }
        let is_possible = crate::contest::reading(work, p.candidate, &p.variant, &value).is_ok();
        let gain = if is_possible { gain } else { f64::NEG_INFINITY };
        if gain <= settings.floor && worst.is_none_or(|(g, _)| gain < g) {
            worst = Some((gain, i));
        }
    }
    worst.map(|(_, i)| i)
}

fn grounds(work: &Work, kappa: f64) -> Vec<Ground> {
    (0..SOFTNESS.len())
        .map(|softness| {
            let (mut columns, mut prior) = work.with_rigid(work.every_model_has(softness), kappa);
            let (picked, picked_prior) = work.picked(None);
            for (id, p) in picked.into_iter().zip(picked_prior) {
                if !columns.contains(&id) {
                    columns.push(id);
                    prior.push(p);
                }
            }
            Ground { softness, columns, prior }
        })
        .collect()
}

/// Prior strength with which the ordinary parameters predict best on blocks they were not fitted on.
fn choose_prior(work: &Work) -> f64 {
    let error = |kappa: f64| {
        grounds(work, kappa)
            .iter()
            .map(|g| {
                let cross = work.gram.cross(&work.design, &work.real_targets(&[g.softness]));
                Base::new(&work.gram, &cross, &g.columns, &g.prior).total(0)
            })
            .fold(f64::INFINITY, f64::min)
    };
    // Ties go to the model as given.
    let mut best = (PRIORS[0], error(PRIORS[0]));
    for &kappa in &PRIORS[1..] {
        let e = error(kappa);
        if e < best.1 {
            best = (kappa, e);
        }
    }
    best.0
}

fn structure(work: &mut Work, band: f64, settings: &Settings, progress: &mut dyn FnMut(f64)) -> Contest {
    let mut refused: Vec<Score> = Vec::new();
    let mut step = 0;
    let mut last = loop {
        work.kappa = choose_prior(work);
        refresh_chain(work, band);
        let grounds = grounds(work, work.kappa);
        let best = best_ground(work, &grounds);
        work.set_softness(grounds[best].softness);
        let left = left_over(work, &grounds[best]);
        let pool: Vec<usize> = (0..work.candidates.len())
            .filter(|&c| work.candidates[c].effect.family() != Family::Standard && !is_picked(work, c))
            .filter(|&c| !second_chain(work, c) && !same_body(work, c) && !refused.iter().any(|s| s.candidate == c))
            .collect();
        let mut now = contest(work, &pool, &grounds, &left, settings);
        let pick = decide(work, &mut now, &grounds, settings);
        progress(0.4 + 0.4 * (step + 1) as f64 / (MAX_STRUCTURAL + 1) as f64);
        let Some(pick) = pick.filter(|_| step < MAX_STRUCTURAL) else { break now };
        let is_kept = holds(work, &pick, &grounds, settings);
        tell(work, if is_kept { "structure" } else { "refused: not on held-out rows" }, &pick);
        if !is_kept {
            refused.extend(now.scores.into_iter().find(|s| s.candidate == pick.candidate));
            continue;
        }
        step += 1;
        let softness = pick.variant.softness.unwrap_or(work.softness);
        work.pick(pick);
        work.set_softness(softness);
        fuller_shapes(work, settings);
        absorb_chain(work, band);
    };
    // They are out of the contest, not out of the account.
    last.scores.extend(refused);
    last
}

/// Whether structure found on the fitted rows is worth a name on the held-out ones too, on top of what was there before it. Several small wrong
/// ones, each needed to mend the others, would all pass a test against the rest of them.
fn holds(work: &Work, pick: &Pick, grounds: &[Ground], settings: &Settings) -> bool {
    let softness = pick.variant.softness.unwrap_or(work.softness);
    let Some(ground) = grounds.iter().find(|g| g.softness == softness) else { return true };
    let cross = work.gram.cross(&work.design, &work.real_targets(&[softness]));
    let base = Base::held_out(&work.gram, &cross, &ground.columns, &ground.prior);
    let (own, prior) = crate::contest::own_columns(work, &pick.variant, &ground.columns);
    let scope = &work.candidates[pick.candidate].scope;
    if own.is_empty() {
        return true;
    }
    // Efforts and other positions each have their own errors: what is worth a name in one of them need not show in the other.
    let is_worth = |part: &Vec<usize>| {
        let taken = screen::gains(&work.gram, &cross, &base, &own, &prior, part).scope[0][0];
        taken > settings.floor_of(pick.variant.n_own) * base.over(part, 0)
    };
    work.kinds_of_rows(scope).iter().any(is_worth)
}

fn is_picked(work: &Work, candidate: usize) -> bool {
    work.picks.iter().any(|p| p.candidate == candidate)
}

/// Whether the mass properties of a candidate's link are already being changed by a pick: one link, one change.
fn same_body(work: &Work, candidate: usize) -> bool {
    let is_body = |c: usize| matches!(work.candidates[c].effect_name(), "payload" | "inertia_error");
    is_body(candidate)
        && work.picks.iter().any(|p| is_body(p.candidate) && work.candidates[p.candidate].place == work.candidates[candidate].place)
}

/// A change of a link's mass properties that was found in its simplest shape takes a fuller one, as a payload or as an error of the
/// link itself, where that pays on blocks it was not fitted on.
fn fuller_bodies(work: &mut Work, settings: &Settings) {
    for i in 0..work.picks.len() {
        let (at, n) = (work.picks[i].candidate, work.picks[i].variant.columns.len());
        if !same_body(work, at) {
            continue;
        }
        let scope = work.candidates[at].scope.clone();
        let now = picked_error(work, &scope);
        let place = work.candidates[at].place;
        let rivals: Vec<usize> = (0..work.candidates.len())
            .filter(|&c| matches!(work.candidates[c].effect_name(), "payload" | "inertia_error") && work.candidates[c].place == place)
            .collect();
        let old = work.picks[i].clone();
        let mut best = (now, old.clone());
        for c in rivals {
            for v in work.candidates[c].variants.clone().into_iter().filter(|v| v.columns.len() == v.n_own && v.n_own > n) {
                work.picks[i] = Pick { candidate: c, variant: v, ..old.clone() };
                let error = picked_error(work, &scope);
                let pays = now - error > settings.floor * now && work.of_effort(now - error, &scope) > settings.tolerance;
                // Payload comes first among equals: it is tried first and must be beaten clearly.
                if pays && error < 0.98 * best.0 && is_possible(work, i) {
                    best = (error, work.picks[i].clone());
                }
            }
        }
        work.picks[i] = best.1;
    }
}

pub(crate) fn picked_error(work: &Work, scope: &[usize]) -> f64 {
    let cross = work.gram.cross(&work.design, &work.real_targets(&[work.softness]));
    let (columns, prior) = work.picked(None);
    Base::new(&work.gram, &cross, &columns, &prior).over(scope, 0)
}

pub(crate) fn is_possible(work: &Work, pick: usize) -> bool {
    let cross = work.gram.cross(&work.design, &work.real_targets(&[work.softness]));
    let (ids, prior) = work.picked(None);
    let theta = screen::fit(&work.gram, &cross, &ids, &prior, Over::All);
    let value = |id: ColumnId| ids.iter().position(|&i| i == id).map_or(0.0, |i| theta[(i, 0)]);
    let p = &work.picks[pick];
    crate::contest::reading(work, p.candidate, &p.variant, &value).is_ok()
}

/// A drive has one lag or one delay: together they are told apart only by what no ordinary recording contains.
fn second_chain(work: &Work, candidate: usize) -> bool {
    let is_chain = |c: usize| work.candidates[c].effect.family() == Family::Chain;
    is_chain(candidate)
        && work.picks.iter().any(|p| is_chain(p.candidate) && work.candidates[p.candidate].scope == work.candidates[candidate].scope)
}

fn best_ground(work: &Work, grounds: &[Ground]) -> usize {
    let error = |g: &Ground| {
        let cross = work.gram.cross(&work.design, &work.real_targets(&[g.softness]));
        Base::new(&work.gram, &cross, &g.columns, &g.prior).total(0)
    };
    let errors: Vec<f64> = grounds.iter().map(error).collect();
    (0..errors.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b])).unwrap_or(0)
}

fn fit_ground(work: &Work, ground: &Ground) -> faer::Mat<f64> {
    let cross = work.gram.cross(&work.design, &work.real_targets(&[ground.softness]));
    screen::fit(&work.gram, &cross, &ground.columns, &ground.prior, Over::All)
}

fn left_over(work: &Work, ground: &Ground) -> Vec<Vec<Vec<f64>>> {
    let theta = fit_ground(work, ground);
    work.residual(&ground.columns, &theta, ground.softness, View::Fit)
}

fn refresh_chain(work: &mut Work, band: f64) {
    let models: Vec<_> = grounds(work, work.kappa).into_iter().map(|g| (g.columns.clone(), fit_ground(work, &g), g.softness)).collect();
    work.refresh_chain(&without_chain(work, models), band);
}

/// The chain's own columns are increments about the model; they are no part of the model that is moved.
fn without_chain(work: &Work, models: Vec<(Vec<ColumnId>, faer::Mat<f64>, usize)>) -> Vec<(Vec<ColumnId>, faer::Mat<f64>, usize)> {
    let chain: Vec<ColumnId> = work
        .candidates
        .iter()
        .filter(|c| c.effect.family() == Family::Chain)
        .flat_map(|c| c.variants.iter().flat_map(|v| v.columns.clone()))
        .collect();
    models
        .into_iter()
        .map(|(ids, mut theta, softness)| {
            for (i, id) in ids.iter().enumerate() {
                if chain.contains(id) {
                    theta[(i, 0)] = 0.0;
                }
            }
            (ids, theta, softness)
        })
        .collect()
}

/// Moves what the chain's columns found into the chain itself, a few times: a delay is its own derivative only while it is small.
fn absorb_chain(work: &mut Work, band: f64) {
    if !work.picks.iter().any(|p| work.candidates[p.candidate].effect.family() == Family::Chain) {
        return;
    }
    for _ in 0..3 {
        let ground = grounds(work, work.kappa).swap_remove(work.softness);
        let theta = fit_ground(work, &ground);
        apply_increments(work, &ground.columns, &theta);
        refresh_chain(work, band);
        work.set_softness(work.softness);
    }
}

fn apply_increments(work: &mut Work, ids: &[ColumnId], theta: &faer::Mat<f64>) {
    if work.design.is_shared() {
        // A row is a sum over the chains of all drives: each stays the size of its own column.
        return;
    }
    for p in &work.picks {
        let c = &work.candidates[p.candidate];
        if c.effect.family() != Family::Chain {
            continue;
        }
        let Some(i) = ids.iter().position(|id| *id == p.variant.columns[0]) else { continue };
        let chain: &mut Chain = &mut work.design.chain[c.scope[0]];
        if c.effect_name() == "actuator_lag" {
            chain.lag += theta[(i, 0)];
        } else {
            chain.delay += theta[(i, 0)];
        }
    }
}

/// Takes the softness with which the picked model predicts best on blocks it was not fitted on.
fn settle_softness(work: &mut Work, band: f64) {
    let mut best: Option<(f64, usize)> = None;
    for w in 0..SOFTNESS.len() {
        work.set_softness(w);
        refine_chain(work, band);
        let cross = work.gram.cross(&work.design, &work.real_targets(&[w]));
        let (columns, prior) = work.picked(None);
        let error = Base::new(&work.gram, &cross, &columns, &prior).total(0);
        if best.is_none_or(|(e, _)| error < e) {
            best = Some((error, w));
        }
    }
    if let Some((_, w)) = best {
        work.set_softness(w);
        refine_chain(work, band);
    }
}

/// Re-linearises picked chain effects about the final model, whose ordinary parameters are those that moved and no others.
pub(crate) fn refine_chain(work: &mut Work, band: f64) {
    if !work.picks.iter().any(|p| work.candidates[p.candidate].effect.family() == Family::Chain) {
        return;
    }
    for _ in 0..3 {
        let (columns, prior) = work.picked(None);
        let ground = Ground { softness: work.softness, columns, prior };
        let theta = fit_ground(work, &ground);
        apply_increments(work, &ground.columns, &theta);
        let models = without_chain(work, vec![(ground.columns, theta, work.softness)]);
        let models = (0..SOFTNESS.len()).map(|w| (models[0].0.clone(), models[0].1.clone(), w)).collect::<Vec<_>>();
        work.refresh_chain(&models, band);
        work.set_softness(work.softness);
    }
}

fn shifts(work: &mut Work, settings: &Settings) -> Option<Contest> {
    // Chance is measured on what a model with every ordinary parameter free leaves: noise, not the shifts that are sought.
    let free = grounds(work, work.kappa).swap_remove(work.softness);
    let left = left_over(work, &free);
    let mut last = None;
    for step in 0..=MAX_SHIFTS {
        let (columns, prior) = work.picked(None);
        let ground = [Ground { softness: work.softness, columns, prior }];
        let pool: Vec<usize> = (0..work.candidates.len())
            .filter(|&c| matches!(work.candidates[c].effect.family(), Family::Standard | Family::Shift) && !is_picked(work, c))
            .filter(|&c| !repeats_pick(work, c) && !same_body(work, c))
            .collect();
        let mut now = contest(work, &pool, &ground, &left, settings);
        let pick = decide(work, &mut now, &ground, settings);
        last = Some(now);
        let Some(pick) = pick.filter(|_| step < MAX_SHIFTS) else { break };
        tell(work, "shift", &pick);
        work.pick(pick);
        fuller_bodies(work, settings);
    }
    last
}

/// Whether all of a candidate's columns belong to something picked already (the constant of a spring is an offset).
fn repeats_pick(work: &Work, candidate: usize) -> bool {
    let (picked, _) = work.picked(None);
    work.candidates[candidate].variants.iter().all(|v| v.columns.iter().all(|id| picked.contains(id)))
}
