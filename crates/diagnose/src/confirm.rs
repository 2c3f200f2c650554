//! The confirm set, read once: every pick must help on held-out data more than chance would.

use crate::columns::Family;
use crate::columns::external_force::{acts_in_fitted_only, in_fitted_only};
use crate::contest::{mean_and_sd, own_columns, surrogates};
use crate::design::View;
use crate::prove::{chain_held_out_gain, drop_pick};
use crate::screen::{self, Base};
use crate::settings::Settings;
use crate::work::{Pick, Work};

/// Drops picks that do not help on held-out rows; the others keep their p-value.
///
/// All picks are tested in one look and dropped together: a test repeated after every drop would look at the held-out rows as often as
/// something fails. The p-values are family-wise over the picks, from the largest surprise among them in each null run.
pub(crate) fn confirm(work: &mut Work, band: f64, settings: &Settings, level: f64) {
    let judged = judge(work, settings);
    let p_values = family_wise(&judged, settings.null_runs);
    for i in (0..work.picks.len()).rev() {
        let (Some(p), Some((gain, _))) = (p_values[i], &judged[i]) else { continue };
        work.picks[i].p_confirm = p;
        let c = &work.candidates[work.picks[i].candidate];
        tracing::debug!(effect = c.effect_name(), place = c.name, gain, p, level, "on held-out rows");
        if (p > level || *gain <= least(work, i, settings)) && !stays_in_fitted_only(work, i, settings) {
            drop_pick(work, i, band);
        }
    }
}

/// Held-out gain that a pick must have. Structure was asked for what is worth a name there when it was found; a number of the robot's own that moved is
/// asked now, for a fit of it on some motions is always a little better on these.
fn least(work: &Work, pick: usize, settings: &Settings) -> f64 {
    let p = &work.picks[pick];
    if work.candidates[p.candidate].effect.is_refittable() { settings.floor_of(p.variant.n_own) } else { 0.0 }
}

/// Puts the shape in place that did not act in recordings that are only judged on, where a pick has one and the search alone is sure enough.
fn stays_in_fitted_only(work: &mut Work, pick: usize, settings: &Settings) -> bool {
    let p = &work.picks[pick];
    let twin = if is_in_fitted_only(work, p) { Some(Pick { p_confirm: 1.0, ..p.clone() }) } else { fitted_only(work, p, settings) };
    twin.map(|twin| work.picks[pick] = twin).is_some()
}

/// Whether a pick did not act in recordings that are only judged on: nothing in them can tell of it.
pub(crate) fn is_in_fitted_only(work: &Work, p: &Pick) -> bool {
    work.candidates[p.candidate].effect_name() == "external_force" && acts_in_fitted_only(&p.variant.values)
}

/// Of the search and the confirmation together: for two independent p-values with product `k`, `k·(1 − ln k)` is one again.
pub(crate) fn p_value(search: f64, confirm: f64, settings: &Settings) -> f64 {
    let k = search * confirm;
    (k * (1.0 - pkm_dyn::math::ln(k))).clamp(1.0 / (settings.null_runs + 1) as f64, 1.0)
}

/// The pick as one that did not act in recordings that are only judged on, if there is such a shape and the search alone is sure enough: a push on
/// somebody's arm need not come back in another recording. Nothing confirms it then, and its p-value says so.
pub(crate) fn fitted_only(work: &Work, p: &Pick, settings: &Settings) -> Option<Pick> {
    let c = &work.candidates[p.candidate];
    let is_sure = |p_search: f64| p_value(p_search, 1.0, settings) <= settings.confirm_level;
    if c.effect_name() != "external_force" || !is_sure(p.p_search) {
        return None;
    }
    let values = in_fitted_only(&p.variant.values)?;
    // The search took the window as given. Who looks for one finds one, and no other recording speaks against it.
    let p_search = p.p_search.max(work.chance_of_push(p.candidate, settings));
    if !is_sure(p_search) {
        return None;
    }
    let distance = |v: &crate::work::Variant| (v.values[0] - values[0]).abs() + (v.values[1] - values[1]).abs();
    let twins = c.variants.iter().filter(|v| v.values[2] >= values[2]);
    let variant = twins.min_by(|a, b| distance(a).total_cmp(&distance(b)))?.clone();
    Some(Pick { variant, p_search, p_confirm: 1.0, ..p.clone() })
}

/// A pick's held-out gain, and what it gains in each null run; `None` where it has no column of its own.
type Judged = Option<(f64, Vec<f64>)>;

/// Chance that any of several picks would surprise as much as each does.
fn family_wise(judged: &[Judged], null_runs: usize) -> Vec<Option<f64>> {
    let mut null = vec![f64::NEG_INFINITY; null_runs];
    let mut surprises = Vec::with_capacity(judged.len());
    for j in judged {
        surprises.push(j.as_ref().map(|(gain, nulls)| {
            // Joints differ in how much chance can do there.
            let (mean, sd) = mean_and_sd(nulls);
            null.iter_mut().zip(nulls).for_each(|(n, g)| *n = n.max((g - mean) / sd));
            (gain - mean) / sd
        }));
    }
    let p = |surprise: f64| (1 + null.iter().filter(|n| **n >= surprise).count()) as f64 / (1 + null_runs) as f64;
    surprises.into_iter().map(|s| s.map(p)).collect()
}

/// Every pick with the others in the model, on held-out rows.
fn judge(work: &mut Work, settings: &Settings) -> Vec<Judged> {
    let (ids, prior) = work.picked(None);
    let real = work.real_targets(&[work.softness]);
    let cross = work.gram.cross(&work.design, &real);
    let theta = screen::fit(&work.gram, &cross, &ids, &prior, crate::solve::Over::All);
    let left = work.residual(&ids, &theta, work.softness, View::Fit);
    let mut targets = real;
    targets.extend(surrogates(work, &left, settings));
    let cross = work.gram.cross(&work.design, &targets);
    (0..work.picks.len())
        .map(|i| {
            let p = &work.picks[i];
            let scope = work.candidates[p.candidate].scope.clone();
            // The increment of a lag or delay is nothing by itself: it is put back to its whole size.
            let whole = work.candidates[p.candidate].effect.family() == Family::Chain;
            let (columns, prior) = work.picked(Some(i));
            let base = Base::held_out(&work.gram, &cross, &columns, &prior);
            let (own, own_prior) = own_columns(work, &p.variant, &columns);
            if own.is_empty() {
                return None;
            }
            // Efforts and other positions each have their own errors: it may help with one of them only.
            let parts = work.kinds_of_rows(&scope);
            let of_part: Vec<_> = parts.iter().map(|part| screen::gains(&work.gram, &cross, &base, &own, &own_prior, part)).collect();
            let gain = |t: usize| {
                let each = parts.iter().zip(&of_part).map(|(part, g)| g.scope[t] / base.over(part, t).max(f64::MIN_POSITIVE));
                each.fold(f64::NEG_INFINITY, f64::max)
            };
            let own_gain = if whole { chain_held_out_gain(work, i) } else { gain(0) };
            Some((own_gain, (1..=settings.null_runs).map(gain).collect()))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn many_picks_of_chance_are_confirmed_no_oftener_than_one() {
        // Twenty picks that gain what chance gains: tested one by one, about one in twenty would pass at 0.05; as a family, one run in twenty
        // lets any pass at all.
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let mut passed = 0;
        let trials = 400;
        for _ in 0..trials {
            let draw = |rng: &mut rand_chacha::ChaCha8Rng| (0..4).map(|_| rng.random::<f64>()).sum::<f64>() - 2.0;
            let judged: Vec<Judged> = (0..20).map(|_| Some((draw(&mut rng), (0..199).map(|_| draw(&mut rng)).collect()))).collect();
            passed += usize::from(family_wise(&judged, 199).iter().flatten().any(|p| *p <= 0.05));
        }
        // 5 % of 400 is 20, with a standard deviation of 4.4.
        assert!(passed < 20 + 3 * 5, "{passed} of {trials} families let a pick of chance through");
        let alone = family_wise(&[Some((9.0, vec![0.0, 1.0, 2.0])), None], 3);
        assert_eq!(alone, vec![Some(0.25), None]);
    }
}
