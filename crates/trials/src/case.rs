//! One case: a robot, a level of concealment, what is concealed and how large, and the recordings of it.

use nalgebra::DVector;
use serde::{Deserialize, Serialize};

use crate::laws::{Chain, Dry, Encoder, Friction, Resist};
use crate::machine::{Hand, Machine, Push, Resistance, Trace};
use crate::menu::{Choice, Fact, INSIDE, OUTSIDE, Parameter, Scene, choose, restless};
use crate::plant::Plant;
use crate::random::Stream;
use crate::reference::{Path, Reference, STEP, drive_ratio};
use crate::refit::{left_share, refit};
use crate::residual::{BAND, Residual, Ruler, residual};
use crate::robot::{Robot, RobotError, urdf_with};
use crate::sensing::{Mishap, Noise, Recording};

/// An effect of size one stands out of the noise by this many standard deviations.
pub const Z: f64 = 4.0;

/// Below this share beside the basis, an effect is one that a refit swallows.
pub const INSIDE_SPAN: f64 = 0.05;

/// Effects that a refit swallows whole, whatever the ruler finds beside it: stick at reversals moves, and that alone can be 5 %.
const SWALLOWED: [&str; 4] = ["friction_viscous", "friction_coulomb", "inertia_error", "payload"];

/// Robots of the trials.
pub const ROBOTS: [&str; 5] = ["prs3", "serial_arm", "motobotte", "ups3_rpu1", "five_bar"];

/// Robots that cases can be made of on request: with more drives than freedoms, or like one of the others.
pub const MORE: [&str; 1] = ["ups4"];

/// Every fourth step is recorded: 250 samples per second.
const EVERY: usize = 4;

/// Integration steps per step of the reference, where no law asks for more.
const SUBSTEPS: usize = 2;

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
    /// A certain effect in place of a random one.
    pub effect: Option<String>,
}

impl Wish {
    /// The wish with that number: robots, levels and sizes in turn, all combinations in the long run.
    #[must_use]
    pub fn of(number: u64, seed: u64, (levels, robots): (&[Level], &[String]), sizes: &[f64]) -> Self {
        let mut random = Stream::new(seed, number, "wish");
        let turn: Vec<Level> = Level::TURN.into_iter().filter(|l| levels.contains(l)).collect();
        // One further after every full turn of levels and robots: all pairs come about.
        let names: Vec<&str> = if robots.is_empty() { ROBOTS.to_vec() } else { robots.iter().map(String::as_str).collect() };
        let robot = names[usize::try_from((number + number / 60) % names.len() as u64).unwrap_or(0)];
        let level = turn[usize::try_from(number % turn.len().max(1) as u64).unwrap_or(0)];
        Self { number, seed, level, robot: robot.to_string(), size: *random.choose(sizes).unwrap_or(&1.0), effect: None }
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

/// What every machine of a case begins from.
struct Base {
    plant: Plant,
    machine: Machine,
    references: Vec<Reference>,
}

/// Largest excursions from the middle of the motion, and that middle, per free coordinate.
fn room(robot: &str, plant: &Plant) -> (Vec<f64>, Vec<f64>) {
    let home: Vec<f64> = plant.free.iter().map(|&j| plant.home[j]).collect();
    match robot {
        "prs3" => (vec![0.15; 3], vec![0.07; 3]),
        "motobotte" => (vec![0.0515], vec![0.035]),
        "ups3_rpu1" => (home, vec![0.035; 4]),
        "five_bar" => (home, vec![0.5; 2]),
        "ups4" => (home, vec![0.22, 0.16, 0.18]),
        _ => (vec![0.2, 0.3, -0.2, 0.3, 0.4, 0.2], vec![0.9, 0.5, 0.6, 1.0, 0.8, 1.2]),
    }
}

/// Periods `[s]` of the recordings, and how often they come: two to learn from, the second slow, one to judge on.
const PERIODS: [(f64, f64); 3] = [(4.0, 3.0), (8.0, 2.0), (5.0, 2.0)];

/// Rotations of a foot are slow: speeds of the legs are limited.
fn pace(robot: &str) -> f64 {
    match robot {
        "ups4" | "motobotte" => 2.0,
        _ => 1.0,
    }
}

fn base(wish: &Wish) -> Result<Base, RobotError> {
    let mut random = Stream::new(wish.seed, wish.number, "base");
    let plant = Plant::new(Robot::shipped(&wish.robot)?)?;
    let mut truth = plant.robot.clone();
    if wish.level.has_decoys() {
        for j in &mut truth.joints {
            j.inertia = j.inertia.times(1.0 + random.uniform(-0.05, 0.05));
            j.viscous *= 1.0 + random.uniform(-0.05, 0.05);
            j.coulomb *= 1.0 + random.uniform(-0.05, 0.05);
        }
    }
    let (centre, reach) = room(&wish.robot, &plant);
    let mut references = Vec::new();
    for (i, (period, times)) in PERIODS.into_iter().enumerate() {
        let period = period * pace(&wish.robot);
        let path = Path::random(&centre, &reach.iter().map(|r| r * [1.0, 0.9, 0.85][i]).collect::<Vec<_>>(), (period, 5), &mut random);
        references.push(Reference::inside_limits(&plant, &path, period * if pace(&wish.robot) > 1.0 { times.min(2.0) } else { times })?);
    }
    let machine = healthy(plant.weighing(truth), wish, &mut random)?;
    Ok(Base { plant, machine, references })
}

/// Inertia that each drive feels with the others free.
fn felt_inertia(plant: &Plant) -> Result<Vec<f64>, RobotError> {
    let mut q = plant.home.clone();
    let m = plant.moving(&mut q, &vec![0.0; plant.freedoms()])?;
    let ratio = drive_ratio(plant, &m);
    let inverse = m.mass.try_inverse().ok_or_else(|| RobotError::Unknown("a robot without inertia".to_string()))?;
    let mobility = &ratio * inverse * ratio.transpose();
    Ok((0..ratio.nrows()).map(|k| 1.0 / mobility[(k, k)].max(1e-12)).collect())
}

fn healthy(plant: Plant, wish: &Wish, random: &mut Stream) -> Result<Machine, RobotError> {
    let inertia = felt_inertia(&plant)?;
    let n = plant.robot.drives.len();
    let bandwidth = core::f64::consts::TAU * if wish.level == Level::L0 { 1.0 } else { 5.0 };
    let mut friction = Vec::new();
    for (k, d) in plant.robot.drives.iter().enumerate() {
        let j = &plant.robot.joints[d.joint];
        // Bristles so stiff that their bending is lost in the noise, yet soft enough for the step.
        let stiffness = inertia[k] * 300.0 * 300.0;
        let reach = (j.coulomb / stiffness).max(1e-9);
        // As narrow as the step allows: a friction that fades early is physics of its own.
        let speed = (0.7 * STEP / SUBSTEPS as f64 * j.coulomb / inertia[k]).max(0.002 * j.speed);
        let dry = match random.index(3) {
            0 => Dry::Bristles { reach, damping: 0.7 * inertia[k] * 300.0 },
            1 => Dry::Band { speed },
            _ => Dry::Root { speed },
        };
        friction.push(Friction { dry, coulomb: j.coulomb, viscous: j.viscous, peak: [0.0; 3] });
    }
    let hold = if wish.level.has_decoys() { 0.5e-3 } else { 0.0 };
    Ok(Machine {
        friction,
        resistances: passive(&plant),
        flex: vec![None; n],
        chains: vec![Chain { delay: hold, ..Chain::IDEAL }; n],
        encoders: vec![Encoder::IDEAL; n],
        drift: vec![0.0; n],
        hands: Vec::new(),
        felt: Vec::new(),
        rock: None,
        gains: inertia.iter().map(|m| [m * bandwidth * bandwidth, 2.0 * m * bandwidth]).collect(),
        substeps: SUBSTEPS,
        plant,
    })
}

/// Friction that the robot's file gives to joints without a drive.
fn passive(plant: &Plant) -> Vec<Resistance> {
    let is_driven = |i: usize| plant.robot.drives.iter().any(|d| d.joint == i);
    let mut out = Vec::new();
    for (joint, j) in plant.robot.joints.iter().enumerate().filter(|(i, _)| !is_driven(*i)) {
        for (law, size) in [(Resist::Viscous, j.viscous), (Resist::Coulomb { speed: 0.01 * j.speed }, j.coulomb)] {
            if size > 0.0 {
                out.push(Resistance { joint, other: joint, law, size });
            }
        }
    }
    out
}

fn facts(plant: &Plant, trace: &Trace) -> Result<Vec<Fact>, RobotError> {
    let inertia = felt_inertia(plant)?;
    let n = trace.t.len() as f64;
    let fact = |k: usize| {
        let mean = |x: &[Vec<f64>]| x.iter().map(|r| r[k]).sum::<f64>() / n;
        let spread = |x: &[Vec<f64>]| (x.iter().map(|r| (r[k] - mean(x)) * (r[k] - mean(x))).sum::<f64>() / n).sqrt();
        let ends = trace.reading.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |e, r| [e[0].min(r[k]), e[1].max(r[k])]);
        Fact {
            spread: spread(&trace.effort),
            peak: trace.effort.iter().map(|r| r[k].abs()).fold(0.0, f64::max),
            centre: 0.5 * (ends[0] + ends[1]),
            reach: 0.5 * (ends[1] - ends[0]),
            speed: (trace.rate.iter().map(|r| r[k] * r[k]).sum::<f64>() / n).sqrt(),
            inertia: inertia[k],
        }
    };
    Ok((0..plant.robot.drives.len()).map(fact).collect())
}

/// Root mean square of the velocity of every joint.
fn speeds(trace: &Trace) -> Vec<f64> {
    let n = trace.truth.first().map_or(0, Vec::len);
    let dt = trace.t[1] - trace.t[0];
    let square = |j: usize| trace.truth.windows(2).map(|w| (w[1][j] - w[0][j]) * (w[1][j] - w[0][j])).sum::<f64>();
    (0..n).map(|j| (square(j) / trace.t.len() as f64).sqrt() / dt).collect()
}

/// What calibrates sizes: healthy residuals and the ruler over them.
struct Bench<'a> {
    base: &'a Base,
    noise: Noise,
    healthy: Vec<Residual>,
    ruler: Ruler,
}

impl Bench<'_> {
    /// Lengths, all and beside the basis, of what a choice of that size adds to the recordings that are learnt from.
    fn lengths(&self, choice: &Choice, size: f64) -> Result<[f64; 2], RobotError> {
        let mut column: Vec<DVector<f64>> = Vec::new();
        for (r, healthy) in self.healthy.iter().enumerate() {
            let mut machine = self.base.machine.clone();
            choice.put_on(&mut machine, size, r)?;
            let trace = machine.run(&self.base.references[r], EVERY)?;
            column.extend(residual(&self.base.plant, &trace, &self.noise.silent(&trace), BAND)?.minus(healthy));
        }
        Ok(self.ruler.lengths(&column))
    }

    /// Finds the size at which the effect stands out by `wanted`; returns it, what came out, and the share beside the basis.
    fn calibrate(&self, choice: &Choice, wanted: f64, may_be_inside: bool) -> Result<Option<[f64; 3]>, RobotError> {
        let mut size = choice.start;
        let mut known: Option<[f64; 2]> = None;
        let mut outcome = None;
        for _ in 0..6 {
            let Ok([all, beside]) = self.lengths(choice, size) else {
                // Too much for the robot: smaller.
                size *= 0.3;
                continue;
            };
            let share = beside / all.max(1e-300);
            let is_inside = share < INSIDE_SPAN;
            if is_inside && !may_be_inside {
                return Ok(None);
            }
            let length = if is_inside { all } else { beside } / Z;
            outcome = Some([size, length, share]);
            if (length / wanted - 1.0).abs() < 0.1 || length <= 0.0 {
                break;
            }
            // Locally a power of the size; between a third and three to begin with.
            let power = known.map_or(1.0, |[s, l]| {
                let p = crate::math::ln(length / l) / crate::math::ln(size / s);
                if p.is_finite() { p.clamp(0.3, 3.0) } else { 1.0 }
            });
            known = Some([size, length]);
            let next = (size * crate::math::pow(wanted / length, 1.0 / power)).clamp(size * 1e-3, size * 1e3).min(choice.cap);
            if (next / size - 1.0).abs() < 1e-6 {
                break;
            }
            size = next;
        }
        // Nothing that is nowhere near what was asked for; a cap may keep it smaller.
        Ok(outcome.filter(|[_, length, _]| *length > 0.2 * wanted && *length < 3.0 * wanted))
    }
}

/// Chooses effects and finds their sizes.
fn conceal(wish: &Wish, bench: &Bench<'_>, scene: &Scene<'_>, random: &mut Stream) -> Result<Vec<(Choice, [f64; 3])>, RobotError> {
    let count = match wish.level {
        Level::L4 => 2,
        level if level.is_healthy() => 0,
        _ => 1,
    };
    let mut out: Vec<(Choice, [f64; 3])> = Vec::new();
    for _ in 0..40 {
        if out.len() == count {
            return Ok(out);
        }
        let list: &[&str] = if wish.level == Level::L5 { &OUTSIDE } else { &INSIDE };
        let drawn = *random.choose(list).unwrap_or(&list[0]);
        let name = wish.effect.as_deref().unwrap_or(drawn);
        // Two effects must be two, and a base that rocks renumbers what others have been put on.
        let is_taken = out.iter().any(|(c, _)| c.effect == name) || (count > 1 && name == "structure_flexibility");
        let is_swallowed = wish.level.is_refitted() && SWALLOWED.contains(&name);
        let Some(choice) = (!is_taken && !is_swallowed).then(|| choose(name, scene, random)).flatten() else { continue };
        if let Some(found) = bench.calibrate(&choice, wish.size, !wish.level.is_refitted())? {
            out.push((choice, found));
        }
    }
    Err(RobotError::Unknown(format!("case {}: nothing could be concealed in {}", wish.number, wish.robot)))
}

/// Makes a case.
///
/// # Errors
/// When the robot cannot be read, cannot move, or nothing can be concealed in it.
pub fn make(wish: &Wish) -> Result<Case, RobotError> {
    let base = base(wish)?;
    let mut random = Stream::new(wish.seed, wish.number, "case");
    let silent: Vec<Trace> = base.references.iter().map(|r| base.machine.run(r, EVERY)).collect::<Result<_, _>>()?;
    let facts = facts(&base.plant, &silent[0])?;
    let spread: Vec<f64> = facts.iter().map(|f| f.spread).collect();
    let mut noise = Noise::typical(&base.plant.robot, &spread, random.uniform(0.01, 0.02), random.chance(0.5));
    if wish.level.has_decoys() {
        noise.coloured = spread.iter().map(|s| 0.02 * s).collect();
    }
    let bench = bench(&base, noise, &silent[..2], wish)?;
    let scene = Scene { plant: &base.plant, facts: &facts, speeds: &speeds(&silent[0]) };
    let concealed = conceal(wish, &bench, &scene, &mut random)?;
    let has_patient = wish.level == Level::L7 && random.chance(0.5);
    let traces = perform(&base, &concealed, has_patient.then_some(&facts[0]), &mut random)?;
    let mut stream = Stream::new(wish.seed, wish.number, "sensors");
    let mut taken: Vec<Recording> = traces.iter().map(|t| bench.noise.record(t, &mut stream)).collect();
    let knowing = base.plant.weighing(base.machine.plant.robot.clone());
    let floor = left_share(&knowing, &silent[2], &bench.noise.record(&silent[2], &mut stream), &BANDS)?;
    let robot = if wish.level.is_refitted() {
        refit(&base.plant, &[(&traces[0], &taken[0]), (&traces[1], &taken[1])], &bench.ruler.noise)?
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
        floor,
    };
    Ok(Case { files: files(wish, &robot, &taken, &concealed)?, answer })
}

fn bench<'a>(base: &'a Base, noise: Noise, silent: &[Trace], wish: &Wish) -> Result<Bench<'a>, RobotError> {
    let mut stream = Stream::new(wish.seed, wish.number, "ruler");
    let measure = |t: &Trace, r: &Recording| residual(&base.plant, t, r, BAND);
    let noisy = silent.iter().map(|t| measure(t, &noise.record(t, &mut stream))).collect::<Result<Vec<_>, _>>()?;
    let healthy = silent.iter().map(|t| measure(t, &noise.silent(t))).collect::<Result<Vec<_>, _>>()?;
    let ruler = Ruler::new(&base.plant, &noisy, &healthy);
    Ok(Bench { base, noise, healthy, ruler })
}

/// The recordings' motions with everything concealed.
fn perform(base: &Base, concealed: &[(Choice, [f64; 3])], patient: Option<&Fact>, random: &mut Stream) -> Result<Vec<Trace>, RobotError> {
    let push = restless(random);
    let mut out = Vec::new();
    for (r, reference) in base.references.iter().enumerate() {
        let mut machine = base.machine.clone();
        for (choice, [size, _, _]) in concealed {
            choice.put_on(&mut machine, *size, r)?;
        }
        if let Some(fact) = patient {
            let link = base.plant.robot.end();
            let point = base.plant.robot.joints[link].inertia.centre();
            machine.hands.push(Hand { link, point, push: Push::Restless { sines: push(0.05 * fact.spread, r) } });
        }
        out.push(machine.run(reference, EVERY)?);
    }
    Ok(out)
}

fn told((choice, [size, length, share]): &(Choice, [f64; 3])) -> Concealed {
    Concealed {
        effect: choice.effect.clone(),
        place: choice.place.clone(),
        form: choice.form.to_string(),
        is_textbook: choice.is_textbook,
        size: Some(*length),
        beside_refit: Some(*share),
        parameters: choice.parameters(*size),
    }
}

/// Names of the recordings; the last one is the holdout.
pub const RECORDINGS: [&str; 3] = ["A.csv", "B.csv", "V.csv"];

fn files(wish: &Wish, robot: &Robot, taken: &[Recording], concealed: &[(Choice, [f64; 3])]) -> Result<Vec<(String, String)>, RobotError> {
    let Some(shipped) = pkm_robots::find(&wish.robot) else { return Err(RobotError::Unknown(format!("no shipped robot {}", wish.robot))) };
    let urdf_name = shipped.urdf_name.rsplit('/').next().unwrap_or("robot.urdf");
    let urdf = if wish.level.is_refitted() { urdf_with(robot, shipped.urdf)? } else { shipped.urdf.to_string() };
    let is_commanded = concealed.iter().any(|(c, _)| ["saturation", "dead_zone"].contains(&c.effect.as_str()));
    let metadata = [format!("tau = {}", if is_commanded { "commanded" } else { "measured" })];
    let mut out = vec![("robot.toml".to_string(), shipped.toml.to_string()), (urdf_name.to_string(), urdf)];
    for (name, recording) in RECORDINGS.iter().zip(taken) {
        out.push(((*name).to_string(), recording.csv(robot, &metadata)));
    }
    let manifest = "recordings = [\"A.csv\", \"B.csv\"]\nholdouts = [\"V.csv\"]\n";
    out.push(("case.toml".to_string(), manifest.to_string()));
    Ok(out)
}
