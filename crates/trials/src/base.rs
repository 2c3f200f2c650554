//! What every machine of a case begins from: the nominal robot, the healthy true one, and the motions.

use crate::case::{Level, Wish};
use crate::laws::{Chain, Dry, Encoder, Friction, Resist};
use crate::machine::{Machine, Resistance, Trace};
use crate::menu::Fact;
use crate::plant::Plant;
use crate::random::Stream;
use crate::reference::{Path, Reference, STEP, drive_ratio};
use crate::residual::FADES;
use crate::robot::{Robot, RobotError};

/// Every fourth step is recorded: 250 samples per second.
const EVERY: usize = 4;

/// Integration steps per step of the reference, where no law asks for more.
const SUBSTEPS: usize = 2;

/// A recording: name, period `[s]`, how often it comes, and share of the robot's room that it uses.
struct Motion {
    name: &'static str,
    period: f64,
    times: f64,
    share: f64,
}

/// Recordings to learn from, every second one slow, and the one to judge on.
const MOTIONS: [Motion; 5] = [
    Motion { name: "A.csv", period: 4.0, times: 3.0, share: 1.0 },
    Motion { name: "B.csv", period: 8.0, times: 2.0, share: 0.9 },
    Motion { name: "C.csv", period: 4.0, times: 3.0, share: 1.0 },
    Motion { name: "D.csv", period: 8.0, times: 2.0, share: 0.9 },
    Motion { name: "V.csv", period: 5.0, times: 2.0, share: 0.85 },
];

/// Number of the recording to judge on.
pub const HOLDOUT: usize = MOTIONS.len() - 1;

/// Name of a recording's file.
#[must_use]
pub fn file_name(recording: usize) -> &'static str {
    MOTIONS[recording.min(HOLDOUT)].name
}

/// What every machine of a case begins from.
#[derive(Debug, Clone)]
pub struct Base {
    /// The nominal robot.
    pub plant: Plant,
    /// The true robot with nothing concealed.
    pub machine: Machine,
    room: [Vec<f64>; 2],
    pace: f64,
}

impl Base {
    /// The robot of a case; the streams of the case decide about decoys and about the laws of its friction.
    ///
    /// # Errors
    /// A robot that cannot be read or does not assemble.
    pub fn new(wish: &Wish) -> Result<Self, RobotError> {
        let mut random = Stream::new(wish.seed, wish.number, "base");
        let mut plant = Plant::new(Robot::shipped(&wish.robot)?)?;
        let mut truth = plant.robot.clone();
        if wish.level.has_decoys() {
            for j in &mut truth.joints {
                j.inertia = j.inertia.times(1.0 + random.uniform(-0.05, 0.05));
                j.viscous *= 1.0 + random.uniform(-0.05, 0.05);
                j.coulomb *= 1.0 + random.uniform(-0.05, 0.05);
            }
        }
        let machine = healthy(plant.weighing(truth), wish, &mut random)?;
        plant.robot.drives.iter().zip(&machine.friction).for_each(|(d, f)| plant.turns[d.joint] = Some(f.dry));
        // Rotations of a foot are slow: speeds of the legs are limited.
        let pace = if ["ups4", "motobotte"].contains(&wish.robot.as_str()) { 2.0 } else { 1.0 };
        Ok(Self { room: room(&wish.robot, &plant), plant, machine, pace })
    }

    /// A motion of the design of recording number `recording` with random phases.
    ///
    /// # Errors
    /// When the robot cannot follow it.
    pub fn reference(&self, recording: usize, random: &mut Stream) -> Result<Reference, RobotError> {
        let motion = &MOTIONS[recording.min(HOLDOUT)];
        let period = motion.period * self.pace;
        let [centre, reach] = &self.room;
        let reach: Vec<f64> = reach.iter().map(|r| r * motion.share).collect();
        let path = Path::random(centre, &reach, (period, 5), random);
        let times = if self.pace > 1.0 { motion.times.min(2.0) } else { motion.times };
        Reference::inside_limits(&self.plant, &path, period * times)
    }

    /// As [`Self::reference`] with what the healthy robot does along it. A soft controller lets a robot sag so far from some motions that its loops do
    /// not close: another is drawn in their place.
    ///
    /// # Errors
    /// When the robot cannot follow any of several.
    pub fn followed(&self, recording: usize, random: &mut Stream) -> Result<(Reference, Trace), RobotError> {
        drawn(|| self.reference(recording, random).and_then(|r| run(&self.machine, &r).map(|trace| (r, trace))))
    }
}

/// Draws of something that a robot may fail to move with, at most.
const DRAWS: usize = 20;

/// What `draw` comes to when it first succeeds.
///
/// # Errors
/// The last of [`DRAWS`] errors.
pub(crate) fn drawn<T>(mut draw: impl FnMut() -> Result<T, RobotError>) -> Result<T, RobotError> {
    for _ in 1..DRAWS {
        if let Ok(it) = draw() {
            return Ok(it);
        }
    }
    draw()
}

/// What `machine` does along `reference`, at the rate of the recordings.
///
/// # Errors
/// Where a loop opens or the motion runs away.
pub fn run(machine: &Machine, reference: &Reference) -> Result<Trace, RobotError> {
    machine.run(reference, EVERY)
}

/// Middle of the motion and largest excursions from it, per free coordinate.
fn room(robot: &str, plant: &Plant) -> [Vec<f64>; 2] {
    let home: Vec<f64> = plant.free.iter().map(|&j| plant.home[j]).collect();
    match robot {
        "prs3" => [vec![0.15; 3], vec![0.07; 3]],
        "motobotte" => [vec![0.0515], vec![0.035]],
        "ups3_rpu1" => [home, vec![0.035; 4]],
        "five_bar" => [home, vec![0.5; 2]],
        "ups4" => [home, vec![0.22, 0.16, 0.18]],
        _ => [vec![0.2, 0.3, -0.2, 0.3, 0.4, 0.2], vec![0.9, 0.5, 0.6, 1.0, 0.8, 1.2]],
    }
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
        for (law, size) in [(Resist::Viscous, j.viscous), (Resist::Coulomb { speed: FADES * j.speed }, j.coulomb)] {
            if size > 0.0 {
                out.push(Resistance { joint, other: joint, law, size });
            }
        }
    }
    out
}

/// What the drives do in the healthy robot: in the first recording, and how far they go in any. Friction that is positive along one recording's
/// stroke may push beyond it.
///
/// # Errors
/// A robot without inertia.
pub fn facts(plant: &Plant, traces: &[Trace]) -> Result<Vec<Fact>, RobotError> {
    let inertia = felt_inertia(plant)?;
    let trace = &traces[0];
    let n = trace.t.len() as f64;
    let fact = |k: usize| {
        let mean = |x: &[Vec<f64>]| x.iter().map(|r| r[k]).sum::<f64>() / n;
        let spread = |x: &[Vec<f64>]| (x.iter().map(|r| (r[k] - mean(x)) * (r[k] - mean(x))).sum::<f64>() / n).sqrt();
        let readings = traces.iter().flat_map(|t| &t.reading);
        let ends = readings.fold([f64::INFINITY, f64::NEG_INFINITY], |e, r| [e[0].min(r[k]), e[1].max(r[k])]);
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

/// Root mean square of the velocity of every joint `[m/s | rad/s]`.
#[must_use]
pub fn speeds(trace: &Trace) -> Vec<f64> {
    let n = trace.truth.first().map_or(0, Vec::len);
    let dt = trace.t[1] - trace.t[0];
    let square = |j: usize| trace.truth.windows(2).map(|w| (w[1][j] - w[0][j]) * (w[1][j] - w[0][j])).sum::<f64>();
    (0..n).map(|j| (square(j) / trace.t.len() as f64).sqrt() / dt).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::MEASURED;

    #[test]
    fn a_motion_that_a_soft_robot_cannot_hold_is_drawn_anew() {
        let robot = "ups3_rpu1".to_string();
        let wish = Wish { number: 33, seed: 9302, level: Level::L0, robot, size: 2.0, noise: 1.0, recordings: MEASURED, effect: None };
        let base = Base::new(&wish).expect("a robot that comes with the project");
        let stream = || Stream::new(wish.seed, wish.number, "ruler");
        let first = base.reference(0, &mut stream()).expect("the nominal robot follows every motion");
        assert!(run(&base.machine, &first).is_err(), "its loops open");
        let (second, trace) = base.followed(0, &mut stream()).expect("one of the next ones");
        assert_ne!(first, second);
        assert!(trace.reading.iter().flatten().all(|q| q.is_finite()));
        // How far the drives go is told of all motions, so that a law over the stroke covers each.
        let (_, longer) = base.followed(1, &mut Stream::new(1, 1, "other")).expect("it moves");
        let traces = [trace, longer];
        for (k, fact) in facts(&base.plant, &traces).expect("it weighs something").iter().enumerate() {
            let within = |r: &Vec<f64>| (r[k] - fact.centre).abs() <= fact.reach * (1.0 + 1e-9);
            assert!(traces.iter().flat_map(|t| &t.reading).all(within), "drive {k}");
        }
    }
}
