//! The order of findings and the held-out error as they are added one by one.

use crate::chain::refine_chain;
use crate::columns::Family;
use crate::design::View;
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

/// Adds picks one by one, each time the one that helps most on blocks it was not fitted on; lags and delays, which move a finished
/// model in time, come last. `work` is left as it was.
pub(crate) fn rank(work: &mut Work, band: f64) -> Vec<Step> {
    let picks = work.picks.clone();
    let chain = work.design.chain.clone();
    let mut steps = vec![Step { pick: None, heldout: pooled(&errors(work, &left_as_given(work, &[], View::Judge))) }];
    work.design.chain = work.design.given_chain.clone();
    work.rebuild();
    let is_chain = |work: &Work, p: &Pick| work.candidates[p.candidate].effect.family() == Family::Chain;
    let mut open: Vec<usize> = (0..picks.len()).filter(|&i| !is_chain(work, &picks[i]) && container(work, i).is_none()).collect();
    // What a law contains is added with it.
    let with =
        |work: &Work, lead: usize| -> Vec<usize> { (0..picks.len()).filter(|&i| i == lead || container(work, i) == Some(lead)).collect() };
    let groups: Vec<Vec<usize>> = (0..picks.len()).map(|i| with(work, i)).collect();
    let mut taken: Vec<usize> = Vec::new();
    while !open.is_empty() {
        let error = |work: &mut Work, next: usize| {
            work.picks = taken.iter().chain(&groups[next]).map(|&i| picks[i].clone()).collect();
            let cross = work.gram.cross(&work.design, &work.real_targets(&[work.softness]));
            let (columns, prior) = work.picked(None);
            Base::new(&work.gram, &cross, &columns, &prior).total(0)
        };
        let errors: Vec<f64> = open.iter().map(|&i| error(work, i)).collect();
        let best = (0..open.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b])).unwrap_or(0);
        let lead = open.remove(best);
        taken.extend(&groups[lead]);
        work.picks = taken.iter().map(|&i| picks[i].clone()).collect();
        steps.push(Step { pick: Some(lead), heldout: held_out(work) });
    }
    let last: Vec<usize> = (0..picks.len()).filter(|&i| is_chain(work, &picks[i])).collect();
    for i in last {
        taken.push(i);
        work.picks = taken.iter().map(|&i| picks[i].clone()).collect();
        let joint = work.candidates[picks[i].candidate].scope[0];
        work.design.chain[joint] = chain[joint];
        refine_chain(work, band);
        let now = work.picks.clone();
        steps.push(Step { pick: Some(i), heldout: held_out(work) });
        work.picks = now;
    }
    work.picks = picks;
    work.design.chain = chain;
    work.set_softness(work.softness);
    refine_chain(work, band);
    work.rebuild();
    steps
}

fn held_out(work: &Work) -> f64 {
    let (ids, prior) = work.picked(None);
    let fit = FinalFit::new(work, ids, &prior);
    pooled(&errors(work, &work.residual(&fit.ids, &fit.theta, work.softness, View::Judge)))
}
