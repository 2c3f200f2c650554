//! The search: structure first with every ordinary parameter free, then which ordinary parameters moved.

use crate::chain::{absorb_chain, refresh_chain, second_chain, settle_softness};
use crate::columns::Family;
use crate::contest::{Contest, Ground, Score, contest, decide, fuller};
use crate::design::View;
use crate::prove::{Found, prove, prove_refitted, prune_or_refit};
use crate::screen::{self, Base, Fitted};
use crate::settings::{MAX_SHIFTS, MAX_STRUCTURAL, PRIORS, SOFTNESS, Settings};
use crate::simplify::{AS_GOOD, fuller_shapes};
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
    let found = Found::of(work);
    prune_or_refit(work, band, settings);
    settle_softness(work, band);
    progress(0.85);
    let ordinary = shifts(work, settings);
    settle_softness(work, band);
    prove(work, band, settings, settings.confirm_level);
    if !work.is_refitted {
        prove_refitted(work, band, settings, found);
    }
    progress(0.95);
    Search { last: core::iter::once(structure).chain(ordinary).collect() }
}

/// A step of the search, for whoever asks for it.
pub(crate) fn tell(work: &Work, what: &str, pick: &Pick) {
    let c = &work.candidates[pick.candidate];
    tracing::debug!(effect = c.effect_name(), place = c.name, shape = ?pick.variant.values, what);
}

pub(crate) fn grounds(work: &Work, kappa: f64) -> Vec<Ground> {
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

/// Models with every ordinary parameter free, chains made anew about them, and what the one that predicts best leaves: [joint][segment][row].
fn standing(work: &mut Work, band: f64) -> (Vec<Ground>, Vec<Vec<Vec<f64>>>) {
    work.kappa = choose_prior(work);
    refresh_chain(work, band);
    let grounds = grounds(work, work.kappa);
    let best = best_ground(work, &grounds);
    work.set_softness(grounds[best].softness);
    let left = left_over(work, &grounds[best]);
    (grounds, left)
}

fn structure(work: &mut Work, band: f64, settings: &Settings, progress: &mut dyn FnMut(f64)) -> Contest {
    let mut refused: Vec<Score> = Vec::new();
    let mut step = 0;
    let mut last = loop {
        let (grounds, left) = standing(work, band);
        let pool: Vec<usize> = (0..work.candidates.len())
            .filter(|&c| work.candidates[c].effect.family() != Family::Standard && !is_picked(work, c))
            .filter(|&c| !second_chain(work, c) && !same_body(work, c) && !same_push(work, c) && !refused.iter().any(|s| s.candidate == c))
            .collect();
        let mut now = contest(work, &pool, &grounds, &left, settings);
        let pick = decide(work, &mut now, &grounds, settings);
        progress(0.4 + 0.4 * (step + 1) as f64 / (MAX_STRUCTURAL + 1) as f64);
        let Some(pick) = pick.filter(|_| step < MAX_STRUCTURAL) else { break now };
        let kept = that_holds(work, &now, &pick, &grounds, settings).or_else(|| crate::confirm::fitted_only(work, &pick, settings));
        tell(work, if kept.is_some() { "structure" } else { "refused: not on held-out rows" }, kept.as_ref().unwrap_or(&pick));
        let Some(pick) = kept else {
            refused.extend(now.scores.into_iter().find(|s| s.candidate == pick.candidate));
            continue;
        };
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

/// Whether a lag or delay stands out of what models with every ordinary parameter free leave, on fitted rows and on held-out ones.
pub(crate) fn shows_a_chain(work: &mut Work, band: f64, settings: &Settings) -> bool {
    let (grounds, left) = standing(work, band);
    let pool: Vec<usize> = (0..work.candidates.len()).filter(|&c| work.candidates[c].effect.family() == Family::Chain).collect();
    let mut now = contest(work, &pool, &grounds, &left, settings);
    decide(work, &mut now, &grounds, settings).is_some_and(|pick| holds(work, &pick, &grounds, settings))
}

/// The pick, or a fuller shape of it, that is worth a name on held-out rows too.
fn that_holds(work: &Work, now: &Contest, pick: &Pick, grounds: &[Ground], settings: &Settings) -> Option<Pick> {
    if holds(work, pick, grounds, settings) {
        return Some(pick.clone());
    }
    fuller(work, now, pick.candidate, grounds, settings).into_iter().find(|p| holds(work, p, grounds, settings))
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
        let taken = screen::gains(&work.gram, &cross, &base, &own, &prior, part).scope[0];
        taken > settings.floor_of(pick.variant.n_own) * base.over(part, 0)
    };
    work.kinds_of_rows(scope).iter().any(is_worth)
}

pub(crate) fn is_structure(work: &Work, pick: &Pick) -> bool {
    work.candidates[pick.candidate].effect.family() != Family::Standard
}

pub(crate) fn is_picked(work: &Work, candidate: usize) -> bool {
    work.picks.iter().any(|p| p.candidate == candidate)
}

/// Whether a candidate changes the mass properties of a link.
fn is_body(work: &Work, candidate: usize) -> bool {
    matches!(work.candidates[candidate].effect_name(), "payload" | "inertia_error")
}

/// Whether the mass properties of a candidate's link are already being changed by a pick: one link, one change.
fn same_body(work: &Work, candidate: usize) -> bool {
    let place = work.candidates[candidate].place;
    is_body(work, candidate) && work.picks.iter().any(|p| is_body(work, p.candidate) && work.candidates[p.candidate].place == place)
}

/// Whether a push at the same time has been picked: one hand pushes at one place, and each drive that feels it would be another explanation.
fn same_push(work: &Work, candidate: usize) -> bool {
    let c = &work.candidates[candidate];
    let overlaps =
        |p: &Pick| c.variants.first().is_some_and(|v| crate::columns::external_force::are_together(&v.values, &p.variant.values));
    c.effect_name() == "external_force"
        && work.picks.iter().any(|p| work.candidates[p.candidate].effect_name() == c.effect_name() && overlaps(p))
}

/// A change of a link's mass properties that was found in its simplest shape takes a fuller one, as a payload or as an error of the
/// link itself, where that pays on blocks it was not fitted on.
fn fuller_bodies(work: &mut Work, settings: &Settings) {
    for i in 0..work.picks.len() {
        let (at, n) = (work.picks[i].candidate, work.picks[i].variant.columns.len());
        if !is_body(work, at) {
            continue;
        }
        let scope = work.candidates[at].scope.clone();
        let now = picked_error(work, &scope);
        let rivals = bodies_at(work, at);
        let old = work.picks[i].clone();
        let mut best = (now, old.clone());
        for c in rivals {
            for v in work.candidates[c].variants.clone().into_iter().filter(|v| v.columns.len() == v.n_own && v.n_own > n) {
                work.picks[i] = Pick { candidate: c, variant: v, ..old.clone() };
                let error = picked_error(work, &scope);
                let pays = now - error > settings.floor * now && work.of_effort(now - error, &scope) > settings.tolerance;
                // Payload comes first among equals: it is tried first and must be beaten clearly.
                if pays && error < AS_GOOD * best.0 && is_possible(work, i) {
                    best = (error, work.picks[i].clone());
                }
            }
        }
        work.picks[i] = best.1;
    }
}

/// Changes of the mass properties of a candidate's link, its own included.
fn bodies_at(work: &Work, candidate: usize) -> Vec<usize> {
    let place = work.candidates[candidate].place;
    (0..work.candidates.len()).filter(|&c| is_body(work, c) && work.candidates[c].place == place).collect()
}

/// A change of a link's mass properties that reads as impossible takes the simpler shape that can be and explains most, if that is worth a name: of
/// ten numbers these motions may show three. Whether there is one.
pub(crate) fn simpler_body(work: &mut Work, pick: usize, settings: &Settings) -> bool {
    let old = work.picks[pick].clone();
    if !is_body(work, old.candidate) {
        return false;
    }
    let scope = work.candidates[old.candidate].scope.clone();
    work.picks.remove(pick);
    let without = picked_error(work, &scope);
    let mut best: Option<(f64, Pick)> = None;
    for candidate in bodies_at(work, old.candidate) {
        for mut variant in work.candidates[candidate].variants.clone().into_iter().filter(|v| v.n_own < old.variant.n_own) {
            variant.values = work.candidates[candidate].effect.stand_in(&variant.values);
            let least = settings.floor_of(variant.n_own) * without;
            work.picks.insert(pick, Pick { candidate, variant, ..old.clone() });
            let error = picked_error(work, &scope);
            let pays = without - error > least && best.as_ref().is_none_or(|(e, _)| error < AS_GOOD * e);
            if pays && is_possible(work, pick) {
                best = Some((error, work.picks[pick].clone()));
            }
            work.picks.remove(pick);
        }
    }
    let is_found = best.is_some();
    work.picks.insert(pick, best.map_or(old, |(_, simpler)| simpler));
    is_found
}

pub(crate) fn picked_error(work: &Work, scope: &[usize]) -> f64 {
    let cross = work.gram.cross(&work.design, &work.real_targets(&[work.softness]));
    let (columns, prior) = work.picked(None);
    Base::new(&work.gram, &cross, &columns, &prior).over(scope, 0)
}

pub(crate) fn is_possible(work: &Work, pick: usize) -> bool {
    let cross = work.gram.cross(&work.design, &work.real_targets(&[work.softness]));
    let (columns, prior) = work.picked(None);
    can_be(work, &work.picks[pick], &Fitted::new(&work.gram, &cross, columns, &prior))
}

/// Whether what was fitted reads as possible.
pub(crate) fn can_be(work: &Work, p: &Pick, fitted: &Fitted) -> bool {
    crate::contest::reading(work, p.candidate, &p.variant, &|id| fitted.coefficient(id)).is_ok()
}

fn best_ground(work: &Work, grounds: &[Ground]) -> usize {
    let error = |g: &Ground| {
        let cross = work.gram.cross(&work.design, &work.real_targets(&[g.softness]));
        Base::new(&work.gram, &cross, &g.columns, &g.prior).total(0)
    };
    let errors: Vec<f64> = grounds.iter().map(error).collect();
    (0..errors.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b])).unwrap_or(0)
}

pub(crate) fn fit_ground(work: &Work, ground: &Ground) -> faer::Mat<f64> {
    let cross = work.gram.cross(&work.design, &work.real_targets(&[ground.softness]));
    screen::fit(&work.gram, &cross, &ground.columns, &ground.prior, Over::All)
}

fn left_over(work: &Work, ground: &Ground) -> Vec<Vec<Vec<f64>>> {
    let theta = fit_ground(work, ground);
    work.residual(&ground.columns, &theta, ground.softness, View::Fit)
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
