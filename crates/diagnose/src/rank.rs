//! The order of findings and the held-out error as they are added one by one.

use crate::chain::refine_chain;
use crate::columns::Family;
use crate::design::{Chain, View};
use crate::final_fit::{FinalFit, errors, left_as_given, pooled};
use crate::refine::container;
use crate::screen::Base;
use crate::work::{Pick, Work};

/// One step from the model as given to the final one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Step {
    /// Pick that was added; `None` for the model as given.
    pub(crate) pick: Option<usize>,
    /// The verdict's held-out number after it.
    pub(crate) heldout: f64,
}

/// Adds picks one by one, each time the one that helps most on blocks it was not fitted on; lags and delays compete as they were found.
/// `work` is left as it was.
pub(crate) fn rank(work: &mut Work, band: f64) -> Vec<Step> {
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
