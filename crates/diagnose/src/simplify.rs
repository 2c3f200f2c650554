//! After a pick: the fuller shape of a law where it pays, and one cause in the place of several that do no better.

use crate::columns::Family;
use crate::prove::prune;
use crate::screen::Base;
use crate::search::{is_possible, picked_error};
use crate::settings::Settings;
use crate::work::{Pick, Work};

/// Errors this near each other are the same: what is gained below it is no reason for a second cause.
pub(crate) const AS_GOOD: f64 = 0.98;

/// Structure that was found in a simple shape takes a fuller one of its own law where that pays on blocks it was not fitted on: beside a
/// large parabola a cubic part is a small share of everything and most of what is left.
pub(crate) fn fuller_shapes(work: &mut Work, settings: &Settings) {
    for i in 0..work.picks.len() {
        let c = &work.candidates[work.picks[i].candidate];
        if c.effect.family() != Family::Structural {
            continue;
        }
        let (scope, shapes) = (c.scope.clone(), c.variants.clone());
        loop {
            let old = work.picks[i].clone();
            let now = picked_error_beside_ordinary(work, &scope);
            let mut best: Option<(f64, Pick)> = None;
            let is_open = |w: Option<usize>| w.is_none_or(|w| w == work.softness);
            for v in shapes.iter().filter(|v| v.n_own > old.variant.n_own && v.columns.len() == v.n_own && is_open(v.softness)) {
                work.picks[i] = Pick { variant: v.clone(), ..old.clone() };
                let error = picked_error_beside_ordinary(work, &scope);
                let pays = now - error > settings.floor * now
                    && work.of_effort(now - error, &scope) > settings.tolerance_of(v.n_own - old.variant.n_own);
                // Of those that do practically as well, the first has the fewest coefficients.
                if pays && best.as_ref().is_none_or(|(e, _)| error < AS_GOOD * e) && is_possible(work, i) {
                    best = Some((error, work.picks[i].clone()));
                }
            }
            work.picks[i] = best.as_ref().map_or(old, |(_, p)| p.clone());
            if best.is_none() {
                break;
            }
        }
    }
}

/// Held-out error of the picks with every ordinary parameter free, as structure is sought.
fn picked_error_beside_ordinary(work: &Work, scope: &[usize]) -> f64 {
    let (mut columns, mut prior) = work.with_rigid(work.every_model_has(work.softness), work.kappa);
    let (picked, picked_prior) = work.picked(None);
    for (id, p) in picked.into_iter().zip(picked_prior) {
        if !columns.contains(&id) {
            columns.push(id);
            prior.push(p);
        }
    }
    let cross = work.gram.cross(&work.design, &work.real_targets(&[work.softness]));
    Base::new(&work.gram, &cross, &columns, &prior).over(scope, 0)
}

/// Laws that another one is a special case of: both losses of a gear alike are friction in proportion to the load, and their difference
/// looks like a wrong scale, inertia or offset of the same drive.
const SPECIAL_CASES: [(&str, &str); 1] = [("friction_load", "directional_efficiency")];

/// Where a wider law makes other picks superfluous and explains as much with fewer causes, it stands in their place.
pub(crate) fn one_cause(work: &mut Work, band: f64, settings: &Settings) {
    let all: Vec<usize> = (0..work.design.n_joints).collect();
    for (special, wider) in SPECIAL_CASES {
        let places: Vec<usize> = work.picks.iter().map(|p| p.candidate).filter(|&c| work.candidates[c].effect_name() == special).collect();
        for c in places {
            let is_wider = |w: &usize| work.candidates[*w].effect_name() == wider && work.candidates[*w].is_where(&work.candidates[c]);
            let Some(candidate) = (0..work.candidates.len()).find(is_wider) else { continue };
            let Some(i) = work.picks.iter().position(|p| p.candidate == c) else { continue };
            let open = work.candidates[candidate].variants.iter().find(|v| v.softness.is_none_or(|w| w == work.softness)).cloned();
            let Some(variant) = open else { continue };
            let (old, chain, before) = (work.picks.clone(), work.design.chain.clone(), picked_error(work, &all));
            work.picks[i] = Pick { candidate, variant, ..work.picks[i].clone() };
            prune(work, band, settings);
            let is_there = work.picks.iter().any(|p| p.candidate == candidate);
            if is_there && work.picks.len() < old.len() && AS_GOOD * picked_error(work, &all) <= before {
                continue;
            }
            work.picks = old;
            if work.design.chain != chain {
                work.design.chain = chain;
                crate::chain::refine_chain(work, band);
            }
        }
    }
}
