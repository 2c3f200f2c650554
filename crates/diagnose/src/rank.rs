//! The order of findings and the held-out error as they are added one by one.

use crate::chain::refine_chain;
use crate::columns::Family;
use crate::confirm::is_in_fitted_only;
use crate::design::{Chain, View};
use crate::final_fit::{FinalFit, errors, left_as_given, pooled};
use crate::prove::drop_pick;
use crate::refine::container;
use crate::screen::Base;
use crate::settings::Settings;
use crate::work::{Pick, Work};

/// One step from the model as given to the final one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Step {
    /// Pick that was added; `None` for the model as given.
    pub(crate) pick: Option<usize>,
    /// The verdict's held-out number after it.
    pub(crate) heldout: f64,
}

/// The order of the picks in `work`, less those that make the robot worse at what the verdict promises: where held-out error ends above its least by
/// more than what is worth a name, what was added after the least is taken out. Each of them helped where its joints move; together they do not.
pub(crate) fn rank_what_helps(work: &mut Work, band: f64, settings: &Settings) -> Vec<Step> {
    let steps = rank(work, band);
    let heldout: Vec<f64> = steps.iter().map(|s| s.heldout).collect();
    let harmful: Vec<usize> = steps[helping(&heldout, settings.floor)..].iter().filter_map(|s| s.pick).collect();
    let is_after = |i: usize| harmful.contains(&i) || container(work, i).is_some_and(|lead| harmful.contains(&lead));
    // A push that did not come back is nothing that held-out rows could tell of.
    let is_harmful = |i: usize| is_after(i) && !is_in_fitted_only(work, &work.picks[i]);
    let gone: Vec<usize> = (0..work.picks.len()).rev().filter(|&i| is_harmful(i)).collect();
    if gone.is_empty() {
        return steps;
    }
    gone.into_iter().for_each(|i| drop_pick(work, i, band));
    rank(work, band)
}

/// How many of these steps help: all, or those up to the least error where the last is worse by a share of `floor` of the squared error.
fn helping(heldout: &[f64], floor: f64) -> usize {
    let best = (0..heldout.len()).min_by(|&a, &b| heldout[a].total_cmp(&heldout[b])).unwrap_or(0);
    let (least, last) = (heldout.get(best).copied().unwrap_or(0.0), heldout.last().copied().unwrap_or(0.0));
    if last * last > (1.0 + floor) * least * least { best + 1 } else { heldout.len() }
}

/// Adds picks one by one, each time the one that helps most on blocks it was not fitted on; lags and delays compete as they were found.
/// `work` is left as it was.
fn rank(work: &mut Work, band: f64) -> Vec<Step> {
    let picks = work.picks.clone();
    let chain = work.design.chain.clone();
    let mut steps = vec![Step { pick: None, heldout: pooled(&errors(work, &left_as_given(work, &[], View::Judge))) }];
    work.design.chain = work.design.given_chain.clone();
    work.rebuild();
    let mut open: Vec<usize> = (0..picks.len()).filter(|&i| container(work, i).is_none()).collect();
    // What a law contains is added with it.
    let with =
        |work: &Work, lead: usize| -> Vec<usize> { (0..picks.len()).filter(|&i| i == lead || container(work, i) == Some(lead)).collect() };
    let groups: Vec<Vec<usize>> = (0..picks.len()).map(|i| with(work, i)).collect();
    let mut taken: Vec<usize> = Vec::new();
    while !open.is_empty() {
        let mut trial = |next: usize| error_with(work, &picks, (&chain, &[&taken[..], &groups[next][..]].concat()));
        let errors: Vec<f64> = open.iter().map(|&i| trial(i)).collect();
        let at = (0..open.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b])).unwrap_or(0);
        let lead = open.remove(at);
        taken.extend(&groups[lead]);
        put(work, &picks, (&chain, &taken));
        steps.push(Step { pick: Some(lead), heldout: held_out(work) });
    }
    work.picks = picks;
    work.design.chain = chain;
    work.set_softness(work.softness);
    refine_chain(work, band);
    work.rebuild();
    steps
}

/// Squared error of some of the picks on blocks they are not fitted on.
fn error_with(work: &mut Work, picks: &[Pick], (chain, some): (&[Chain], &[usize])) -> f64 {
    put(work, picks, (chain, some));
    let cross = work.gram.cross(&work.design, &work.real_targets(&[work.softness]));
    let (columns, prior) = work.picked(None);
    Base::new(&work.gram, &cross, &columns, &prior).total(0)
}

/// Puts some of the picks in place, with the chains among them as they were found.
fn put(work: &mut Work, picks: &[Pick], (chain, some): (&[Chain], &[usize])) {
    work.picks = some.iter().map(|&i| picks[i].clone()).collect();
    let mut now = work.design.given_chain.clone();
    for p in &work.picks {
        let c = &work.candidates[p.candidate];
        if c.effect.family() == Family::Chain {
            now[c.scope[0]] = chain[c.scope[0]];
        }
    }
    if now != work.design.chain {
        work.design.chain = now;
        work.rebuild();
    }
}

fn held_out(work: &Work) -> f64 {
    let (ids, prior) = work.picked(None);
    let fit = FinalFit::new(work, ids, &prior);
    pooled(&errors(work, &work.residual(&fit.ids, &fit.theta, work.softness, View::Judge)))
}

#[cfg(test)]
mod tests {
    use super::helping;

    #[test]
    fn what_is_added_after_the_least_error_helps_only_where_the_end_is_as_good() {
        assert_eq!(helping(&[0.33, 0.0093, 0.0127], 0.03), 2);
        assert_eq!(helping(&[0.105, 0.106, 0.109], 0.03), 1);
        // Worse on the way, and best at the end; worse by less than anyone would name.
        assert_eq!(helping(&[0.31, 0.13, 0.15, 0.11], 0.03), 4);
        assert_eq!(helping(&[0.034, 0.0306, 0.0310], 0.03), 3);
        assert_eq!(helping(&[0.1], 0.03), 1);
    }
}
