//! What stays of what was found: nothing that the others make superfluous, that reads as impossible, or that held-out rows do not confirm.

use crate::chain::{refine_chain, refresh_chain};
use crate::columns::Family;
use crate::design::{Chain, ColumnId};
use crate::gram::{Cross, Gram};
use crate::screen::{self, Base, Fitted};
use crate::search::{can_be, is_picked, is_possible, is_structure, simpler_body, tell};
use crate::settings::{MAX_SHIFTS, MAX_STRUCTURAL, Settings};
use crate::simplify::one_cause;
use crate::work::{Pick, Work};

/// What has been found so far, to come back to.
pub(crate) struct Found {
    picks: Vec<Pick>,
    chain: Vec<Chain>,
    softness: usize,
    is_refitted: bool,
}

impl Found {
    pub(crate) fn of(work: &Work) -> Self {
        let (picks, chain) = (work.picks.clone(), work.design.chain.clone());
        Self { picks, chain, softness: work.softness, is_refitted: work.is_refitted }
    }

    fn put_back(self, work: &mut Work, band: f64) {
        (work.picks, work.design.chain, work.is_refitted) = (self.picks, self.chain, self.is_refitted);
        work.set_softness(self.softness);
        refresh_chain(work, band);
    }
}

/// Takes out what the whole does not need and what held-out rows do not confirm.
pub(crate) fn prove(work: &mut Work, band: f64, settings: &Settings, level: f64) {
    prune(work, band, settings);
    one_cause(work, band, settings);
    crate::confirm::confirm(work, band, settings, level);
    refine_chain(work, band);
    // What is left after a drop may read differently: nothing impossible or superfluous goes into a verdict.
    prune(work, band, settings);
}

/// What was found with ordinary parameters free, and is not confirmed on top of the robot as given, is tried once more with them fitted along:
/// a robot that was refitted on such recordings contradicts it on every other motion. Held-out rows are looked at a second time, so each look
/// has half of the level.
pub(crate) fn prove_refitted(work: &mut Work, band: f64, settings: &Settings, found: Found) {
    let structural: Vec<Pick> = found.picks.into_iter().filter(|p| is_structure(work, p)).collect();
    let lost: Vec<usize> = structural.iter().map(|p| p.candidate).filter(|&c| !is_picked(work, c)).collect();
    if lost.is_empty() {
        return;
    }
    let plain = Found::of(work);
    Found { picks: structural, is_refitted: true, ..found }.put_back(work, band);
    prove(work, band, settings, 0.5 * settings.confirm_level);
    let is_proved = lost.iter().any(|&c| is_picked(work, c));
    tracing::debug!(is_proved, "what was not confirmed on top of the robot as given");
    if !is_proved {
        plain.put_back(work, band);
    }
}

/// Takes out, worst first, picks that the others make superfluous, that read as impossible, or that a simpler effect replaces.
pub(crate) fn prune(work: &mut Work, band: f64, settings: &Settings) {
    for _ in 0..2 * (MAX_SHIFTS + MAX_STRUCTURAL) {
        let Some(worst) = superfluous(work, settings) else { return };
        if is_possible(work, worst) || !simpler_body(work, worst, settings) {
            drop_pick(work, worst, band);
        }
    }
}

/// Takes out what is superfluous on top of the robot as given, unless the robot as given is what hides it: parameters that were refitted on
/// recordings with an effect in them have taken up most of it, and beside them as they are it explains nothing. What was found with them free
/// and is lost without is kept with them fitted along.
pub(crate) fn prune_or_refit(work: &mut Work, band: f64, settings: &Settings) {
    let (found, chain) = (work.picks.clone(), work.design.chain.clone());
    prune(work, band, settings);
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
    let without = work.with_chain_out(scope[0], |work| error(work, Some(pick)));
    1.0 - with / without.max(f64::MIN_POSITIVE)
}

/// All picks fitted together, or all but one.
fn fitted(work: &Work, cross: &Cross, without: Option<usize>) -> Fitted {
    let (columns, prior) = work.picked(without);
    Fitted::new(&work.gram, cross, columns, &prior)
}

/// Picks that read as impossible beside the others, one of them left out or none.
fn impossible(work: &Work, fitted: &Fitted, without: Option<usize>) -> Vec<usize> {
    (0..work.picks.len()).filter(|&i| Some(i) != without && !can_be(work, &work.picks[i], fitted)).collect()
}

/// The pick to go where any reads as impossible: one of these where the others explain as much without it; else the one whose loss leaves least of these, of
/// those without which none does, and of `worst`, which the others make superfluous. Masses of neighbouring links share what one of them explains, and
/// beside the wrong ones the true one may be what reads as impossible.
fn in_the_way(work: &Work, cross: &Cross, bad: &[usize], worst: Option<usize>, settings: &Settings) -> Option<usize> {
    let left = |i: usize| {
        let (columns, prior) = work.picked(Some(i));
        Base::new(&work.gram, cross, &columns, &prior).total(0)
    };
    let least = |picks: Vec<usize>| picks.into_iter().map(|i| (left(i), i)).min_by(|a, b| a.0.total_cmp(&b.0));
    let of_bad = least(bad.to_vec())?;
    let is_chain = |i: usize| work.candidates[work.picks[i].candidate].effect.family() == Family::Chain;
    let is_cure = |i: usize| !is_chain(i) && impossible(work, &fitted(work, cross, Some(i)), Some(i)).is_empty();
    let others = (0..work.picks.len()).filter(|&i| !bad.contains(&i) && (Some(i) == worst || is_cure(i)));
    let of_others = least(others.collect());
    Some(of_others.filter(|o| o.0 < (1.0 - settings.floor) * of_bad.0).map_or(of_bad.1, |o| o.1))
}

/// The pick whose loss costs least, if that is less than a pick must be worth, or if what was picked cannot be.
fn superfluous(work: &mut Work, settings: &Settings) -> Option<usize> {
    let cross = work.gram.cross(&work.design, &work.real_targets(&[work.softness]));
    let fitted = fitted(work, &cross, None);
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
            g.scope[0] / before
        };
        let size = crate::worth::size(work, p.candidate, &p.variant, &|id| fitted.coefficient(id));
        if size <= settings.tolerance_of(p.variant.n_own) {
            gain = gain.min(0.0);
        }
        if gain <= settings.floor && worst.is_none_or(|(g, _)| gain < g) {
            worst = Some((gain, i));
        }
    }
    let worst = worst.map(|(_, i)| i);
    in_the_way(work, &cross, &impossible(work, &fitted, None), worst, settings).or(worst)
}
