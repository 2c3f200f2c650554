//! The confirm set, read once: every pick must help on held-out data more than chance would.

use crate::columns::Family;
use crate::contest::{own_columns, surrogates};
use crate::design::View;
use crate::screen::{self, Base};
use crate::search::drop_pick;
use crate::settings::Settings;
use crate::work::Work;

/// Drops, worst first, picks that do not help on held-out rows; the others keep their p-value.
pub(crate) fn confirm(work: &mut Work, band: f64, settings: &Settings) {
    while let Some(worst) = weakest(work, settings) {
        drop_pick(work, worst, band);
    }
}

/// Tests every pick; the one with the largest p-value above the level, if any.
fn weakest(work: &mut Work, settings: &Settings) -> Option<usize> {
    let (ids, prior) = work.picked(None);
    let real = work.real_targets(&[work.softness]);
    let cross = work.gram.cross(&work.design, &real);
    let theta = screen::fit(&work.gram, &cross, &ids, &prior, crate::solve::Over::All);
    let left = work.residual(&ids, &theta, work.softness, View::Fit);
    let mut targets = real;
    targets.extend(surrogates(work, &left, settings));
    let cross = work.gram.cross(&work.design, &targets);
    let mut worst: Option<(f64, usize)> = None;
    for i in 0..work.picks.len() {
        let p = &work.picks[i];
        let scope = work.candidates[p.candidate].scope.clone();
        // The increment of a lag or delay is nothing by itself: it is put back to its whole size.
        let whole = work.candidates[p.candidate].effect.family() == Family::Chain;
        let (columns, prior) = work.picked(Some(i));
        let base = Base::held_out(&work.gram, &cross, &columns, &prior);
        let (own, own_prior) = own_columns(work, &p.variant, &columns);
        if own.is_empty() {
            continue;
        }
        let g = screen::gains(&work.gram, &cross, &base, &own, &own_prior, &scope);
        let gain = |t: usize| g.scope[0][t] / base.over(&scope, t).max(f64::MIN_POSITIVE);
        let own_gain = if whole { crate::search::chain_held_out_gain(work, i) } else { gain(0) };
        let reached = (1..=settings.null_runs).filter(|&t| gain(t) >= own_gain).count();
        let p_value = (1 + reached) as f64 / (1 + settings.null_runs) as f64;
        work.picks[i].p_confirm = p_value;
        let fails = p_value > settings.confirm_level || own_gain <= 0.0;
        if fails && worst.is_none_or(|(w, _)| p_value > w) {
            worst = Some((p_value, i));
        }
    }
    worst.map(|(_, i)| i)
}
