//! The next experiment: what would tell a finding from what it cannot be told from. Each intervention is tried on the nominal model: the
//! recorded motion is changed as the intervention would change it, all columns are computed anew, and the angle between the two effects is
//! taken over what was recorded and what would be recorded together.

use core::f64::consts::PI;

use nalgebra::{Rotation3, Vector3};
use pkm_dyn::effects::{Applied, Law};
use pkm_dyn::math;
use pkm_dyn::parameters::N_INERTIAL;
use pkm_ident::KnownLoad;
use pkm_ident::excitation::{Criterion, Excitation, Settings as Search, excite};
use rayon::prelude::*;

use crate::isolability::cosine_of;
use crate::motion::{Motion, motion_with, top_speed};
use crate::segment::{Segment, every};
use crate::sensitivity::Lengths;
use crate::shelf::Tape;
use crate::verdict::{EffectAt, Experiment, Finding, Use};
use crate::work::{Variant, Work};

/// Cosine up to which two effects count as told apart; between this and the alias limit noise decides.
const SEPARATED: f64 = 0.9;

/// Least change of a cosine that is worth saying.
const CHANGE: f64 = 0.02;

/// Samples of a motion that are looked at: enough for every phase of it, few enough to try many interventions.
const SAMPLES: usize = 3000;

/// Fractions of the robot's moving mass that a known mass has.
const LOAD_SHARES: [f64; 2] = [0.25, 1.0];

/// Angle by which a base is tilted on purpose `[rad]`.
const TILT: f64 = PI / 12.0;

/// Motions that are looked for in one diagnosis at most: a search takes as long as everything else.
const SEARCHES: usize = 3;

/// Share of its travel by which every drive's centre is moved.
const SHIFT: f64 = 0.25;

/// Something to do, and the motion that would then be recorded; in the order of their costs.
struct Intervention {
    text: String,
    segment: Segment,
}

/// Adds to every finding the experiments against each of its aliases, cheapest first, and puts the first that separates into words.
pub(crate) fn propose(work: &Work, findings: &mut [Finding], band: f64) {
    if findings.iter().all(|f| f.cannot_tell_from.is_empty()) {
        return;
    }
    let Some(now) = recorded(work, band) else { return };
    let names = names(findings);
    let Some(bench) = Bench::new(work, band, &names, &now) else { return };
    let pairs: Vec<(usize, usize)> =
        findings.iter().enumerate().flat_map(|(i, f)| (0..f.cannot_tell_from.len()).map(move |k| (i, k))).collect();
    let before: Vec<Option<f64>> = bench.angles(None, findings, &pairs);
    let with = |i: Intervention| (i.text, bench.angles(Some(i.segment), findings, &pairs));
    let tried: Vec<(String, Vec<Option<f64>>)> = interventions(work, &now).into_par_iter().map(with).collect();
    let mut searches = SEARCHES;
    for (p, &(i, k)) in pairs.iter().enumerate() {
        let Some(cos_now) = before[p] else { continue };
        let mut options: Vec<(String, f64)> = Vec::new();
        if cos_now <= SEPARATED {
            options.push((
                "record the same kind of motion for longer: the two are not alike, only weak against what is left".to_string(),
                cos_now,
            ));
        }
        options.extend(tried.iter().filter_map(|(text, c)| c[p].map(|c| (text.clone(), c))).filter(|(_, c)| cos_now - c > CHANGE));
        let is_open = searches > 0 && !options.iter().any(|(_, c)| *c <= SEPARATED);
        searches -= usize::from(is_open);
        if is_open
            && let Some((text, segment)) = optimised(work, &findings[i], &findings[i].cannot_tell_from[k], &now)
            && let Some(c) = bench.angles(Some(segment), findings, &[(i, k)])[0]
            && cos_now - c > CHANGE
        {
            options.push((text, c));
        }
        let f = &mut findings[i];
        let alias = f.cannot_tell_from[k].clone();
        let said = chosen(options).into_iter().map(|(text, c)| experiment(&f.effect, &alias, text, cos_now, c)).collect::<Vec<_>>();
        let known = alias.separating_experiment.clone();
        f.cannot_tell_from[k].separating_experiment = match said.first() {
            Some(e) if e.separates => e.says.clone(),
            Some(e) => format!("{} {}", e.says, capital(&known)),
            None => format!(
                "{known} (no change of motion, load or base orientation that was tried in the model opens the angle, cos {cos_now:.2})"
            ),
        };
        f.experiments.extend(said);
    }
}

/// The cheapest that separates, and the best where that is another one and clearly better.
fn chosen(options: Vec<(String, f64)>) -> Vec<(String, f64)> {
    let best = options.iter().min_by(|a, b| a.1.total_cmp(&b.1)).cloned();
    let cheapest = options.into_iter().find(|(_, c)| *c <= SEPARATED);
    let mut out: Vec<(String, f64)> = cheapest.into_iter().collect();
    if let Some(best) = best
        && out.iter().all(|(text, c)| *text != best.0 && c - best.1 > 0.1)
    {
        out.push(best);
    }
    out
}

fn experiment(effect: &str, alias: &EffectAt, text: String, cos_now: f64, cos_expected: f64) -> Experiment {
    let separates = cos_expected <= SEPARATED;
    let end = if separates { "" } else { ", which is still too close" };
    let pair = format!("cosine between {effect} and {}", alias.effect);
    let says = if cos_now - cos_expected > CHANGE {
        format!("{text}: expected {pair} {cos_expected:.2} instead of {cos_now:.2}{end}.")
    } else {
        format!("{text} ({pair} {cos_now:.2}); more samples make what is left smaller beside them.")
    };
    Experiment {
        against: alias.effect.clone(),
        place: alias.place.clone(),
        intervention: text,
        cos_now,
        cos_expected,
        separates,
        says: capital(&says),
    }
}

fn capital(text: &str) -> String {
    let mut c = text.chars();
    c.next().map_or_else(String::new, |first| first.to_uppercase().chain(c).collect())
}

/// Names of everything that is to be told apart.
fn names(findings: &[Finding]) -> Vec<&'static str> {
    let all = findings.iter().flat_map(|f| core::iter::once(f.effect.as_str()).chain(f.cannot_tell_from.iter().map(|a| a.effect.as_str())));
    let mut out: Vec<&'static str> = all.filter_map(|n| pkm_dyn::effects::find(n).map(|e| e.name)).collect();
    out.sort_unstable();
    out.dedup();
    out
}

/// The first recorded motion that was fitted, with no more samples than the band needs.
fn recorded(work: &Work, band: f64) -> Option<Segment> {
    let m = work.motions.iter().find(|m| m.segment.used != Use::Holdout)?;
    let step = every(m.segment.dt, 20.0 * band);
    let thin = |x: &Vec<f64>| x.iter().copied().step_by(step).take(SAMPLES).collect::<Vec<f64>>();
    let s = &m.segment;
    let each = |x: &[Vec<f64>]| x.iter().map(thin).collect::<Vec<_>>();
    let valid: Vec<bool> = s.valid.iter().copied().step_by(step).take(SAMPLES).collect();
    let dt = s.dt * step as f64;
    let (q, v, a, tau) = (each(&s.q), each(&s.v), each(&s.a), each(&s.tau));
    Some(Segment { dt, q, v, a, tau, warmth: each(&s.warmth), duration: dt * valid.len() as f64, valid, used: Use::Train, ..s.clone() })
}

/// What could be done, cheapest first.
fn interventions(work: &Work, now: &Segment) -> Vec<Intervention> {
    let mut out = vec![
        Intervention { text: "run the same motion backwards in time".to_string(), segment: backwards(now) },
        Intervention { text: "repeat the motion at a fifth of the speed".to_string(), segment: faster(now, 0.2) },
    ];
    if may_be_faster(work, now, 2.0) {
        out.push(Intervention { text: "repeat the motion at twice the speed".to_string(), segment: faster(now, 2.0) });
    }
    out.extend(moved(work, now));
    out.extend(loaded(work, now));
    for (text, axis) in [("about x (roll)", Vector3::x_axis()), ("about y (pitch)", Vector3::y_axis())] {
        let gravity = Rotation3::from_axis_angle(&axis, -TILT) * now.gravity.map_or(work.robot.model.gravity, Vector3::from);
        let segment = Segment { gravity: Some(gravity.into()), ..now.clone() };
        out.push(Intervention { text: format!("record the motion again with the base tilted by 15 degrees {text}"), segment });
    }
    out
}

fn backwards(s: &Segment) -> Segment {
    let turned = |x: &[Vec<f64>], sign: f64| x.iter().map(|x| x.iter().rev().map(|x| sign * x).collect()).collect::<Vec<Vec<f64>>>();
    let valid = s.valid.iter().rev().copied().collect();
    Segment { q: turned(&s.q, 1.0), v: turned(&s.v, -1.0), a: turned(&s.a, 1.0), valid, ..s.clone() }
}

fn faster(s: &Segment, factor: f64) -> Segment {
    let scaled = |x: &[Vec<f64>], by: f64| x.iter().map(|x| x.iter().map(|x| by * x).collect()).collect::<Vec<Vec<f64>>>();
    let (dt, duration) = (s.dt / factor, s.duration / factor);
    Segment { dt, duration, v: scaled(&s.v, factor), a: scaled(&s.a, factor * factor), ..s.clone() }
}

/// Whether every drive has a stated speed limit that a faster motion keeps.
fn may_be_faster(work: &Work, s: &Segment, factor: f64) -> bool {
    let model = &work.robot.model;
    model
        .actuators
        .iter()
        .enumerate()
        .all(|(k, &j)| factor * top_speed(&s.v[k]) <= model.joints[j].limits.velocity && model.joints[j].limits.velocity.is_finite())
}

/// The motion about another centre, to the first side that joint limits and loops allow.
fn moved(work: &Work, now: &Segment) -> Option<Intervention> {
    let model = &work.robot.model;
    let ends = |q: &[f64]| q.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
    [SHIFT, -SHIFT].into_iter().find_map(|share| {
        let mut segment = now.clone();
        for (k, &j) in model.actuators.iter().enumerate() {
            let (low, high) = ends(&segment.q[k]);
            let (by, limits) = (share * (high - low), model.joints[j].limits);
            if low + by < limits.lower || high + by > limits.upper {
                return None;
            }
            segment.q[k].iter_mut().for_each(|q| *q += by);
        }
        motion_with(work.robot, segment.clone(), Lengths::Left).ok()?;
        let side = if share > 0.0 { "forward" } else { "back" };
        let text = format!("repeat the motion about another centre, every drive moved {side} by {:.0} % of its travel", 100.0 * SHIFT);
        Some(Intervention { text, segment })
    })
}

/// Known masses where the drives feel them most, as far as the drives can carry them.
fn loaded(work: &Work, now: &Segment) -> Vec<Intervention> {
    if now.load.is_some() {
        return Vec::new();
    }
    let model = &work.robot.model;
    let massive = model.massive_links();
    let felt = |l: usize| -> f64 { work.motions[0].link_columns[N_INERTIAL * l].iter().map(Tape::square).sum() };
    let Some(l) = (0..massive.len()).max_by(|&a, &b| felt(a).total_cmp(&felt(b))) else { return Vec::new() };
    let moving: f64 = massive.iter().map(|&l| model.links[l].parameters.mass).sum();
    let (name, centre) = (&model.links[massive[l]].name, model.links[massive[l]].parameters.centre_of_mass().0);
    let with = |share: f64| {
        let mass = two_digits(share * moving);
        let load = KnownLoad { link: name.clone(), mass, xyz: centre.into() };
        let text = format!("fix a known mass of {mass} kg to {name} and record the same motion");
        let segment = Segment { load: Some(load), ..now.clone() };
        (mass > 0.0 && can_carry(work, &segment)).then_some(Intervention { text, segment })
    };
    LOAD_SHARES.into_iter().filter_map(with).collect()
}

/// Whether the model as given stays within the drives' efforts.
fn can_carry(work: &Work, segment: &Segment) -> bool {
    let model = &work.robot.model;
    let within = |m: &Motion| {
        model.actuators.iter().zip(&m.nominal[0]).all(|(&j, tau)| tau.iter().all(|t| t.abs() <= model.joints[j].limits.effort))
    };
    motion_with(work.robot, segment.clone(), Lengths::Left).is_ok_and(|m| within(&m))
}

fn two_digits(x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    let unit = math::powf(10.0, math::log10(x).floor() - 1.0);
    (x / unit).round() * unit
}

/// A motion found for these two effects; none where they are no efforts at joints, or no motion is found.
fn optimised(work: &Work, f: &Finding, alias: &EffectAt, now: &Segment) -> Option<(String, Segment)> {
    // Of surplus drives only the leading ones are drawn; the others would have to be found from the loops.
    if work.design.is_shared() {
        return None;
    }
    let model = &work.robot.model;
    let parameters: Vec<(String, f64)> = f.parameters.iter().map(|(n, e)| (n.clone(), e.value)).collect();
    let own = Applied::try_new(model, &f.effect, f.place.first()?, &parameters).ok()?;
    let entry = pkm_dyn::effects::find(&alias.effect)?;
    // Only the shape of the other one counts, not its size.
    let ones: Vec<(String, f64)> = entry.parameters.iter().filter(|p| p.default.is_none()).map(|p| (p.name.to_string(), 1.0)).collect();
    let other = Applied::try_new(model, &alias.effect, alias.place.first()?, &ones).ok()?;
    let effects = vec![own, other];
    if !effects.iter().all(|e| matches!(e.entry.law, Law::JointEffort(_))) {
        return None;
    }
    let search = Search { criterion: Criterion::Angle, effects, restarts: 1, draws: 10, iterations: 20, ..Search::default() };
    let found = excite(work.robot, &search, &|_| {}).ok()?;
    let spell = |e: &str, p: &[String], v: &[(String, f64)]| {
        let values: Vec<String> = v.iter().map(|(n, x)| format!("{n}={x:.3}")).collect();
        format!("--separate {e}@{}:{}", p.join(","), values.join(","))
    };
    let arguments = format!("{} {}", spell(&f.effect, &f.place, &parameters), spell(&alias.effect, &alias.place, &ones));
    let text = format!("record a motion made for these two (pkm excite {} --out motion.csv --criterion angle {arguments})", model.name);
    Some((text, sampled(&found, now)))
}

/// One period of a found motion at the step of the recorded one.
fn sampled(found: &Excitation, now: &Segment) -> Segment {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded by the number of samples")]
    let n = ((found.motion.period_s / now.dt) as usize).min(SAMPLES);
    let drives = now.q.len();
    let mut out = Segment { duration: now.dt * n as f64, valid: vec![true; n], ..now.clone() };
    (out.q, out.v, out.a) = (vec![Vec::new(); drives], vec![Vec::new(); drives], vec![Vec::new(); drives]);
    out.warmth = vec![Vec::new(); drives];
    out.tau = vec![vec![0.0; n]; drives];
    for i in 0..n {
        let state = found.motion.at(now.dt * i as f64);
        for k in 0..drives {
            out.q[k].push(state.q[k]);
            out.v[k].push(state.v[k]);
            out.a[k].push(state.a[k]);
        }
    }
    out
}

/// What angles between effects are taken from.
struct Bench<'a> {
    work: &'a Work<'a>,
    band: f64,
    names: &'a [&'a str],
    /// What wrong lengths would do, where that is to be told apart.
    lengths: Lengths,
    /// The recorded motion through the robot.
    now: Motion,
}

impl<'a> Bench<'a> {
    /// None where the robot cannot make the recorded motion.
    fn new(work: &'a Work<'a>, band: f64, names: &'a [&'a str], now: &Segment) -> Option<Self> {
        let lengths = if names.contains(&"geometry_error") { Lengths::Taken } else { Lengths::Left };
        let now = motion_with(work.robot, now.clone(), lengths).ok()?;
        Some(Self { work, band, names, lengths, now })
    }

    /// Cosines between findings and their aliases along the recorded motion, and another beside it; `None` where one of them is nothing that
    /// columns are made for at one place, or the robot cannot make the motion.
    fn angles(&self, beside: Option<Segment>, findings: &[Finding], pairs: &[(usize, usize)]) -> Vec<Option<f64>> {
        let (work, mut motions) = (self.work, vec![self.now.clone()]);
        if let Some(segment) = beside {
            let Ok(motion) = motion_with(work.robot, segment, self.lengths) else { return vec![None; pairs.len()] };
            motions.push(motion);
        }
        let mut bench = Work::planned(work.robot, &mut motions, self.band, &work.design.weight, Some(self.names));
        bench.kappa = work.kappa;
        bench.softness = work.softness;
        let of = |f: &Finding, a: &EffectAt| {
            let [own, other] = [(&f.effect, &f.place), (&a.effect, &a.place)].map(|(e, p)| candidate(&bench, e, p));
            let (own, other) = (own?, other?);
            let shape = nearest_shape(&bench, own, &found_values(work, f))?;
            let shapes = bench.candidates[other].variants.iter().filter(|v| v.softness.is_none_or(|w| w == bench.softness));
            Some(shapes.map(|v| cosine_of(&bench, (own, shape), (other, v))).fold(0.0, f64::max))
        };
        pairs.iter().map(|&(i, k)| of(&findings[i], &findings[i].cannot_tell_from[k])).collect()
    }
}

fn candidate(work: &Work, effect: &str, place: &[String]) -> Option<usize> {
    let [place] = place else { return None };
    work.candidates.iter().position(|c| c.effect_name() == effect && c.name == *place)
}

/// Shape values and number of columns with which a finding was fitted.
fn found_values(work: &Work, f: &Finding) -> (Vec<f64>, usize) {
    let is = |c: usize| work.candidates[c].effect_name() == f.effect && f.place == [work.candidates[c].name.clone()];
    work.picks.iter().find(|p| is(p.candidate)).map_or((Vec::new(), 1), |p| (p.variant.values.clone(), p.variant.columns.len()))
}

/// The shape of a candidate with the same number of columns and the closest values.
fn nearest_shape<'b>(bench: &'b Work, candidate: usize, (values, n): &(Vec<f64>, usize)) -> Option<&'b Variant> {
    let far = |v: &&Variant| -> f64 {
        let columns = if v.columns.len() == *n { 0.0 } else { 1e6 };
        columns + v.values.iter().zip(values).map(|(a, b)| math::ln(((a + 1e-12) / (b + 1e-12)).abs().max(1e-12)).abs()).sum::<f64>()
    };
    let all = bench.candidates[candidate].variants.iter().filter(|v| v.softness.is_none_or(|w| w == bench.softness));
    all.min_by(|a, b| far(a).total_cmp(&far(b)))
}
