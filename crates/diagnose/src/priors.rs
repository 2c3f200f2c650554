//! Whether a finding rests on how far the model's inertias are believed: refitting conceals, and not refitting reveals what is none.

use crate::columns::Family;
use crate::design::ColumnId;
use crate::screen::{self, Base};
use crate::settings::{PRIORS, Settings};
use crate::verdict::PriorGains;
use crate::work::Work;

/// Gains of the pick at `index` with the inertias exact, within their prior, and free, each with friction and offsets free and every other
/// pick in the model.
pub(crate) fn gains(work: &mut Work, index: usize, settings: &Settings) -> PriorGains {
    let soft_prior = if work.kappa > 0.0 { work.kappa } else { PRIORS[1] };
    let [anchored, soft, refit] = [0.0, soft_prior, f64::INFINITY].map(|kappa| gain(work, index, kappa));
    let worth = [anchored, soft, refit].map(|g| g > settings.floor);
    let depends = worth.iter().any(|w| *w) && !worth.iter().all(|w| *w);
    PriorGains { anchored, soft, refit, soft_prior, depends }
}

/// Cosine between what is left without the pick at `index` and what the pick explains: the root of the share of squared error it takes away, no
/// less than what a name needs. What was left out explains all of what it leaves but noise; what merely resembles it explains less. A parameter
/// that moved is judged beside the inertias as given, for they would take it up, and by the verdict's own `heldout` share.
pub(crate) fn likeness(work: &Work, index: usize, g: &PriorGains, (heldout, floor): (f64, f64)) -> f64 {
    let family = work.candidates[work.picks[index].candidate].effect.family();
    let gain = if matches!(family, Family::Standard | Family::Shift) { g.anchored.max(heldout) } else { g.refit };
    pkm_dyn::math::sqrt(gain.clamp(floor.clamp(0.0, 1.0), 1.0))
}

/// What to add to a finding's sentence; empty where it does not depend on the prior.
pub(crate) fn sentence(g: &PriorGains, floor: f64) -> String {
    if !g.depends {
        return String::new();
    }
    let percent = |x: f64| format!("{:.1} %", 100.0 * x.max(0.0));
    let numbers = format!(
        "{} of the squared error with them exact, {} within {:.0} %, {} refitted",
        percent(g.anchored),
        percent(g.soft),
        100.0 * g.soft_prior,
        percent(g.refit)
    );
    let what =
        if g.anchored > floor { "It rests on the inertias of the model" } else { "It shows only where the inertias of the model may move" };
    format!(" {what} (it takes away {numbers}).")
}

/// What a base predicts on blocks it was not fitted on: ids, inverse prior variances.
type Ground = (Vec<ColumnId>, Vec<f64>);

fn gain(work: &mut Work, index: usize, kappa: f64) -> f64 {
    let p = &work.picks[index];
    let (candidate, own) = (p.candidate, p.variant.columns.clone());
    let scope = work.candidates[candidate].scope.clone();
    let ground = ground(work, index, kappa);
    if work.candidates[candidate].effect.family() == Family::Chain {
        return chain_gain(work, (index, &scope), ground);
    }
    let cross = work.gram.cross(&work.design, &work.real_targets(&[work.softness]));
    let base = Base::new(&work.gram, &cross, &ground.0, &ground.1);
    let before = base.over(&scope, 0).max(f64::MIN_POSITIVE);
    // A column that the base has without a prior adds nothing to it; one with a prior is set free by the finding.
    let is_free = |id: &ColumnId| ground.0.iter().position(|i| i == id).is_some_and(|i| ground.1[i] <= 0.0);
    let prior = &work.picks[index].variant.prior;
    let (ids, prior): (Vec<ColumnId>, Vec<f64>) =
        own.iter().zip(prior).filter(|(id, _)| !is_free(id)).map(|(&id, &sd)| (id, work.inverse_variance(id, sd))).unzip();
    let left = crate::isolability::projected(&work.gram, &ground.0, &ground.1, &ids);
    let survives =
        (0..ids.len()).any(|i| left[(i, i)] > SURVIVES * (0..work.design.n_joints).map(|j| work.gram.power(ids[i], j)).sum::<f64>());
    if !survives {
        return 0.0;
    }
    let g = screen::gains(&work.gram, &cross, &base, &ids, &prior, &scope);
    g.scope[0] / before
}

/// Share of a column's squared length below which what survives is rounding.
const SURVIVES: f64 = 1e-6;

/// Friction, offsets and the other picks free, inertias within `kappa` of their size.
fn ground(work: &Work, index: usize, kappa: f64) -> Ground {
    let (mut ids, mut prior) = work.with_rigid(work.every_model_has(work.softness), kappa);
    let (picked, picked_prior) = work.picked(Some(index));
    for (id, p) in picked.into_iter().zip(picked_prior) {
        match ids.iter().position(|i| *i == id) {
            Some(at) => prior[at] = prior[at].min(p),
            None => {
                ids.push(id);
                prior.push(p);
            }
        }
    }
    // An ordinary parameter is judged with the others free, itself excepted.
    if work.candidates[work.picks[index].candidate].effect.family() == Family::Standard {
        let own = &work.picks[index].variant.columns;
        return ids.into_iter().zip(prior).filter(|(id, _)| !own.contains(id)).unzip();
    }
    (ids, prior)
}

/// A lag's or delay's column is an increment about the chain as it stands, so the chain itself is taken out.
fn chain_gain(work: &mut Work, (index, scope): (usize, &[usize]), (ids, prior): Ground) -> f64 {
    let error = |work: &Work, ids: &[ColumnId], prior: &[f64]| {
        let cross = work.gram.cross(&work.design, &work.real_targets(&[work.softness]));
        Base::new(&work.gram, &cross, ids, prior).over(scope, 0)
    };
    let own = work.picks[index].variant.columns.clone();
    let with_ids: Vec<ColumnId> = ids.iter().chain(&own).copied().collect();
    let with_prior: Vec<f64> = prior.iter().copied().chain(own.iter().map(|_| 0.0)).collect();
    let with = error(work, &with_ids, &with_prior);
    let without = work.with_chain_out(scope[0], |work| error(work, &ids, &prior));
    1.0 - with / without.max(f64::MIN_POSITIVE)
}
