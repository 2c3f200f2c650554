//! The order of findings and the held-out error as they are added one by one.

use crate::chain::refine_chain;
use crate::columns::Family;
use crate::confirm::is_in_fitted_only;
use crate::design::{Chain, View};
use crate::final_fit::{FinalFit, errors, errors_in_motion, left_as_given, pooled};
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
    /// The same where the joints move.
    pub(crate) moving: f64,
}

/// The order of the picks in `work`, less those that make the robot worse: where held-out error ends above its least by more than what is worth a name,
/// what was added after the least is taken out. Each of them helped beside the others; together they do not. It must be so of all rows and of
/// those where joints move: what holds a joint that stands is not known, and where that is most of the error it would speak against whatever is
/// true.
pub(crate) fn rank_what_helps(work: &mut Work, band: f64, settings: &Settings) -> Vec<Step> {
    let rank = |work: &mut Work| {
        let steps = rank(work, &vec![Claim { sure: 1.0, is_shadow: false }; work.picks.len()]);
        refine_chain(work, band);
        steps
    };
    let steps = rank(work);
    let help = [|s: &Step| s.heldout, |s: &Step| s.moving].map(|of| helping(&steps.iter().map(of).collect::<Vec<_>>(), settings.floor));
    let harmful: Vec<usize> = steps[help[0].max(help[1])..].iter().filter_map(|s| s.pick).collect();
    let is_after = |i: usize| harmful.contains(&i) || container(work, i).is_some_and(|lead| harmful.contains(&lead));
    // A push that did not come back is nothing that held-out rows could tell of.
    let is_harmful = |i: usize| is_after(i) && !is_in_fitted_only(work, &work.picks[i]);
    let gone: Vec<usize> = (0..work.picks.len()).rev().filter(|&i| is_harmful(i)).collect();
    if gone.is_empty() {
        return steps;
    }
    gone.into_iter().for_each(|i| drop_pick(work, i, band));
    rank(work)
}

/// How many of these steps help: all, or those up to the least error where the last is worse by a share of `floor` of the squared error.
fn helping(heldout: &[f64], floor: f64) -> usize {
    let best = (0..heldout.len()).min_by(|&a, &b| heldout[a].total_cmp(&heldout[b])).unwrap_or(0);
    let (least, last) = (heldout.get(best).copied().unwrap_or(0.0), heldout.last().copied().unwrap_or(0.0));
    if last * last > (1.0 + floor) * least * least { best + 1 } else { heldout.len() }
}

/// What a pick has to say for itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Claim {
    pub(crate) sure: f64,
    /// Whether it may be the shadow of another pick: it goes after all that are not.
    pub(crate) is_shadow: bool,
}

impl Claim {
    /// Claims of all picks, by how `sure` they are. A robot whose masses, frictions and offsets were fitted to recordings with a law that it lacks has
    /// wrong ones, and they move back beside the law: what such a fit can change is named after what it cannot.
    pub(crate) fn of_picks(work: &Work, sure: &[f64]) -> Vec<Self> {
        let claim = |(p, &sure): (&Pick, &f64)| Self { sure, is_shadow: work.candidates[p.candidate].effect.is_refittable() };
        work.picks.iter().zip(sure).map(claim).collect()
    }
}

/// Adds picks one by one, each time the one that may be expected to help most on blocks it was not fitted on: what it takes away there times how
/// sure it is; shadows come last. Lags and delays compete as they were found. `work` is left as it was.
pub(crate) fn rank(work: &mut Work, claims: &[Claim]) -> Vec<Step> {
    let picks = work.picks.clone();
    let chain = work.design.chain.clone();
    let mut steps = vec![step(work, None, |view| left_as_given(work, &[], view))];
    set_chain(work, work.design.given_chain.clone());
    let mut open: Vec<usize> = (0..picks.len()).filter(|&i| container(work, i).is_none()).collect();
    // What a law contains is added with it.
    let with =
        |work: &Work, lead: usize| -> Vec<usize> { (0..picks.len()).filter(|&i| i == lead || container(work, i) == Some(lead)).collect() };
    let groups: Vec<Vec<usize>> = (0..picks.len()).map(|i| with(work, i)).collect();
    let mut taken: Vec<usize> = Vec::new();
    let trial = |work: &mut Work, some: &[usize]| error_with(work, &picks, (&chain, some));
    let mut now = trial(work, &taken);
    while !open.is_empty() {
        let errors: Vec<f64> = open.iter().map(|&i| trial(work, &[&taken[..], &groups[i][..]].concat())).collect();
        let help: Vec<(bool, f64)> =
            open.iter().zip(&errors).map(|(&i, error)| (claims[i].is_shadow, expected(now - error, claims[i].sure))).collect();
        let at = next(&help);
        now = errors[at];
        let lead = open.remove(at);
        taken.extend(&groups[lead]);
        put(work, &picks, (&chain, &taken));
        let (ids, prior) = work.picked(None);
        let fit = FinalFit::new(work, ids, &prior);
        steps.push(step(work, Some(lead), |view| work.residual(&fit.ids, &fit.theta, work.softness, view)));
    }
    work.picks = picks;
    set_chain(work, chain);
    work.set_softness(work.softness);
    steps
}

/// The one that helps most of those that are no shadow, of shadows where there is nothing else; the first of those that help alike.
fn next(help: &[(bool, f64)]) -> usize {
    let better = |a: &(bool, f64), b: &(bool, f64)| b.0.cmp(&a.0).then(a.1.total_cmp(&b.1));
    (0..help.len()).rev().max_by(|&a, &b| better(&help[a], &help[b])).unwrap_or(0)
}

/// What may be expected of a pick that takes away `taken` of the squared error: nobody loses less by doubting what makes it worse.
fn expected(taken: f64, sure: f64) -> f64 {
    if taken > 0.0 { sure * taken } else { taken }
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
    set_chain(work, now);
}

/// Puts lags and delays in place; sums of products are made anew only where one changed.
fn set_chain(work: &mut Work, chain: Vec<Chain>) {
    if chain != work.design.chain {
        work.design.chain = chain;
        work.rebuild();
    }
}

/// A step after which a view of the rows leaves `left`.
fn step(work: &Work, pick: Option<usize>, left: impl Fn(View) -> Vec<Vec<Vec<f64>>>) -> Step {
    let (heldout, moving) = (errors(work, &left(View::Judge)), errors_in_motion(work, &left(View::Fit)));
    Step { pick, heldout: pooled(&heldout), moving: pooled(&moving) }
}

#[cfg(test)]
mod tests {
    use super::{expected, helping, next};

    #[test]
    fn a_shadow_comes_after_what_may_cast_it_however_much_it_helps() {
        assert_eq!(next(&[(true, 9.0), (false, 1.0), (false, 2.0)]), 2);
        assert_eq!(next(&[(true, 9.0), (false, -1.0)]), 1);
        assert_eq!(next(&[(true, 1.0), (true, 3.0), (true, 3.0)]), 1);
    }

    #[test]
    fn doubt_makes_less_of_help_and_nothing_of_harm() {
        // A mass that takes away 3 and is one of six things, dry friction that takes away 1 and is nothing else; both make it worse.
        assert!(expected(3.0, 1.0 / 6.0) < expected(1.0, 0.9));
        assert!(expected(-3.0, 0.1) < expected(-1.0, 0.9) && expected(-1.0, 0.9) < expected(0.001, 0.01));
    }

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
