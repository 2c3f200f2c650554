//! One case: a robot, a level of concealment, what is concealed and how large, and the recordings of it.

use serde::{Deserialize, Serialize};

use crate::base::{Base, HOLDOUT, drawn, facts, file_name, run, speeds};
use crate::bench::{Bench, Found, MEASURED};
use crate::machine::{Hand, Push, Trace};
use crate::menu::{Fact, Parameter, Scene, restless};
use crate::random::Stream;
use crate::reference::Reference;
use crate::refit::{left_share, refit};
use crate::robot::{Robot, RobotError, urdf_with};
use crate::sensing::{Mishap, Noise, Recording};

/// Robots of the trials.
pub const ROBOTS: [&str; 5] = ["prs3", "serial_arm", "motobotte", "ups3_rpu1", "five_bar"];

/// Robots that cases can be made of on request: with more drives than freedoms, or like one of the others.
pub const MORE: [&str; 1] = ["ups4"];

/// Sizes of effects unless others are asked for.
pub const SIZES: [f64; 4] = [0.5, 1.0, 2.0, 4.0];

/// Bands for which what is left without anything concealed is written down `[Hz]`.
const BANDS: [f64; 4] = [3.0, 6.0, 12.0, 24.0];

/// How an effect is concealed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Level {
    /// A controller so soft that the loop hardly closes; the nominal robot is the true one but for the effect.
    L0,
    /// A stiff controller.
    L1,
    /// The nominal robot refitted on the corrupted recordings.
    L2,
    /// L2, and inertias 5 % off, coloured noise of 2 %, 0.5 ms between command and effect.
    L3,
    /// L2 with two effects.
    L4,
    /// L2 with physics that no catalogue has.
    L5,
    /// Nothing concealed.
    L6,
    /// Nothing concealed, but L3's decoys and a bad day: garbage, dropouts, gaps, a patient.
    L7,
}

impl Level {
    /// All of them.
    pub const ALL: [Self; 8] = [Self::L0, Self::L1, Self::L2, Self::L3, Self::L4, Self::L5, Self::L6, Self::L7];

    /// Levels in the order in which cases take them: a quarter healthy, a third concealed by a refit.
    pub const TURN: [Self; 12] =
        [Self::L2, Self::L1, Self::L3, Self::L6, Self::L4, Self::L2, Self::L5, Self::L7, Self::L3, Self::L0, Self::L2, Self::L6];

    /// Whether nothing is concealed.
    #[must_use]
    pub fn is_healthy(self) -> bool {
        matches!(self, Self::L6 | Self::L7)
    }

    /// Whether the nominal robot is refitted.
    #[must_use]
    pub fn is_refitted(self) -> bool {
        matches!(self, Self::L2 | Self::L3 | Self::L4 | Self::L5 | Self::L7)
    }

    /// Whether there are decoys.
    #[must_use]
    pub fn has_decoys(self) -> bool {
        matches!(self, Self::L3 | Self::L7)
    }
}

/// What cases are drawn from; an empty list means all or the usual.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Design {
    /// Levels.
    pub levels: Vec<Level>,
    /// Robots.
    pub robots: Vec<String>,
    /// Sizes of effects over the smallest that can be detected.
    pub sizes: Vec<f64>,
    /// Factors on the noise of the sensors; sizes stay those of factor 1.
    pub noise_factors: Vec<f64>,
    /// How many recordings there are to learn from: 1, 2 or 4; sizes stay those of 2.
    pub recordings: Vec<usize>,
    /// Effects to conceal, one of them in every case that conceals what the catalogue has; empty draws from all.
    pub effects: Vec<String>,
}

/// What is to be made.
#[derive(Debug, Clone, PartialEq)]
pub struct Wish {
    /// Number of the case.
    pub number: u64,
    /// Seed of the whole run.
    pub seed: u64,
    /// Level.
    pub level: Level,
    /// Robot.
    pub robot: String,
    /// Size of the effect over the smallest that can be detected.
    pub size: f64,
    /// Factor on the noise of the sensors.
    pub noise: f64,
    /// Recordings to learn from.
    pub recordings: usize,
    /// A certain effect in place of a random one; of two effects the first, of physics outside the catalogue none.
    pub effect: Option<String>,
}

impl Wish {
    /// The wish with that number: robots and levels in turn, the rest at random, all combinations in the long run.
    #[must_use]
    pub fn of(number: u64, seed: u64, design: &Design) -> Self {
        let mut random = Stream::new(seed, number, "wish");
        let turn: Vec<Level> = Level::TURN.into_iter().filter(|l| design.levels.is_empty() || design.levels.contains(l)).collect();
        // One further after every full turn of levels and robots: all pairs come about.
        let names: Vec<&str> = if design.robots.is_empty() { ROBOTS.to_vec() } else { design.robots.iter().map(String::as_str).collect() };
        let robot = names[usize::try_from((number + number / 60) % names.len() as u64).unwrap_or(0)];
        let level = turn[usize::try_from(number % turn.len().max(1) as u64).unwrap_or(0)];
        let size = *random.choose(&design.sizes).or_else(|| random.choose(&SIZES)).unwrap_or(&1.0);
        let noise = *random.choose(&design.noise_factors).unwrap_or(&1.0);
        let recordings = *random.choose(&design.recordings).unwrap_or(&MEASURED);
        let effect = random.choose(&design.effects).cloned();
        Self { number, seed, level, robot: robot.to_string(), size, noise, recordings, effect }
    }
}

/// A concealed effect, as the sealed answer tells it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Concealed {
    /// Name of the catalogue, or one that begins with `outside_`.
    pub effect: String,
    /// Joints, links or loops.
    #[serde(rename = "where")]
    pub place: Vec<String>,
    /// The law, in words.
    #[serde(default)]
    pub form: String,
    /// Whether a catalogue would write it the same way.
    #[serde(default)]
    pub is_textbook: bool,
    /// Size over the smallest that can be detected, as it came out; none where nobody measured it.
    #[serde(default)]
    pub size: Option<f64>,
    /// Share of the effect that a refit of the nominal robot cannot take.
    #[serde(default)]
    pub beside_refit: Option<f64>,
    /// Share of the effort that the effect makes.
    #[serde(default)]
    pub effort_share: Option<f64>,
    /// True parameters.
    #[serde(default)]
    pub parameters: Vec<Parameter>,
}

/// The sealed answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// `pkm.trial/1`.
    pub schema: String,
    /// Keeps the hash from being found by trying every answer.
    pub salt: String,
    /// Level.
    pub level: Level,
    /// Robot.
    pub robot: String,
    /// What is concealed.
    pub concealed: Vec<Concealed>,
    /// Whether a patient moved on their own account.
    #[serde(default)]
    pub has_patient: bool,
    /// Factor on the noise of the sensors.
    #[serde(default)]
    pub noise_factor: Option<f64>,
    /// Recordings to learn from.
    #[serde(default)]
    pub recordings: Option<usize>,
    /// Frequency `[Hz]` and share of the holdout's effort that the true robot's own model leaves below it with nothing concealed.
    #[serde(default)]
    pub floor: Vec<[f64; 2]>,
}

/// A finished case.
#[derive(Debug, Clone)]
pub struct Case {
    /// Public files: name and text.
    pub files: Vec<(String, String)>,
    /// The answer, to be sealed.
    pub answer: Answer,
}

/// Recordings of a case: those to learn from, then the one to judge on.
fn recorded(wish: &Wish) -> Vec<usize> {
    (0..wish.recordings.clamp(1, HOLDOUT)).chain([HOLDOUT]).collect()
}

/// Makes a case.
///
/// # Errors
/// When the robot cannot be read, cannot move, or nothing can be concealed in it.
pub fn make(wish: &Wish) -> Result<Case, RobotError> {
    let base = Base::new(wish)?;
    let mut random = Stream::new(wish.seed, wish.number, "case");
    let mut paths = Stream::new(wish.seed, wish.number, "paths");
    let followed = (0..=HOLDOUT).map(|r| base.followed(r, &mut paths)).collect::<Result<Vec<_>, _>>()?;
    let (references, silent): (Vec<Reference>, Vec<Trace>) = followed.into_iter().unzip();
    let facts = facts(&base.plant, &silent)?;
    let spread: Vec<f64> = facts.iter().map(|f| f.spread).collect();
    let mut noise = Noise::typical(&base.plant.robot, &spread, random.uniform(0.01, 0.02), random.chance(0.5));
    if wish.level.has_decoys() {
        noise.coloured = spread.iter().map(|s| 0.02 * s).collect();
    }
    let bench = Bench::new(&base, &noise, &references, &silent, wish)?;
    let scene = Scene { plant: &base.plant, facts: &facts, speeds: &speeds(&silent[0]) };
    let (concealed, has_patient, traces) = conceal(wish, (&base, &references), (&bench, &scene), &mut random)?;
    let noise = noise.times(wish.noise);
    let mut stream = Stream::new(wish.seed, wish.number, "sensors");
    let mut taken: Vec<Recording> = traces.iter().map(|t| noise.record(t, &mut stream)).collect();
    let knowing = base.plant.weighing(base.machine.plant.robot.clone());
    let judged = &silent[HOLDOUT];
    let floor = left_share(&knowing, judged, &noise.record(judged, &mut stream), &BANDS)?;
    let robot = if wish.level.is_refitted() {
        let learnt: Vec<(&Trace, &Recording)> = traces.iter().zip(&taken).take(taken.len() - 1).collect();
        refit(&base.plant, &learnt, bench.weights())?
    } else {
        base.plant.robot.clone()
    };
    if wish.level == Level::L7 {
        for r in &mut taken {
            let mishap = [Mishap::Garbage, Mishap::Dropouts, Mishap::Gaps][random.index(3)];
            r.spoil(mishap, &mut random);
        }
    }
    let answer = Answer {
        schema: "pkm.trial/1".to_string(),
        salt: (0..4).map(|_| format!("{:016x}", random.bits())).collect(),
        level: wish.level,
        robot: wish.robot.clone(),
        concealed: concealed.iter().map(told).collect(),
        has_patient,
        noise_factor: Some(wish.noise),
        recordings: Some(taken.len() - 1),
        floor,
    };
    Ok(Case { files: files(wish, &robot, &taken, &concealed)?, answer })
}

/// What is concealed, whether a patient moves, and the recordings' motions with it. What suits two motions may be too much for the third, whose
/// loops then do not close: something else is drawn in its place.
fn conceal(
    wish: &Wish,
    (base, references): (&Base, &[Reference]),
    (bench, scene): (&Bench<'_>, &Scene<'_>),
    random: &mut Stream,
) -> Result<(Vec<Found>, bool, Vec<Trace>), RobotError> {
    drawn(|| {
        let concealed = bench.conceal(wish, scene, random)?;
        let has_patient = wish.level == Level::L7 && random.chance(0.5);
        let patient = has_patient.then_some(&scene.facts[0]);
        let traces = perform((base, references), (wish, &concealed), patient, random)?;
        Ok((concealed, has_patient, traces))
    })
}

/// The recordings' motions with everything concealed.
fn perform(
    (base, references): (&Base, &[Reference]),
    (wish, concealed): (&Wish, &[Found]),
    patient: Option<&Fact>,
    random: &mut Stream,
) -> Result<Vec<Trace>, RobotError> {
    let push = restless(random);
    let mut out = Vec::new();
    for r in recorded(wish) {
        let mut machine = base.machine.clone();
        for found in concealed {
            found.choice.put_on(&mut machine, found.amount, r)?;
        }
        if let Some(fact) = patient {
            let link = base.plant.robot.end();
            let point = base.plant.robot.joints[link].inertia.centre();
            machine.hands.push(Hand { link, point, push: Push::Restless { sines: push(0.05 * fact.spread, r) } });
        }
        out.push(run(&machine, &references[r])?);
    }
    Ok(out)
}

fn told(found: &Found) -> Concealed {
    Concealed {
        effect: found.choice.effect.clone(),
        place: found.choice.place.clone(),
        form: found.choice.form.to_string(),
        is_textbook: found.choice.is_textbook,
        size: Some(found.size),
        beside_refit: Some(found.share),
        effort_share: Some(found.effort),
        parameters: found.choice.parameters(found.amount),
    }
}

fn files(wish: &Wish, robot: &Robot, taken: &[Recording], concealed: &[Found]) -> Result<Vec<(String, String)>, RobotError> {
    let Some(shipped) = pkm_robots::find(&wish.robot) else { return Err(RobotError::Unknown(format!("no shipped robot {}", wish.robot))) };
    let urdf_name = shipped.urdf_name.rsplit('/').next().unwrap_or("robot.urdf");
    let urdf = if wish.level.is_refitted() { urdf_with(robot, shipped.urdf)? } else { shipped.urdf.to_string() };
    let is_commanded = concealed.iter().any(|f| ["saturation", "dead_zone"].contains(&f.choice.effect.as_str()));
    let metadata = [format!("tau = {}", if is_commanded { "commanded" } else { "measured" })];
    let mut out = vec![("robot.toml".to_string(), shipped.toml.to_string()), (urdf_name.to_string(), urdf)];
    let names: Vec<&str> = recorded(wish).into_iter().map(file_name).collect();
    for (name, recording) in names.iter().zip(taken) {
        out.push(((*name).to_string(), recording.csv(robot, &metadata)));
    }
    let learnt: Vec<String> = names[..names.len() - 1].iter().map(|n| format!("{n:?}")).collect();
    out.push(("case.toml".to_string(), format!("recordings = [{}]\nholdouts = [{:?}]\n", learnt.join(", "), names[names.len() - 1])));
    Ok(out)
}
