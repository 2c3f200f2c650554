//! Lags and delays of drives while a search goes on: they move a finished model in time, so they are found in small steps about it.

use crate::columns::Family;
use crate::contest::Ground;
use crate::design::{Chain, ColumnId};
use crate::screen::Base;
use crate::search::{fit_ground, grounds};
use crate::settings::SOFTNESS;
use crate::work::Work;

/// A drive has one lag or one delay: together they are told apart only by what no ordinary recording contains.
pub(crate) fn second_chain(work: &Work, candidate: usize) -> bool {
    let is_chain = |c: usize| work.candidates[c].effect.family() == Family::Chain;
    is_chain(candidate)
        && work.picks.iter().any(|p| is_chain(p.candidate) && work.candidates[p.candidate].scope == work.candidates[candidate].scope)
}

pub(crate) fn refresh_chain(work: &mut Work, band: f64) {
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
pub(crate) fn absorb_chain(work: &mut Work, band: f64) {
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

/// Takes the softness with which the picked model predicts best on blocks it was not fitted on.
pub(crate) fn settle_softness(work: &mut Work, band: f64) {
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
