//! What else could explain a finding: each other candidate in its place, on the same blocks.

use pkm_dyn::math;

use crate::chain::refine_chain;
use crate::columns::Family;
use crate::contest::{own_columns, reading};
use crate::design::ColumnId;
use crate::final_fit::student_95;
use crate::gram::Cross;
use crate::prove::drop_pick;
use crate::screen::{self, Base, Fitted};
use crate::search::{is_possible, picked_error};
use crate::settings::{ALIAS_SHARE, LOOK_ALIKE_SHARE, PRIORS, WEAK_ALIAS_SHARE};
use crate::verdict::{EffectAt, LookAlike};
use crate::work::{Candidate, Pick, Variant, Work};

/// Another candidate in a finding's place.
#[derive(Debug, Clone)]
struct Rival {
    effect: &'static str,
    place: Vec<String>,
    beside: Beside,
    /// Physical veto; empty when it reads as possible.
    veto: String,
}

/// What columns do beside those of a finding.
#[derive(Debug, Clone, Copy)]
struct Beside {
    /// Held-out squared error that they take away, as a share of what the finding takes away.
    share: f64,
    /// Whether the finding beats them in the blocks more clearly than chance (paired t-test over blocks, 95 %).
    is_beaten: bool,
    /// Share of the error that they leave which the finding takes away beyond them; none where a prior holds them back.
    lead: f64,
}

impl Beside {
    /// Whether the finding cannot be told from them: they do nearly the same, or the blocks do not say which is better.
    fn is_alias(self, floor: f64) -> bool {
        (self.share >= WEAK_ALIAS_SHARE && !self.is_beaten) || (self.share >= ALIAS_SHARE && self.lead < floor)
    }
}

/// Aliases and rejected look-alikes of the pick at `index`. A lag or delay that was found is in the chain, and its column is an increment about
/// that: it competes with the chain taken out, where what takes its place has all of it to explain. `work` is left as it was.
///
/// `floor` is the share of an error that is worth naming: what leaves that much more than the finding does, and clearly so, is told from it.
pub(crate) fn alternatives(work: &mut Work, index: usize, floor: f64) -> (Vec<EffectAt>, Vec<LookAlike>) {
    let c = &work.candidates[work.picks[index].candidate];
    if c.effect.family() != Family::Chain {
        return alternatives_as_it_stands(work, index, floor);
    }
    let joint = c.scope[0];
    work.with_chain_out(joint, |work| alternatives_as_it_stands(work, index, floor))
}

fn alternatives_as_it_stands(work: &Work, index: usize, floor: f64) -> (Vec<EffectAt>, Vec<LookAlike>) {
    let own_name = name(work, index);
    let mut rivals = rivals(work, &[index], floor);
    let siblings: Vec<usize> = (0..work.picks.len()).filter(|&i| name(work, i) == own_name).collect();
    if own_name == "torque_constant" {
        // A wrong mass shows at several drives at once, so it competes with all wrong scales together.
        rivals.extend(self::rivals(work, &siblings, floor).into_iter().filter(|r| is_mass(r.effect)));
        rivals.extend(whole_body(work, &siblings));
    }
    if is_mass(own_name) {
        // And the other way round: several wrong masses are wrong scales of all drives.
        let masses: Vec<usize> = (0..work.picks.len()).filter(|&i| is_mass(name(work, i))).collect();
        rivals.extend(all_scales(work, &masses));
    }
    rivals.sort_by(|a, b| b.beside.share.total_cmp(&a.beside.share));
    let mut same = Vec::new();
    let mut rejected: Vec<LookAlike> = Vec::new();
    for r in rivals {
        let separating_experiment = experiment(own_name, r.effect);
        let Beside { share, is_beaten, lead } = r.beside;
        tracing::debug!(finding = own_name, rival = r.effect, place = ?r.place, share, is_beaten, lead, veto = r.veto, "in its place");
        if r.beside.is_alias(floor) && r.veto.is_empty() {
            if !same.iter().any(|s: &EffectAt| s.effect == r.effect && s.place == r.place) {
                same.push(EffectAt { effect: r.effect.to_string(), place: r.place, separating_experiment });
            }
        } else if r.effect != own_name && share >= LOOK_ALIKE_SHARE && !rejected.iter().any(|l| l.effect == r.effect) {
            let why_not = if r.veto.is_empty() {
                let (share, lead) = (100.0 * share.max(0.0), 100.0 * lead);
                format!(
                    "in its place it explains {share:.0} % of what {own_name} explains; {own_name} takes away {lead:.0} % of what is left then"
                )
            } else {
                format!("as a fit it would be impossible: {}", r.veto)
            };
            rejected.push(LookAlike { effect: r.effect.to_string(), place: r.place, why_not, separating_experiment });
        }
    }
    // The usual suspects are answered for even where they explain next to nothing.
    for l in work.candidates[work.picks[index].candidate].effect.entry().look_alikes {
        let is_known = pkm_dyn::effects::find(l.effect).is_some();
        let is_said = same.iter().any(|s| s.effect == l.effect) || rejected.iter().any(|r| r.effect == l.effect);
        let tried = work.candidates.iter().position(|c| c.effect_name() == l.effect && is_at(work, c, index));
        let Some(tried) = tried.filter(|c| is_known && !is_said && !work.picks.iter().any(|p| p.candidate == *c)) else { continue };
        let why_not = if is_wider_law(work, tried, work.picks[index].candidate) {
            format!("its law contains {own_name}; what it adds to it does not pay on held-out blocks")
        } else {
            format!("in its place it explains less than {:.0} % of what {own_name} explains", 100.0 * LOOK_ALIKE_SHARE)
        };
        let place = work.candidates[tried].places(&work.robot.model);
        rejected.push(LookAlike { effect: l.effect.to_string(), place, why_not, separating_experiment: l.experiment.to_string() });
    }
    (same, rejected)
}

/// A lag in the place of a delay, and the reverse: picks of the chain that cannot be told from it, by pick. Their columns are increments
/// about the chain as it stands, so the other one is fitted with the chain taken out. `work` is left as it was.
pub(crate) fn chain_rivals(work: &mut Work, band: f64) -> Vec<(usize, EffectAt)> {
    let mut out = Vec::new();
    let (picks, chain) = (work.picks.clone(), work.design.chain.clone());
    for i in 0..picks.len() {
        let own = picks[i].candidate;
        if work.candidates[own].effect.family() != Family::Chain {
            continue;
        }
        let scope = work.candidates[own].scope.clone();
        let with = picked_error(work, &scope);
        drop_pick(work, i, band);
        let without = picked_error(work, &scope);
        let other = (0..work.candidates.len())
            .find(|&c| c != own && work.candidates[c].effect.family() == Family::Chain && work.candidates[c].scope == scope);
        let softness = Some(work.softness);
        let variant = other.and_then(|c| work.candidates[c].variants.iter().find(|v| v.softness == softness).cloned());
        if let (Some(candidate), Some(variant)) = (other, variant) {
            work.picks.push(Pick { candidate, variant, ..picks[i].clone() });
            refine_chain(work, band);
            let share = (without - picked_error(work, &scope)) / (without - with).max(f64::MIN_POSITIVE);
            if share >= ALIAS_SHARE && is_possible(work, work.picks.len() - 1) {
                let (effect, c) = (work.candidates[candidate].effect_name(), &work.candidates[own]);
                let separating_experiment = experiment(c.effect_name(), effect);
                out.push((i, EffectAt { effect: effect.to_string(), place: c.places(&work.robot.model), separating_experiment }));
            }
        }
        work.picks.clone_from(&picks);
        work.design.chain.clone_from(&chain);
        refine_chain(work, band);
    }
    out
}

/// Cables whose pull only rises along the stroke: a spring that hardens or softens does the same, and no curve tells one from the other. By pick,
/// from the parameters of each.
pub(crate) fn rising_cables(work: &Work, readings: &[Vec<(&'static str, f64)>]) -> Vec<(usize, EffectAt)> {
    let is_rising = |(i, p): &(usize, &Pick)| {
        let powers: Vec<f64> = readings[*i].iter().map(|(_, c)| *c).collect();
        rises(&powers, [p.variant.values[0], p.variant.values[1]])
    };
    let cables = work.picks.iter().enumerate().filter(|(_, p)| work.candidates[p.candidate].effect_name() == "cable_force");
    let spring = |i: usize| EffectAt {
        effect: "spring".to_string(),
        place: work.candidates[work.picks[i].candidate].places(&work.robot.model),
        separating_experiment: "take the hoses off, or route them anew, and repeat: a spring that is not straight stays as it is"
            .to_string(),
    };
    cables.filter(is_rising).map(|(i, _)| (i, spring(i))).collect()
}

/// Whether a polynomial, constant first, only rises within `half` of `middle`.
fn rises(powers: &[f64], [middle, half]: [f64; 2]) -> bool {
    const STEPS: u32 = 40;
    // Horner's scheme over n·cₙ.
    let slope = |q: f64| powers.iter().enumerate().skip(1).rev().fold(0.0, |sum, (n, c)| sum * q + n as f64 * c);
    (0..=STEPS).all(|k| slope(middle + half * (2.0 * f64::from(k) / f64::from(STEPS) - 1.0)) > 0.0)
}

/// Whether a candidate sits where the pick does, or acts there at all when it is of another kind of place.
fn is_at(work: &Work, c: &Candidate, pick: usize) -> bool {
    let own = &work.candidates[work.picks[pick].candidate];
    if c.effect.entry().place == own.effect.entry().place { c.is_where(own) } else { own.scope.iter().any(|j| c.scope.contains(j)) }
}

fn name(work: &Work, pick: usize) -> &'static str {
    work.candidates[work.picks[pick].candidate].effect_name()
}

/// The experiment that tells two effects apart, from either one's catalogue entry.
fn experiment(a: &str, b: &str) -> String {
    let from = |x: &str, y: &str| {
        pkm_dyn::effects::find(x).and_then(|e| e.look_alikes.iter().find(|l| l.effect == y)).map(|l| l.experiment.to_string())
    };
    from(a, b).or_else(|| from(b, a)).unwrap_or_else(|| {
        let has_weight = |x: &str| is_mass(x) || x == "gravity_tilt";
        let text = if has_weight(a) || has_weight(b) {
            "record in another posture or with a known extra mass: weight changes with posture, and of the mass it is known"
        } else {
            "repeat the motion about another centre position and at a fifth of the speed"
        };
        text.to_string()
    })
}

/// The model without some picks, and what they take away from its error.
struct Stage {
    cross: Cross,
    base: Base,
    columns: Vec<ColumnId>,
    prior: Vec<f64>,
    taken: f64,
    /// Joints where they act.
    scope: Vec<usize>,
    /// What they take away per block.
    blocks: Vec<f64>,
    /// Columns of the removed picks with inverse prior variances.
    removed: (Vec<ColumnId>, Vec<f64>),
}

fn stage(work: &Work, without: &[usize]) -> Stage {
    let cross = work.gram.cross(&work.design, &work.real_targets(&[work.softness]));
    // What is fitted along stays: beside the robot's files as they are, what a refit conceals explains nothing, and nor would a rival.
    let (columns, prior) = work.picked_but(without);
    let removed = without.iter().flat_map(|&i| work.picks[i].variant.columns.iter().zip(&work.picks[i].variant.prior));
    let own = removed.filter(|(id, _)| !columns.contains(id)).map(|(&id, &sd)| (id, work.inverse_variance(id, sd)));
    let (own, own_prior): (Vec<ColumnId>, Vec<f64>) = own.unzip();
    let base = Base::new(&work.gram, &cross, &columns, &prior);
    let blocks: Vec<f64> = if own.is_empty() {
        vec![0.0; work.design.n_folds]
    } else {
        screen::gains(&work.gram, &cross, &base, &own, &own_prior, &[]).all.iter().map(|f| f[0]).collect()
    };
    let scope = without.iter().flat_map(|&i| work.candidates[work.picks[i].candidate].scope.iter().copied()).collect();
    Stage { cross, base, columns, prior, taken: blocks.iter().sum(), scope, blocks, removed: (own, own_prior) }
}

impl Stage {
    /// Share of what the removed picks take away that other columns make superfluous: what both explain. A rival that takes away as much
    /// of something else is no rival.
    fn in_common(&self, work: &Work, own: &[ColumnId], prior: &[f64], share: f64) -> f64 {
        let (mut ids, mut priors) = (own.to_vec(), prior.to_vec());
        for (id, p) in self.removed.0.iter().zip(&self.removed.1).filter(|(id, _)| !own.contains(id)) {
            ids.push(*id);
            priors.push(*p);
        }
        let both: f64 = screen::gains(&work.gram, &self.cross, &self.base, &ids, &priors, &[]).all.iter().map(|f| f[0]).sum();
        1.0 + share - both / self.taken.max(f64::MIN_POSITIVE)
    }

    /// What the removed picks take away on the rows of some joints.
    fn taken_over(&self, work: &Work, joints: &[usize]) -> f64 {
        let (own, prior) = &self.removed;
        if own.is_empty() { 0.0 } else { screen::gains(&work.gram, &self.cross, &self.base, own, prior, joints).scope[0] }
    }

    /// What other columns with their inverse prior variances, which act at `joints`, do beside the removed picks.
    fn beside(&self, work: &Work, ids: &[ColumnId], prior: &[f64], joints: &[usize]) -> Beside {
        let mut both: Vec<usize> = self.scope.iter().chain(joints).copied().collect();
        both.sort_unstable();
        both.dedup();
        let gains = screen::gains(&work.gram, &self.cross, &self.base, ids, prior, &both);
        let lead: Vec<f64> = self.blocks.iter().zip(&gains.all).map(|(own, other)| own - other[0]).collect();
        let n = lead.len() as f64;
        let mean = lead.iter().sum::<f64>() / n;
        let variance = lead.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>() / (n - 1.0).max(1.0);
        let error = math::sqrt(variance / n);
        let is_beaten = mean > student_95(lead.len().saturating_sub(1)) * error;
        let theirs: f64 = gains.all.iter().map(|f| f[0]).sum();
        // On the rows where either acts: what is fitted along moves with each and takes from other joints' rows, where their error is not counted.
        let left = self.base.over(&both, 0) - gains.scope[0];
        let lead = (self.taken_over(work, &both) - gains.scope[0]) / left.max(f64::MIN_POSITIVE);
        // Held back by what is expected of their numbers, they may stay behind though they are the truth.
        let lead = if prior.iter().any(|p| *p > 0.0) { 0.0 } else { lead };
        Beside { share: theirs / self.taken.max(f64::MIN_POSITIVE), is_beaten, lead }
    }
}

fn rivals(work: &Work, without: &[usize], floor: f64) -> Vec<Rival> {
    let s = stage(work, without);
    if s.taken <= 0.0 {
        return Vec::new();
    }
    let picked: Vec<usize> = work.picks.iter().map(|p| p.candidate).collect();
    let removed: Vec<&Variant> = without.iter().map(|&i| &work.picks[i].variant).collect();
    let is_standard = without.iter().all(|&i| work.candidates[work.picks[i].candidate].effect.family() == Family::Standard);
    let mut out = Vec::new();
    for (c, candidate) in work.candidates.iter().enumerate().filter(|(c, _)| !picked.contains(c)) {
        if without.iter().any(|&i| is_wider_law(work, c, work.picks[i].candidate)) {
            continue;
        }
        let mut trials: Vec<(Beside, &Variant)> = Vec::new();
        for v in candidate.variants.iter().filter(|v| v.softness.is_none_or(|w| w == work.softness)) {
            let (own, prior) = own_columns(work, v, &s.columns);
            // A spring with its constant contains an offset: containing the answer is no other answer.
            let contains = is_standard && removed.iter().any(|r| r.columns.iter().all(|id| own.contains(id)));
            if own.is_empty() || contains {
                continue;
            }
            let mut beside = s.beside(work, &own, &prior, &candidate.scope);
            if beside.share >= LOOK_ALIKE_SHARE {
                beside.share = beside.share.min(s.in_common(work, &own, &prior, beside.share));
            }
            trials.push((beside, v));
        }
        trials.sort_by(|a, b| b.0.share.total_cmp(&a.0.share));
        // The best shape that is possible speaks for the candidate, one that cannot be told before the others; the best of all where none is.
        let rival = |&(beside, v): &(Beside, &Variant)| {
            // A body with something on it is a body, whatever numbers a fit has chosen for what the motion does not show.
            let veto = if is_load_of(work, without, candidate) { String::new() } else { veto(work, &s, c, v) };
            Rival { effect: candidate.effect_name(), place: candidate.places(&work.robot.model), beside, veto }
        };
        let worth: Vec<Rival> = trials.iter().take_while(|t| t.0.share >= LOOK_ALIKE_SHARE).take(MAX_SHAPES).map(rival).collect();
        let mut possible = worth.iter().filter(|r| r.veto.is_empty());
        let best = possible.clone().find(|r| r.beside.is_alias(floor)).or(possible.next()).or(worth.first()).cloned();
        out.extend(best);
    }
    out
}

/// Whether a candidate is the wrong inertia of the link that the one removed pick puts a load on.
fn is_load_of(work: &Work, without: &[usize], candidate: &Candidate) -> bool {
    let [pick] = without else { return false };
    let own = &work.candidates[work.picks[*pick].candidate];
    own.effect_name() == "payload" && candidate.effect_name() == "inertia_error" && candidate.is_where(own)
}

/// Shapes of a rival that are read before it is called impossible.
const MAX_SHAPES: usize = 4;

/// Whether a candidate's law contains another's at the same joint: a friction peak rides on dry friction and is no rival of it.
pub(crate) fn is_wider_law(work: &Work, candidate: usize, other: usize) -> bool {
    let (c, p) = (&work.candidates[candidate], &work.candidates[other]);
    let contained: &[&str] = match c.effect_name() {
        // Drag with the exponent 0 is dry friction, with 1 damping.
        "friction_stribeck" | "friction_asymmetric" | "friction_quadratic" => &["friction_coulomb", "friction_viscous"],
        // A joint that gives by nothing before it slides has dry friction.
        "friction_position" | "friction_presliding" => &["friction_coulomb"],
        "cable_force" => &["spring"],
        _ => &[],
    };
    c.is_where(p) && contained.contains(&p.effect_name())
}

fn veto(work: &Work, s: &Stage, candidate: usize, v: &Variant) -> String {
    let (own, own_prior) = own_columns(work, v, &s.columns);
    let ids: Vec<ColumnId> = s.columns.iter().chain(&own).copied().collect();
    let prior: Vec<f64> = s.prior.iter().chain(&own_prior).copied().collect();
    let fitted = Fitted::new(&work.gram, &s.cross, ids, &prior);
    reading(work, candidate, v, &|id| fitted.coefficient(id)).err().unwrap_or_default()
}

/// Wrong masses of all links together, each within half its size.
fn whole_body(work: &Work, without: &[usize]) -> Option<Rival> {
    let s = stage(work, without);
    let (ids, prior) = work.with_rigid(Vec::new(), PRIORS[PRIORS.len() - 1]);
    let everywhere: Vec<usize> = (0..work.design.n_joints).collect();
    let beside = s.beside(work, &ids, &prior, &everywhere);
    let model = &work.robot.model;
    let place = model.massive_links().into_iter().map(|l| model.links[l].name.clone()).collect();
    Some(Rival { effect: "inertia_error", place, beside, veto: String::new() })
}

/// Wrong scales of all drives together that are not picked.
fn all_scales(work: &Work, without: &[usize]) -> Option<Rival> {
    let s = stage(work, without);
    let is_picked = |c: usize| work.picks.iter().any(|p| p.candidate == c);
    let is_scale = |c: &usize| work.candidates[*c].effect_name() == "torque_constant" && !is_picked(*c);
    let (mut ids, mut prior, mut place, mut joints) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for candidate in (0..work.candidates.len()).filter(is_scale).map(|c| &work.candidates[c]) {
        let Some(v) = candidate.variants.iter().find(|v| v.softness.is_none_or(|w| w == work.softness)) else { continue };
        let (own, own_prior) = own_columns(work, v, &s.columns);
        ids.extend(own);
        prior.extend(own_prior);
        place.extend(candidate.places(&work.robot.model));
        joints.extend(&candidate.scope);
    }
    if ids.is_empty() || s.taken <= 0.0 {
        return None;
    }
    let mut beside = s.beside(work, &ids, &prior, &joints);
    beside.share = beside.share.min(s.in_common(work, &ids, &prior, beside.share));
    Some(Rival { effect: "torque_constant", place, beside, veto: String::new() })
}

/// Effects that are weight and inertia.
fn is_mass(effect: &str) -> bool {
    matches!(effect, "payload" | "inertia_error")
}

#[cfg(test)]
mod tests {
    use pkm_dyn::effects::Robot;

    use super::*;
    use crate::design::Design;
    use crate::testing::Bench;

    #[test]
    fn what_a_finding_takes_beyond_a_rival_is_a_share_of_what_the_rival_leaves_where_they_act() {
        let Bench { model, mut motion } = Bench::pair();
        for (k, tau) in motion.segment.tau.iter_mut().enumerate() {
            tau.iter_mut().enumerate().for_each(|(i, y)| *y = 2.0 * math::sin(1e-7 * ((k + 2) * i * i) as f64));
        }
        let robot = Robot { model, effects: Vec::new() };
        let mut motions = vec![motion];
        let design = Design::new(&robot, &motions, 5.0);
        let mut work = Work::new(&robot, &mut motions, design, 5.0, None);
        // A mass is felt by both drives: it moves with whatever is fitted at one of them, and so does what is left at the other.
        for (effect, name) in [("payload", "link1"), ("rotor_inertia", "j0")] {
            let is_it = |c: &Candidate| c.effect_name() == effect && c.name == name;
            let candidate = work.candidates.iter().position(is_it).expect("it is looked for");
            let variant = work.candidates[candidate].variants[0].clone();
            work.picks.push(Pick { candidate, variant, p_search: 0.0, p_confirm: 0.0, wins: 0 });
        }
        let s = stage(&work, &[1]);
        let left_by = |own: &[ColumnId], prior: &[f64], joints: &[usize]| {
            let (ids, priors) = ([&s.columns[..], own].concat(), [&s.prior[..], prior].concat());
            Base::new(&work.gram, &s.cross, &ids, &priors).over(joints, 0)
        };
        let mut spilt = 0;
        for (c, rival) in work.candidates.iter().enumerate().filter(|(c, _)| *c != work.picks[1].candidate) {
            let Some(variant) = rival.variants.first() else { continue };
            let (own, prior) = own_columns(&work, variant, &s.columns);
            if own.len() != 1 || prior[0] > 0.0 || is_wider_law(&work, c, work.picks[1].candidate) {
                continue;
            }
            let mut both = [&s.scope[..], &rival.scope].concat();
            both.sort_unstable();
            both.dedup();
            let beside = s.beside(&work, &own, &prior, &rival.scope);
            let theirs = left_by(&own, &prior, &both);
            let expected = 1.0 - left_by(&s.removed.0, &s.removed.1, &both) / theirs;
            assert!((beside.lead - expected).abs() < 1e-6, "{} at {}: {} and not {expected}", rival.effect_name(), rival.name, beside.lead);
            spilt += usize::from((s.taken - s.taken_over(&work, &both)).abs() > 0.01 * s.taken);
        }
        assert!(spilt > 3, "{spilt} rivals are compared where the rows matter");
    }

    #[test]
    fn a_spring_that_hardens_only_rises_and_a_parabola_does_not() {
        // 3 q + 5 q³ about 0.2, and a parabola whose bottom lies at 0.1.
        assert!(rises(&[0.4, 3.0, 0.0, 5.0], [0.2, 0.5]));
        let parabola = [0.01, -0.2, 1.0];
        assert!(!rises(&parabola, [0.2, 0.15]) && rises(&parabola, [0.2, 0.09]));
        assert!(!rises(&[1.0, -3.0], [0.0, 1.0]) && !rises(&[1.0], [0.0, 1.0]));
    }
}
