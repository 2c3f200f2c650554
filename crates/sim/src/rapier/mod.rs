//! DOC
mod build;
mod chains;
mod convert;
mod resistance;
mod shaft;
mod world;

use core::ops::Range;

use pkm_dyn::Data;
use pkm_dyn::effects::{Law, Robot};
use pkm_dyn::kinematics::{forward_kinematics, world_velocities};
use pkm_dyn::loops::{assemble, mobility, solve_positions, solve_velocities, walk_to};

use crate::error::SimError;
use crate::plant::{Plant, check};
use build::{Plan, refused};
use chains::{Coordinates, pose_and_motions, wrench_of};
use resistance::{At, Resistance, inertia_of_effects, resistance};
use shaft::Shaft;
use world::World;

/// Name in error messages.
const ENGINE: &str = "rapier";

/// A fastening that opens farther than this has torn `[m | rad]`.
const TORN: f64 = 1e-2;

/// Share of a joint's least inertia that friction may stop in one substep without looking at the velocity at its end.
const BEARABLE: f64 = 0.5;

/// How the engine is run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RapierOptions {
    /// Longest substep `[s]`; a step of the plant is divided into equal ones.
    pub substep: f64,
    /// Passes over all fastenings per substep.
    pub sweeps: usize,
    /// Speed over which dry friction changes its direction `[m/s | rad/s]`.
    pub smoothing: f64,
}

impl Default for RapierOptions {
    fn default() -> Self {
        Self { substep: 2.5e-4, sweeps: 32, smoothing: 1e-3 }
    }
}

impl RapierOptions {
    fn check(&self) -> Result<(), SimError> {
        let positive = |x: f64| x.is_finite() && x > 0.0;
        for (what, value, is_good) in [
            ("substep", self.substep, positive(self.substep)),
            ("smoothing", self.smoothing, positive(self.smoothing)),
            ("sweeps", self.sweeps as f64, self.sweeps > 0),
        ] {
            if !is_good {
                return Err(SimError::Scenario { what, value, limit: "must be finite and > 0" });
            }
        }
        Ok(())
    }
}

/// A robot with its effects in the engine rapier: free bodies, and fastenings between them that the engine solves for.
///
/// See the module for what it can represent and how well.
pub struct RapierPlant {
    robot: Robot,
    options: RapierOptions,
    data: Data,
    world: World,
    chains: Vec<Range<usize>>,
    parents: Vec<Option<usize>>,
    shafts: Vec<Shaft>,
    /// Joints with friction or an effect and without a shaft: in chains of several.
    resisting: Vec<usize>,
    coordinates: Coordinates,
    /// Drives' coordinates and velocities.
    q: Vec<f64>,
    v: Vec<f64>,
    /// Efforts of the drives in the last substep, and its length `[s]`.
    tau: Vec<f64>,
    h: f64,
    /// Effort the rigid model transmitted at each joint.
    load: Vec<f64>,
    /// Efforts at the coordinates in this substep.
    efforts: Vec<f64>,
    /// Widest gap so far.
    widest: f64,
    time: f64,
}

impl RapierPlant {
    /// The robot at rest at positions `q_act` of its drives `[m | rad]`, reached from its assembly without changing branch.
    ///
    /// # Errors
    /// As of [`crate::ReducedPlant::try_new`]; options that are not above zero; and what the engine has no means for: couplings, a body
    /// without mass or without inertia, rotor inertia of a joint across massless bodies.
    pub fn try_new(robot: Robot, q_act: &[f64], options: RapierOptions) -> Result<Self, SimError> {
        options.check()?;
        let model = &robot.model;
        let mut data = Data::new(model);
        let n = model.n_act();
        for closure in [assemble(model, &mut data), walk_to(model, &mut data, q_act)] {
            check(&closure, 0.0)?;
        }
        let tree = data.q.clone();
        let mobility = mobility(model, &mut data, &tree);
        if mobility != n || n == 0 || q_act.len() != n {
            return Err(SimError::Mobility { robot: model.name.clone(), mobility, drives: n });
        }
        forward_kinematics(model, &mut data, &tree);
        let plan = Plan::try_new(model, &data)?;
        let world = World::try_new(model, &data, &plan, options.sweeps)?;
        let shafts = shafts(&robot, &plan, &world)?;
        let resisting = (0..model.nv()).filter(|&j| resists(&robot, j) && !shafts.iter().any(|s| s.joint == j)).collect();
        let (chains, parents) = plan.chains.iter().map(|c| (c.joints.clone(), c.parent)).unzip();
        let (zero, nothing) = (vec![0.0; n], vec![0.0; model.nv()]);
        let coordinates = Coordinates::new(tree);
        let (q, v, tau) = (q_act.to_vec(), zero.clone(), zero);
        let (load, efforts) = (nothing.clone(), nothing);
        let (h, widest, time) = (0.0, 0.0, 0.0);
        Ok(Self { options, world, chains, parents, shafts, resisting, coordinates, q, v, tau, h, load, efforts, widest, time, data, robot })
    }

    /// The robot, effects included.
    #[must_use]
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Tree coordinates now `[m | rad]`, read off the engine's bodies.
    #[must_use]
    pub fn tree_position(&self) -> &[f64] {
        &self.coordinates.q
    }

    /// Sets the velocities of the drives `[m/s | rad/s]`: a start in motion.
    ///
    /// # Errors
    /// Loops that do not close.
    pub fn set_velocity(&mut self, v_act: &[f64]) -> Result<(), SimError> {
        let Self { robot, data, world, coordinates, shafts, .. } = self;
        let model = &robot.model;
        data.q.copy_from_slice(&coordinates.q);
        check(&solve_positions(model, data, &self.q), self.time)?;
        solve_velocities(model, data, v_act);
        let (q, v) = (data.q.clone(), data.v.clone());
        forward_kinematics(model, data, &q);
        world_velocities(model, data, &v);
        world.start(data);
        coordinates.v_middle.copy_from_slice(&v);
        coordinates.a.fill(0.0);
        for shaft in shafts {
            shaft.rotor = v[shaft.joint];
        }
        self.v.copy_from_slice(v_act);
        // Nothing came before: the first push then acts for half a substep only.
        self.h = 0.0;
        Ok(())
    }

    /// Kinetic and potential energy of the rigid robot in the engine, rotors included `[J]`; springs and drives are not counted.
    #[must_use]
    pub fn energy(&self) -> f64 {
        let since = 0.5 * self.h;
        let of = |s: &Shaft| {
            let v = self.coordinates.velocity(s.joint, since);
            0.5 * s.inertia * v * v
        };
        self.world.energy(since) + self.shafts.iter().map(of).sum::<f64>()
    }

    /// How far any fastening was open after any substep so far `[m | rad]`: joints of the tree and of the loops alike.
    #[must_use]
    pub fn widest_gap(&self) -> f64 {
        self.widest
    }

    /// One substep of `h` `[s]`.
    ///
    /// Leapfrog: velocities live in the middle of substeps, efforts at their ends, where they push for half of the substep before and half
    /// of the one to come. The engine knows only whole ones, so the first push after a start is scaled down.
    fn advance(&mut self, tau: &[f64], h: f64) -> Result<(), SimError> {
        let (since, kick) = (0.5 * self.h, 0.5 * (self.h + h));
        self.efforts.fill(0.0);
        for (k, &j) in self.robot.model.actuators.iter().enumerate() {
            // Efforts are constant over a step of the plant: at its ends, the mean of both sides.
            self.efforts[j] = 0.5 * (self.h * self.tau[k] + h * tau[k]) / kick;
        }
        let drives = self.efforts.clone();
        self.resist(h, kick, since);
        self.push();
        self.world.step(h, kick, since);
        let Self { robot, world, chains, parents, coordinates, shafts, load, .. } = self;
        let relative = |c: usize| world.pose(parents[c]).inverse().compose(&world.pose(Some(chains[c].end - 1)));
        coordinates.follow(&robot.model, chains, relative, [h, kick]);
        for shaft in shafts.iter_mut() {
            let kind = robot.model.joints[shaft.joint].kind;
            let spent = shaft.settle(world.row_impulse(shaft.fastening, kind), kick);
            // What the drive supplies beyond all else that the joint takes, the rigid model transmits.
            if robot.model.actuators.contains(&shaft.joint) {
                load[shaft.joint] = drives[shaft.joint] - spent;
            }
        }
        self.tau.copy_from_slice(tau);
        self.h = h;
        self.time += h;
        self.sound()
    }

    /// Efforts of friction and effects: those of shafts as rows of the engine and what is left of them, all others as they are.
    fn resist(&mut self, h: f64, kick: f64, since: f64) {
        let Self { robot, world, coordinates, shafts, resisting, efforts, load, options, .. } = self;
        for shaft in shafts {
            let j = shaft.joint;
            let at = At { q: coordinates.q[j], v: coordinates.velocity(j, since), load: load[j] };
            let bearable = BEARABLE * shaft.least / kick;
            let felt = if shaft.resists { resistance(robot, j, at, options.smoothing, bearable) } else { Resistance::default() };
            efforts[j] -= felt.effort;
            let row = shaft.load(felt, at.v, kick);
            world.set_row(shaft.fastening, robot.model.joints[j].kind, row, h);
        }
        for &j in resisting.iter() {
            let at = At { q: coordinates.q[j], v: coordinates.velocity(j, since), load: load[j] };
            let effort = resistance(robot, j, at, options.smoothing, f64::MAX).effort;
            load[j] = if robot.model.actuators.contains(&j) { efforts[j] - effort } else { 0.0 };
            efforts[j] -= effort;
        }
    }

    /// Efforts at the coordinates become wrenches on bodies.
    fn push(&mut self) {
        let Self { robot, world, chains, parents, coordinates, efforts, .. } = self;
        for (joints, parent) in chains.iter().zip(parents) {
            if efforts[joints.clone()].iter().any(|e| *e != 0.0) {
                let (_, columns) = pose_and_motions(&robot.model, joints, &coordinates.q);
                world.push(joints.end - 1, *parent, &wrench_of(&columns, &efforts[joints.clone()]));
            }
        }
    }

    fn sound(&mut self) -> Result<(), SimError> {
        if self.coordinates.v_middle.iter().any(|v| !v.is_finite()) {
            return Err(SimError::Diverged { time: self.time });
        }
        let (gap, name) = self.world.gap();
        self.widest = self.widest.max(gap);
        if gap.is_nan() || gap > TORN {
            return Err(SimError::Torn { time: self.time, joint: name.to_string(), gap, limit: TORN });
        }
        Ok(())
    }
}

/// Whether joint `j` has friction or an effect.
fn resists(robot: &Robot, j: usize) -> bool {
    let joint = &robot.model.joints[j];
    let has_effect = robot.effects.iter().any(|e| e.place == j && matches!(e.entry.law, Law::JointEffort(_)));
    joint.viscous > 0.0 || joint.coulomb > 0.0 || has_effect
}

/// Joints with rotor inertia, friction or an effect that a fastening of their own leaves free.
fn shafts(robot: &Robot, plan: &Plan, world: &World) -> Result<Vec<Shaft>, SimError> {
    let mut out = Vec::new();
    for (j, joint) in robot.model.joints.iter().enumerate() {
        let added = inertia_of_effects(robot, j);
        let (has_rotor, resists) = (joint.armature + added != 0.0, resists(robot, j));
        match plan.fastenings.iter().position(|f| f.joint == Some(j)) {
            Some(f) if resists || has_rotor => {
                out.push(Shaft::new([j, f], [joint.armature, added, world.free_inertia(f, joint.kind)], resists));
            }
            None if has_rotor => {
                return Err(refused(&format!("rotor inertia of joint {:?}", joint.name), "a body next to it has no mass"));
            }
            _ => {}
        }
    }
    Ok(out)
}

impl Plant for RapierPlant {
    fn position(&self) -> &[f64] {
        &self.q
    }

    fn velocity(&self) -> &[f64] {
        &self.v
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a whole number, at least 1")]
    fn step(&mut self, tau: &[f64], h: f64) -> Result<(), SimError> {
        // A step that is a whole number of substeps but for rounding stays one.
        let parts = (h / self.options.substep - 1e-6).ceil().max(1.0);
        for _ in 0..parts as usize {
            self.advance(tau, h / parts)?;
        }
        for (k, &j) in self.robot.model.actuators.iter().enumerate() {
            self.q[k] = self.coordinates.q[j];
            self.v[k] = self.coordinates.velocity(j, 0.5 * self.h);
        }
        Ok(())
    }
}
