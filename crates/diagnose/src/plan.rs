//! Before any recording: what could be seen along a planned motion, in what size, and what would be mistaken for what.

use alloc::collections::BTreeMap;

use pkm_dyn::effects::Robot;
use pkm_dyn::math;
use pkm_dyn::urdf::Description;
use pkm_ident::Recording;
use serde::{Deserialize, Serialize};

use crate::detectable::{Power, count, detectable};
use crate::error::InputError;
use crate::isolability::{ALIAS_COSINE, Isolability, LEAST_SURVIVING, isolability};
use crate::motion::{self, Motion};
use crate::segment;
use crate::settings::{PRIORS, Settings};
use crate::verdict::{Detectable, EffectAt, Invisible, Use};
use crate::work::Work;

/// Name of the JSON layout.
const SCHEMA: &str = "pkm.plan/1";

/// How far the inertias of the model are believed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Belief {
    /// They are exact: what changed on the same robot?
    Anchored,
    /// They may be off by a tenth of their size.
    #[default]
    Soft,
    /// They are refitted: is the structure wrong?
    Refit,
}

impl Belief {
    /// Prior standard deviation as a share of each parameter's size.
    fn share(self) -> f64 {
        match self {
            Self::Anchored => 0.0,
            Self::Soft => PRIORS[1],
            Self::Refit => f64::INFINITY,
        }
    }
}

/// What a plan is made with.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanSettings {
    /// Standard deviation of the noise of each drive's recorded effort, by joint `[N | N·m]`; independent from sample to sample.
    pub noise: BTreeMap<String, f64>,
    /// How far the model's inertias are believed.
    pub belief: Belief,
    /// Band, what is worth a name and what is not looked for, as in a diagnosis.
    pub decision: Settings,
}

/// Two effects that must be told apart, and whether they are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Required {
    /// The two effects.
    pub effects: [EffectAt; 2],
    /// Cosine of the angle between them.
    pub cosine: f64,
    /// Share of each that survives.
    pub kappa: [f64; 2],
    /// Whether the motion tells them apart.
    pub ok: bool,
}

/// A pair that the motion cannot tell apart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Alias {
    /// The two effects.
    pub effects: [EffectAt; 2],
    /// Cosine of the angle between them.
    pub cosine: f64,
}

/// What a motion could show.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// `pkm.plan/1`.
    pub schema: String,
    /// Robot name.
    pub robot: String,
    /// The motions, as given.
    pub references: Vec<String>,
    /// Their length together `[s]`.
    pub duration_s: f64,
    /// Low-pass `[Hz]`.
    pub band_hz: f64,
    /// How far the model's inertias were believed.
    pub belief: Belief,
    /// Noise of each drive's effort, by joint `[N | N·m]`.
    pub noise: BTreeMap<String, f64>,
    /// Smallest sizes that would be named.
    pub minimum_detectable: Vec<Detectable>,
    /// What would not be seen in any size.
    pub invisible: Vec<Invisible>,
    /// Pairs closer than a cosine of 0.95, closest first.
    pub aliases: Vec<Alias>,
    /// Angles between all effects.
    pub isolability: Isolability,
}

impl Plan {
    /// Every pair of an effect named `a` with one named `b` (`NAME` or `NAME@PLACE`); of bare names, those pairs that are at one place or
    /// share one with the whole robot.
    ///
    /// # Errors
    /// A name that nothing in the plan has.
    pub fn require(&self, a: &str, b: &str) -> Result<Vec<Required>, String> {
        let [first, second] = [a, b].map(|text| self.matching(text));
        let (first, second) = (first?, second?);
        let effects = &self.isolability.effects;
        let is_open = !a.contains('@') && !b.contains('@');
        let beside = |i: usize, j: usize| {
            let places = |k: usize| effects.iter().filter(|e| e.effect == effects[k].effect).count();
            effects[i].place == effects[j].place || places(i) == 1 || places(j) == 1
        };
        let all: Vec<(usize, usize)> = first.iter().flat_map(|&i| second.iter().map(move |&j| (i, j))).filter(|(i, j)| i != j).collect();
        let near: Vec<(usize, usize)> = all.iter().copied().filter(|&(i, j)| beside(i, j)).collect();
        // A link and a joint have no place in common: then every pair counts.
        let pairs = if is_open && !near.is_empty() { near } else { all };
        let required = |(i, j): (usize, usize)| {
            let (cosine, kappa) = (self.isolability.cosines[i][j], [i, j].map(|k| effects[k].kappa));
            let ok = cosine <= ALIAS_COSINE && kappa.iter().all(|k| *k >= LEAST_SURVIVING);
            Required { effects: [i, j].map(|k| self.effect_at(k)), cosine, kappa, ok }
        };
        Ok(pairs.into_iter().map(required).collect())
    }

    fn matching(&self, text: &str) -> Result<Vec<usize>, String> {
        let (name, place) = text.split_once('@').map_or((text, None), |(n, p)| (n, Some(p)));
        let effects = &self.isolability.effects;
        let is = |i: &usize| effects[*i].effect == name && place.is_none_or(|p| effects[*i].place.iter().any(|q| q == p));
        let out: Vec<usize> = (0..effects.len()).filter(is).collect();
        if !out.is_empty() {
            return Ok(out);
        }
        let mut known: Vec<&str> = effects.iter().map(|e| e.effect.as_str()).collect();
        known.dedup();
        let places: Vec<&str> = effects.iter().filter(|e| e.effect == name).flat_map(|e| e.place.iter().map(String::as_str)).collect();
        Err(match place {
            Some(p) if !places.is_empty() => format!("no {name} at {p:?} (there is: {})", places.join(", ")),
            _ => format!("no effect {name:?} is looked for along this motion (there are: {})", known.join(", ")),
        })
    }

    fn effect_at(&self, i: usize) -> EffectAt {
        let e = &self.isolability.effects[i];
        EffectAt { effect: e.effect.clone(), place: e.place.clone(), separating_experiment: String::new() }
    }
}

/// Says what motions along `references` could show: recordings of which only the reference positions count (`q_ref`, or `q` where there
/// are none). No effort is needed, so none of it is read.
///
/// # Errors
/// Motions that are missing columns, too short, or not of this robot; noise that is no number or of no drive.
pub fn plan(
    description: &Description,
    references: &[Recording],
    settings: &PlanSettings,
    progress: &mut dyn FnMut(f64),
) -> Result<Plan, InputError> {
    let robot = &description.robot;
    let noise = noise(robot, settings)?;
    let motions = motions(robot, references, settings, progress)?;
    let (mut motions, band) = motions;
    let gains = crate::rows::FineGrid::new(motions[0].segment.dt, band).noise_gain();
    let weight: Vec<f64> = noise.iter().map(|s| 1.0 / (s * math::sqrt(gains[0]))).collect();
    let mut work = Work::planned(robot, &mut motions, band, &weight, settings.decision.looked_for()?.as_deref());
    work.kappa = settings.belief.share();
    if let Some(reasons) = crate::enough::too_few_to_fit(&work.design, band) {
        return Err(InputError::Short { recording: references[0].name.clone(), reason: reasons });
    }
    progress(0.8);
    let power: Vec<Power> =
        (0..noise.len()).map(|j| count(&work, j)).map(|rows| Power { plain: rows, coloured: rows * gains[1] / gains[0] }).collect();
    let (minimum_detectable, invisible) = detectable(&work, &power, &settings.decision);
    let isolability = isolability(&work);
    let mut out = Plan {
        schema: SCHEMA.to_string(),
        robot: robot.model.name.clone(),
        references: references.iter().map(|r| r.name.clone()).collect(),
        duration_s: references.iter().map(Recording::duration).sum(),
        band_hz: band,
        belief: settings.belief,
        noise: settings.noise.clone(),
        minimum_detectable,
        invisible,
        aliases: Vec::new(),
        isolability,
    };
    // Without limit is no number JSON can write.
    out.isolability.prior = if out.isolability.prior.is_finite() { out.isolability.prior } else { 1e9 };
    out.aliases =
        out.isolability.aliases().into_iter().map(|(i, j, cosine)| Alias { effects: [i, j].map(|k| out.effect_at(k)), cosine }).collect();
    progress(1.0);
    Ok(out)
}

/// Noise of every drive in the model's order.
fn noise(robot: &Robot, settings: &PlanSettings) -> Result<Vec<f64>, InputError> {
    let model = &robot.model;
    let names: Vec<&String> = model.actuators.iter().map(|&j| &model.joints[j].name).collect();
    let bad = |joint: &str, detail: String| InputError::Noise { joint: joint.to_string(), detail };
    if let Some(unknown) = settings.noise.keys().find(|k| !names.contains(k)) {
        let known: Vec<&str> = names.iter().map(|n| n.as_str()).collect();
        return Err(bad(unknown, format!("no driven joint of that name (there are: {})", known.join(", "))));
    }
    let of = |name: &&String| match settings.noise.get(*name) {
        Some(s) if s.is_finite() && *s > 0.0 => Ok(*s),
        Some(s) => Err(bad(name, format!("{s} (must be finite and > 0)"))),
        None => Err(bad(name, "not stated".to_string())),
    };
    names.iter().map(of).collect()
}

/// Reference positions as motions, and the band.
fn motions(
    robot: &Robot,
    references: &[Recording],
    settings: &PlanSettings,
    progress: &mut dyn FnMut(f64),
) -> Result<(Vec<Motion>, f64), InputError> {
    let planned = references.iter().map(|r| planned(robot, r)).collect::<Result<Vec<_>, _>>()?;
    let all: Vec<(&Recording, Use)> = planned.iter().map(|r| (r, Use::Train)).collect();
    let (segments, band) = segment::segments(robot, &all, settings.decision.band_hz)?;
    let n = segments.len();
    let mut out = Vec::with_capacity(n);
    for (i, s) in segments.into_iter().enumerate() {
        let mut m = motion::motion(robot, s)?;
        // What the model as given would record: sizes are judged as shares of it.
        m.segment.tau.clone_from(&m.nominal[0]);
        out.push(m);
        progress(0.5 * (i + 1) as f64 / n as f64);
    }
    Ok((out, band))
}

/// A reference as a recording that followed it exactly.
fn planned(robot: &Robot, reference: &Recording) -> Result<Recording, InputError> {
    let model = &robot.model;
    let mut out = Recording { name: reference.name.clone(), time: reference.time.clone(), ..Recording::default() };
    (out.meta.load, out.meta.gravity) = (reference.meta.load.clone(), reference.meta.gravity);
    for &j in &model.actuators {
        let name = &model.joints[j].name;
        let column = format!("q_ref.{name}");
        let q = reference.signal(&column).or_else(|| reference.signal(&format!("q.{name}")));
        let found = || reference.columns();
        let missing = || InputError::MissingColumn { recording: reference.name.clone(), column, robot: model.name.clone(), found: found() };
        out.signals.insert(format!("q.{name}"), q.ok_or_else(missing)?.to_vec());
        out.signals.insert(format!("tau.{name}"), vec![0.0; reference.len()]);
    }
    Ok(out)
}

/// Noise of each drive's effort in a recording, by joint `[N | N·m]`: from second differences, which a motion survives badly and independent
/// noise fully.
///
/// # Errors
/// An effort column that is missing or holds fewer than three samples in a row.
pub fn recorded_noise(robot: &Robot, recording: &Recording) -> Result<BTreeMap<String, f64>, InputError> {
    let model = &robot.model;
    let mut out = BTreeMap::new();
    for &j in &model.actuators {
        let name = &model.joints[j].name;
        let column = format!("tau.{name}");
        let (found, robot) = (|| recording.columns(), model.name.clone());
        let missing = || InputError::MissingColumn { recording: recording.name.clone(), column: column.clone(), robot, found: found() };
        let tau = recording.signal(&column).ok_or_else(missing)?;
        let known = tau.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]).filter(|d| d.is_finite());
        let (sum, n) = known.fold((0.0, 0_usize), |(s, n), d| (s + d * d / 6.0, n + 1));
        if n == 0 {
            return Err(InputError::EmptyColumn { recording: recording.name.clone(), column, known: 0, samples: tau.len() });
        }
        out.insert(name.clone(), math::sqrt(sum / n as f64));
    }
    Ok(out)
}
