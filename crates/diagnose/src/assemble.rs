//! From picks to the verdict: final numbers, ranks, words, pictures, the refined robot.

use alloc::collections::BTreeMap;

use pkm_dyn::Model;

use crate::alternatives::{alternatives, chain_rivals, rising_cables};
use crate::columns::Family;
use crate::commands;
use crate::confirm::p_value;
use crate::contest::reading;
use crate::controller::Replayed;
use crate::design::View;
use crate::detectable::{detectable, left_power};
use crate::evidence::{ChainStep, Diagnosis, Evidence, Screened};
use crate::explain;
use crate::final_fit::{FinalFit, errors, jackknife_half_width, left_as_given, noise_floor, pooled};
use crate::isolability::isolability;
use crate::leftover::{Views, unexplained};
use crate::rank::{Claim, Step, rank, rank_what_helps};
use crate::refine::{Parameters, container, refine, stays_beside};
use crate::regimes;
use crate::repeatable::look_for_a_person;
use crate::search::Search;
use crate::settings::{PRIORS, Settings};
use crate::variety::different_motions;
use crate::verdict::{EffectAt, Estimate, Finding, Heldout, HeldoutJoint, InternalEffort, LookAlike, PriorGains, SCHEMA, Status, Verdict};
use crate::work::Work;
use crate::{experiments, gate, picture, priors, sharing};

type Left = Vec<Vec<Vec<f64>>>;

/// So many candidates that are no finding are told of in a verdict.
const TOLD: usize = 40;

/// Everything about the final model that findings are written from.
struct Final {
    fit: FinalFit,
    left: Left,
    /// Contribution of each pick: [pick][joint][segment][row].
    parts: Vec<Left>,
    readings: Vec<Parameters>,
    estimates: Vec<BTreeMap<String, Estimate>>,
    /// Lags that could be delays and delays that could be lags, cables that could be springs, by pick.
    other: Vec<(usize, EffectAt)>,
    /// Different motions recorded.
    motions: usize,
}

/// Writes the verdict on the picks in `work`.
pub(crate) fn assemble(
    work: &mut Work,
    found: &Search,
    (bare, mismatches): (&Model, &[Replayed]),
    band: f64,
    settings: &Settings,
) -> Diagnosis {
    let nominal = left_as_given(work, &work.missing, View::Judge);
    let by_help = rank_what_helps(work, band, settings);
    let late = chain_rivals(work, band);
    let mut fin = finish(work);
    fin.other = late;
    fin.other.extend(rising_cables(work, &fin.readings));
    let judged = judge(work, &fin, &by_help, settings);
    let of = |pick: usize| judged.iter().find(|j| j.pick == pick);
    let sure: Vec<f64> = (0..work.picks.len()).map(|p| of(p).map_or(1.0, |j| j.sure)).collect();
    let mut steps = rank(work, &Claim::of_picks(work, &sure));
    let order: Vec<&Judged> = steps.iter().filter_map(|s| of(s.pick?)).collect();
    // The chain was iterated since: the last step is the final model itself.
    if let Some(last) = steps.last_mut().filter(|s| s.pick.is_some()) {
        last.heldout = pooled(&errors(work, &fin.left));
    }
    let mut findings = commands::findings(work, mismatches, settings);
    let first = findings.len();
    findings.extend(order.iter().enumerate().map(|(r, judged)| finding(work, &fin, &steps, (r, judged), settings)));
    findings.iter_mut().enumerate().skip(first).for_each(|(r, f)| f.rank = r + 1);
    experiments::propose(work, &mut findings[first..], band);
    let mut refined = refine(work, bare, &fin.readings, &|id| fin.fit.coefficient(id));
    commands::refine(&mut refined, work, mismatches);
    let heldout = heldout(work, &nominal, &fin.left, band);
    let moving = work.residual(&fin.fit.ids, &fin.fit.theta, work.softness, View::Fit);
    let given = left_as_given(work, &work.missing, View::Fit);
    let leftover = unexplained(work, &Views { nominal: &nominal, left: &fin.left, given: &given, moving: &moving }, &found.last, settings);
    let mut evidence = evidence(work, &fin, (&nominal, &steps, found), settings);
    (evidence.dependences, evidence.lines) = (leftover.curves, leftover.lines);
    let unexplained = leftover.verdict;
    let (minimum_detectable, invisible) = detectable(work, &left_power(work, &moving), settings);
    let nothing_missing = findings.is_empty() && !unexplained.present;
    let strain = sharing::evidence(work);
    let mut verdict = Verdict {
        schema: SCHEMA.to_string(),
        status: Status::Ok,
        robot: work.robot.model.name.clone(),
        recordings: (0..work.motions.len()).map(|s| gate::recording_use(&work.motions[s], picture::heldout_spans(work, s))).collect(),
        nothing_missing,
        says: summary(&findings, &unexplained.says, &heldout),
        heldout,
        findings,
        unexplained,
        minimum_detectable,
        invisible,
        ruled_out: evidence.ruled_out.iter().filter(|s| s.gain.is_finite() && s.surprise.is_finite()).take(TOLD).cloned().collect(),
        isolability: isolability(work),
        notes: settings.note_of_without().into_iter().chain(notes(work, fin.motions, strain.as_ref())).collect(),
        internal_effort: strain,
        replay: Vec::new(),
        refined_model: String::new(),
    };
    look_for_a_person(work, &moving, (&mut verdict, &mut evidence, &mut refined), settings);
    Diagnosis { verdict, evidence, refined: Some(refined) }
}

fn finish(work: &Work) -> Final {
    let (ids, prior) = work.picked(None);
    let fit = FinalFit::new(work, ids, &prior);
    let left = work.residual(&fit.ids, &fit.theta, work.softness, View::Judge);
    let parts = (0..work.picks.len()).map(|p| whole_contribution(work, &fit, p)).collect();
    let mut readings = Vec::new();
    let mut estimates = Vec::new();
    for (i, p) in work.picks.iter().enumerate() {
        let values = reading(work, p.candidate, &p.variant, &|id| fit.coefficient(id)).unwrap_or_default();
        let replicates: Vec<Parameters> = (0..work.design.n_folds)
            .map(|f| reading(work, p.candidate, &p.variant, &|id| fit.replicate(f, id)).unwrap_or_default())
            .collect();
        let entry = work.candidates[p.candidate].effect.entry();
        let mut map = BTreeMap::new();
        for &(name, value) in &values {
            let spread: Vec<f64> = replicates.iter().filter_map(|r| r.iter().find(|(n, _)| *n == name).map(|(_, v)| *v)).collect();
            let half = jackknife_half_width(&spread);
            // Too few blocks for an interval: all that can be said is the order of magnitude.
            let half = if half.is_finite() { half } else { value.abs() };
            let unit = explain::unit(work, i, name);
            let tried = match (entry.name, name) {
                (_, name) if TRIED.contains(&name) => tried_interval(work, i, value),
                // One of two spots was tried, not fitted: halfway to the link's origin, and as far beyond.
                ("limb_impedance", "x" | "y" | "z") => Some([value - 0.5 * value.abs(), value + 0.5 * value.abs()]),
                // What was tried is how far the joint gives: its level over its stiffness.
                ("friction_presliding", "stiffness") => {
                    let level = p.variant.values[0] * value;
                    let tried = tried_interval(work, i, p.variant.values[0]);
                    // Below the smallest that was tried the stiffness is open: as far above as the interval of the level is wide.
                    tried.map(|[least, most]| [level / most, level / least.max(0.5 * p.variant.values[0])])
                }
                _ => None,
            };
            let ci95 = tried.unwrap_or([value - half, value + half]);
            map.insert(name.to_string(), Estimate { value, ci95, unit });
        }
        readings.push(values);
        estimates.push(map);
    }
    Final { fit, left, parts, readings, estimates, other: Vec::new(), motions: different_motions(work.motions) }
}

/// Parameters that are chosen from a list of shapes.
const TRIED: [&str; 7] = ["stribeck_velocity", "order", "exponent", "position", "limit", "start", "end"];

/// Interval of a value that was chosen from a list and not fitted: halfway to the neighbours that were tried and did worse.
fn tried_interval(work: &Work, pick: usize, value: f64) -> Option<[f64; 2]> {
    let p = &work.picks[pick];
    let at = p.variant.values.iter().position(|v| (v - value).abs() <= f64::EPSILON * value.abs())?;
    let others = work.candidates[p.candidate].variants.iter().filter(|v| v.softness == p.variant.softness).map(|v| v.values[at]);
    let (mut below, mut above) = (None::<f64>, None::<f64>);
    for v in others {
        if v < value {
            below = Some(below.map_or(v, |b| b.max(v)));
        } else if v > value {
            above = Some(above.map_or(v, |a| a.min(v)));
        }
    }
    let half = |v: Option<f64>, open: f64| v.map_or(open, |v| 0.5 * (v + value));
    Some([half(below, 0.0), half(above, 2.0 * value)])
}

/// What a finding adds to the model, with what its law contains.
fn whole_contribution(work: &Work, fit: &FinalFit, pick: usize) -> Left {
    let mut out = contribution(work, fit, pick);
    for i in (0..work.picks.len()).filter(|&i| container(work, i) == Some(pick)) {
        for (sum, part) in out.iter_mut().flatten().zip(contribution(work, fit, i).iter().flatten()) {
            sum.iter_mut().zip(part).for_each(|(s, p)| *s += p);
        }
    }
    out
}

/// What a pick adds to the model: [joint][segment][row]. A lag or delay adds its whole size times its column.
fn contribution(work: &Work, fit: &FinalFit, pick: usize) -> Left {
    let d = &work.design;
    let mut out: Left = (0..d.n_joints).map(|_| d.rows.iter().map(|r| vec![0.0; r.time.len()]).collect()).collect();
    let p = &work.picks[pick];
    let c = &work.candidates[p.candidate];
    for &id in &p.variant.columns {
        let mut size = fit.coefficient(id);
        if c.effect.family() == Family::Chain {
            let (chain, given) = (d.chain[c.scope[0]], d.given_chain[c.scope[0]]);
            size += if c.effect_name() == "actuator_lag" { chain.lag - given.lag } else { chain.delay - given.delay };
        }
        for j in d.joints_of(id) {
            for (s, out) in out[j].iter_mut().enumerate() {
                if let Some(x) = d.values(id, j, s, View::Judge) {
                    out.iter_mut().zip(x).for_each(|(o, x)| *o += size * x);
                }
            }
        }
    }
    out
}

/// How sure a pick is, and why it may be another.
struct Judged {
    pick: usize,
    p_value: f64,
    /// What it cannot be told from.
    same: Vec<EffectAt>,
    look_alikes: Vec<LookAlike>,
    gains: PriorGains,
    /// Its confidence.
    sure: f64,
}

/// Judges every pick that is a finding of its own; `steps` are the order in which they help most.
fn judge(work: &mut Work, fin: &Final, steps: &[Step], settings: &Settings) -> Vec<Judged> {
    let judge = |at: &[Step]| {
        let [before, Step { pick: Some(pick), heldout: after, .. }] = at else { return None };
        let pick = *pick;
        let (mut same, mut look_alikes) = alternatives(work, pick, settings.floor);
        let is_said = |a: &EffectAt| same.iter().any(|s| s.effect == a.effect && s.place == a.place);
        let more: Vec<EffectAt> = fin.other.iter().filter(|(p, a)| *p == pick && !is_said(a)).map(|(_, a)| a.clone()).collect();
        same.extend(more);
        look_alikes.retain(|l| !same.iter().any(|s| s.effect == l.effect && s.place == l.place));
        let gains = priors::gains(work, pick, settings);
        let left = after / before.heldout.max(f64::MIN_POSITIVE);
        let p = &work.picks[pick];
        let p_value = p_value(p.p_search, p.p_confirm, settings);
        let likeness = priors::likeness(work, pick, &gains, (1.0 - left * left, settings.floor));
        let sure = confidence(work, p.wins, p_value, fin.motions) / (1 + same.len()) as f64 * likeness;
        Some(Judged { pick, p_value, same, look_alikes, gains, sure })
    };
    steps.windows(2).filter_map(judge).collect()
}

fn finding(work: &Work, fin: &Final, steps: &[Step], (r, judged): (usize, &Judged), settings: &Settings) -> Finding {
    let &Judged { pick, p_value, ref same, ref look_alikes, gains, sure } = judged;
    let c = &work.candidates[work.picks[pick].candidate];
    let (regime, when) = regimes::of_pick(work, pick, &fin.parts[pick], &fin.left);
    let parameters = fin.estimates[pick].clone();
    let [before, after] = [&steps[r], &steps[r + 1]];
    Finding {
        rank: r + 1,
        effect: c.effect_name().to_string(),
        place: c.places(&work.robot.model),
        regime,
        when,
        confidence: sure,
        p_value,
        heldout_rms_before: before.heldout,
        heldout_rms_after: after.heldout,
        says: explain::sentence(work, pick, &parameters, [before, after], same)
            + &explain::dry_friction_beside(work, pick, stays_beside(work, pick, &fin.readings))
            + &priors::sentence(&gains, settings.floor),
        equation: explain::equation(work, pick, &parameters),
        compensation: explain::compensation(work, pick, &parameters),
        parameters,
        look_alikes: look_alikes.clone(),
        cannot_tell_from: same.clone(),
        depends_on_prior: Some(gains),
        ..Finding::default()
    }
}

/// Rule of succession over the blocks in which the finding helped, times the chance that it is real at all: how sure it is that this, or what cannot
/// be told from it, is there. A name shares that with all that it cannot be told from, and is as sure as what is left is like it.
fn confidence(work: &Work, wins: usize, p_value: f64, motions: usize) -> f64 {
    let raw = (1.0 - p_value) * (wins + 1) as f64 / (work.design.n_folds + 2) as f64;
    // One motion alone is never confirmed, however often it is recorded: another load or motion might not show it.
    if motions < 2 { raw.min(0.79) } else { raw }
}

fn heldout(work: &Work, nominal: &Left, left: &Left, band: f64) -> Heldout {
    let (ids, prior) = work.with_rigid(work.every_model_has(work.softness), PRIORS[PRIORS.len() - 1]);
    let refit = FinalFit::new(work, ids, &prior);
    let refit_left = work.residual(&refit.ids, &refit.theta, work.softness, View::Judge);
    let [n, r, f] = [nominal, &refit_left, left].map(|l| errors(work, l));
    let model = &work.robot.model;
    let joints = (0..work.design.n_drives)
        .map(|j| {
            let joint = &model.joints[model.actuators[j]];
            HeldoutJoint {
                joint: joint.name.clone(),
                unit: joint.kind.unit_effort().to_string(),
                rms_tau: n[j].effort,
                rms_nominal: n[j].error,
                rms_refit: r[j].error,
                rms_final: f[j].error,
            }
        })
        .collect();
    Heldout {
        rms_nominal: pooled(&n),
        rms_refit: pooled(&r),
        rms_final: pooled(&f),
        noise_floor: noise_floor(work, left),
        band_hz: band,
        unit: "fraction of tau rms".to_string(),
        joints,
    }
}

fn evidence(work: &Work, fin: &Final, (nominal, steps, found): (&Left, &[Step], &Search), settings: &Settings) -> Evidence {
    let chain = steps
        .iter()
        .map(|s| {
            let label = s.pick.map_or_else(
                || "as given".to_string(),
                |p| {
                    let c = &work.candidates[work.picks[p].candidate];
                    format!("{} at {}", c.effect_name(), c.places(&work.robot.model).join(", "))
                },
            );
            ChainStep { label, heldout_rms: s.heldout }
        })
        .collect();
    let order = steps.iter().filter_map(|s| s.pick).enumerate();
    let findings = order.map(|(r, p)| picture::finding(work, p, r + 1, &fin.parts[p], &fin.left)).collect();
    let mut ruled_out: Vec<Screened> = Vec::new();
    for s in found.last.iter().flat_map(|c| &c.scores) {
        let c = &work.candidates[s.candidate];
        let is_named = work.picks.iter().any(|p| p.candidate == s.candidate);
        let place = c.places(&work.robot.model);
        let is_said = ruled_out.iter().any(|r| r.effect == c.effect_name() && r.place == place);
        if is_named || is_said {
            continue;
        }
        let why_not = if s.why_not.is_empty() { "did not hold on held-out data".to_string() } else { s.why_not.clone() };
        let wins = [s.tally.wins, work.design.n_folds];
        let (effect, gain, surprise) = (c.effect_name().to_string(), s.gain, s.surprise);
        ruled_out.push(Screened { effect, place, gain, surprise, wins, why_not });
    }
    ruled_out.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let threshold = |level: f64| found.last.last().map_or(0.0, |c| c.threshold(level));
    let null_surprise = [threshold(0.05), threshold(0.01)].map(|t| if t.is_finite() { t } else { 0.0 });
    debug_assert!(fin.fit.ids.len() >= work.picks.len() || work.picks.is_empty(), "every pick has a column");
    Evidence {
        joints: picture::joints(work, nominal, &fin.left),
        findings,
        regimes: picture::regime_cells(work, nominal, &fin.left),
        chain,
        ruled_out,
        null_surprise,
        null_runs: settings.null_runs,
        ..Evidence::default()
    }
}

fn summary(findings: &[Finding], left: &str, h: &Heldout) -> String {
    let errors = format!("held-out error {:.1} % of the effort as given, {:.1} % refined", 100.0 * h.rms_nominal, 100.0 * h.rms_final);
    let mut names: Vec<String> = Vec::new();
    for f in findings {
        let name = format!("{} at {}", f.effect, f.place.join(", "));
        if !names.contains(&name) {
            names.push(name);
        }
    }
    match (names.is_empty(), left.is_empty()) {
        (true, true) => format!("Nothing missing that these recordings could show ({:.1} % of the effort is left).", 100.0 * h.rms_nominal),
        (false, true) => format!("Missing: {}; {errors}.", names.join("; ")),
        (true, false) => format!("Something is missing that the library has no name for: {left}; {errors}."),
        (false, false) => format!("Missing: {}; {errors}; {left}.", names.join("; ")),
    }
}

fn notes(work: &Work, motions: usize, strain: Option<&InternalEffort>) -> Vec<String> {
    let mut out: Vec<String> = strain.map(|e| e.says.clone()).into_iter().collect();
    for m in work.motions {
        let s = &m.segment;
        let gone = s.valid.iter().filter(|v| !**v).count();
        if gone > 0 {
            out.push(format!("{}: {gone} of {} samples lie in gaps and are left out", s.name, s.valid.len()));
        }
    }
    if work.is_refitted {
        out.push(
            "inertias, frictions and offsets were fitted along with the findings: as the robot's files have them, they hide a part of it"
                .to_string(),
        );
    }
    if work.motions.len() < 2 {
        out.push("one recording only: confidence stays below 0.8; give a second one, or --holdout with another motion".to_string());
    } else if motions < 2 {
        let n = work.motions.len();
        out.push(format!(
            "all {n} recordings repeat one motion: confidence stays below 0.8; record another motion, load or base orientation"
        ));
    }
    out
}
