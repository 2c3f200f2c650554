//! Plants under one PD controller along one motion: what the tests compare and the table of accuracy is made of.

use core::f64::consts::TAU;

use pkm_dyn::effects::Robot;
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{assemble, mid_pose, walk_to};
use pkm_dyn::math::{cos, sin};
use pkm_dyn::model::Model;
use pkm_dyn::urdf::parse;
use pkm_dyn::{Data, loops};
use pkm_sim::{Plant, RapierOptions, RapierPlant, ReducedPlant};

/// Period of the controller `[s]`.
pub(crate) const PERIOD: f64 = 1e-3;

/// Bandwidth `[rad/s]` and damping ratio of the loop.
const BANDWIDTH: f64 = 50.0;
const DAMPING: f64 = 0.9;

/// Share of half the travel that the motion uses.
const SHARE: f64 = 0.5;

/// The own plant's steps per period where it is the reference: its error is then below 1e-8 of a radian.
pub(crate) const REFERENCE_PARTS: u32 = 5;

/// A shipped robot's bare model.
pub(crate) fn shipped(name: &str) -> Model {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("shipped robots load").bare
}

/// The same without friction.
pub(crate) fn frictionless(name: &str) -> Model {
    let mut model = shipped(name);
    for joint in &mut model.joints {
        (joint.viscous, joint.coulomb) = (0.0, 0.0);
    }
    model
}

/// Sines of all drives about the middle of their travel, and gains.
pub(crate) struct Loop {
    pub(crate) middle: Vec<f64>,
    amplitude: Vec<f64>,
    mass: Vec<f64>,
}

impl Loop {
    /// Gains are scaled with the inertia at the middle of travel.
    pub(crate) fn new(model: &Model) -> Self {
        let middle = mid_pose(model);
        let travel = |&j: &usize| 0.5 * (model.joints[j].limits.upper - model.joints[j].limits.lower);
        let amplitude = model.actuators.iter().map(|j| SHARE * travel(j).min(0.8)).collect();
        let mut data = Data::new(model);
        assert!(assemble(model, &mut data).is_closed && walk_to(model, &mut data, &middle).is_closed);
        let zero = vec![0.0; middle.len()];
        let mut effort = |a: &[f64], k: usize| {
            assert!(inverse_dynamics(model, &mut data, &middle, &zero, a).is_closed);
            data.tau_act[k]
        };
        let mass = (0..middle.len()).map(|k| {
            let mut unit = zero.clone();
            unit[k] = 1.0;
            effort(&unit, k) - effort(&zero, k)
        });
        Self { mass: mass.collect(), middle, amplitude }
    }

    /// Position and velocity that drive `k` shall have at `t`: it begins at rest.
    fn reference(&self, k: usize, t: f64) -> [f64; 2] {
        let (a, w) = (self.amplitude[k], TAU * (0.25 + 0.07 * k as f64));
        [self.middle[k] + 0.5 * a * (1.0 - cos(w * t)), 0.5 * a * w * sin(w * t)]
    }

    fn efforts(&self, plant: &dyn Plant, t: f64) -> Vec<f64> {
        let one = |k: usize| {
            let [q, v] = self.reference(k, t);
            let (eq, ev) = (q - plant.position()[k], v - plant.velocity()[k]);
            self.mass[k] * (BANDWIDTH * BANDWIDTH * eq + 2.0 * DAMPING * BANDWIDTH * ev)
        };
        (0..self.middle.len()).map(one).collect()
    }

    /// Runs for some seconds under the controller, in `parts` steps of the plant per period.
    pub(crate) fn run(&self, plant: &mut dyn Plant, seconds: u32, parts: u32) -> Run {
        let efforts = |k: u32, plant: &dyn Plant| self.efforts(plant, PERIOD * f64::from(k));
        through(plant, seconds, parts, efforts)
    }
}

/// Positions of the drives after every period, and the efforts during it.
pub(crate) struct Run {
    pub(crate) positions: Vec<Vec<f64>>,
    pub(crate) efforts: Vec<Vec<f64>>,
}

fn through(plant: &mut dyn Plant, seconds: u32, parts: u32, efforts: impl Fn(u32, &dyn Plant) -> Vec<f64>) -> Run {
    let mut out = Run { positions: Vec::new(), efforts: Vec::new() };
    for k in 0..seconds * 1000 {
        let tau = efforts(k, plant);
        for _ in 0..parts {
            plant.step(&tau, PERIOD / f64::from(parts)).expect("the motion goes on");
        }
        out.positions.push(plant.position().to_vec());
        out.efforts.push(tau);
    }
    out
}

/// The efforts of another run, played back without a controller.
pub(crate) fn play_back(plant: &mut dyn Plant, of: &Run, seconds: u32) -> Run {
    through(plant, seconds, 1, |k, _| of.efforts[k as usize].clone())
}

/// Largest difference of any drive's position between two runs `[m | rad]`.
pub(crate) fn apart(a: &Run, b: &Run) -> f64 {
    a.positions.iter().flatten().zip(b.positions.iter().flatten()).fold(0.0, |top, (a, b)| top.max((a - b).abs()))
}

/// The own plant at the start of the motion.
pub(crate) fn own(robot: &Robot, at: &Loop) -> ReducedPlant {
    ReducedPlant::try_new(robot.clone(), &at.middle).expect("the loops close")
}

/// The engine's plant there.
pub(crate) fn foreign(robot: &Robot, at: &Loop, options: RapierOptions) -> RapierPlant {
    RapierPlant::try_new(robot.clone(), &at.middle, options).expect("the engine can represent the robot")
}

/// Largest gap of the loops with the tree coordinates as the engine has them `[m | rad]`.
pub(crate) fn loops_open(model: &Model, q: &[f64]) -> f64 {
    let mut data = Data::new(model);
    loops::loop_gap(model, &mut data, q);
    data.loop_gap.iter().fold(0.0, |top, gap| top.max(gap.abs()))
}
