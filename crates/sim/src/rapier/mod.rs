//! A second plant, in the foreign engine rapier3d-f64 (feature `rapier`): bodies that fly freely, and fastenings that hold them together.
//!
//! Built from the same [`pkm_dyn::Model`] as [`crate::ReducedPlant`] and started at the same pose, found by `pkm_dyn`'s own assembly. From
//! there on none of `pkm_dyn`'s dynamics and loop closures is used: what both plants agree on is not an error of one of them.
//!
//! # How the engine is used
//!
//! - Every body with mass is a rigid body. Every joint and every loop is one of the engine's impulse joints (a fastening, in here), which
//!   take bodies where they are. A universal joint, whose cross has no mass, is a ball and a point that stays on a plane.
//! - One substep per step of the engine (`num_solver_iterations` = 1): in further ones it keeps the inertias and efforts of the first. No
//!   stabilisation pass (`num_internal_stabilization_iterations` = 0): it takes out energy. Impulses start from those of the substep before
//!   (`warmstart_joints`). Bodies never sleep.
//! - Velocities live in the middle of substeps, efforts at their ends. The engine's `v += h·a(q)`, `q += h·v` is then a leapfrog of second
//!   order; it only has to be started with half a push, and be asked for velocities half a substep later than it has them.
//! - Its gyroscopic term is of first order, so it is off and `−ω×(I·ω)` comes from here.
//! - Efforts of drives and joints are wrenches on two bodies, opposite to each other. The engine's motors are neither drives nor springs here.
//! - Rotor inertia is the engine's motor row: inertia over substep is its factor, the rotor's own velocity its target, and the rotor gets what
//!   impulse it takes. That is implicit; a torque `−inertia·a` is unstable where a rotor is heavier than what it moves, as in most robots here.
//!
//! # What is different from the own plant
//!
//! - **No stiction.** Dry friction changes its direction as `tanh(v/smoothing)` ([`RapierOptions::smoothing`], 1 mm/s or 1 mrad/s): under
//!   less than its dry friction a joint creeps. What of it a substep cannot bear is taken implicitly, by the same row, so nothing chatters.
//! - Every [`Law::JointEffort`] acts; load-dependent friction takes the load of the substep before. Effects on inertia and gravity are in the
//!   model; those of actuators and sensors are not a plant's. Friction in a chain across massless bodies is explicit.
//! - Refused with [`SimError::NotRepresentable`]: couplings (there are no gears between its joints), massless bodies that are not inside a
//!   universal joint, gimbal, cylinder or table, bodies without inertia about some axis, rotor inertia next to a massless body.
//! - A fastening that opens by more than 1 cm or 0.01 rad ends the motion with [`SimError::Torn`].
//!
//! # Accuracy
//!
//! Largest difference of any drive `[m | rad]` from the own plant in steps of 0.2 ms: over 10 s under a PD controller at 1 kHz along sines over
//! half the travel, and over 1 s with the efforts of that run played back without a controller. The widest gap `[m | rad]` is of all fastenings,
//! loops and joints of the tree alike, after any substep. Time is the median `[µs]` per simulated millisecond, in the dev profile (dependencies
//! optimised) on a busy Xeon core. `cargo run -p pkm-sim --features rapier --example rapier_accuracy` measures all of it;
//! `cargo bench -p pkm-benches --bench plants` the speed alone.
//!
//! | robot | friction | plant | error under PD | error of playback, 1 s | widest gap | µs per ms |
//! |---|---|---|---|---|---|---|
//! | `five_bar` | none | own, 0.5 ms | 5.8e-9 | | | 2 |
//! | `five_bar` | none | 1 ms, 32 sweeps | 2.9e-6 | 5.9e-4 | 2.4e-8 | 13 |
//! | `five_bar` | none | 0.5 ms, 32 sweeps | 1.1e-7 | 2.9e-4 | 6.1e-9 | 29 |
//! | `five_bar` | none | 0.25 ms, 8 sweeps | 7.6e-6 | 2.1e-2 | 1.4e-7 | 32 |
//! | `five_bar` | none | 0.25 ms, 32 sweeps | 5.4e-8 | 1.5e-4 | 1.5e-9 | 57 |
//! | `five_bar` | none | 0.125 ms, 32 sweeps | 2.7e-8 | 7.4e-5 | 3.8e-10 | 117 |
//! | `five_bar` | as shipped | own, 0.5 ms | 6.9e-7 | | | 3 |
//! | `five_bar` | as shipped | 1 ms, 32 sweeps | 2.3e-4 | 2.0e-2 | 1.4e-7 | 16 |
//! | `five_bar` | as shipped | 0.5 ms, 32 sweeps | 6.0e-5 | 5.7e-3 | 3.0e-8 | 31 |
//! | `five_bar` | as shipped | 0.25 ms, 8 sweeps | 8.0e-4 | 2.1e-1 | 1.5e-7 | 34 |
//! | `five_bar` | as shipped | 0.25 ms, 32 sweeps | 3.9e-5 | 5.9e-3 | 4.9e-9 | 58 |
//! | `five_bar` | as shipped | 0.125 ms, 32 sweeps | 3.4e-5 | 6.4e-3 | 6.3e-10 | 124 |
//! | `serial_arm` | none | own, 0.5 ms | 6.0e-9 | | | 4 |
//! | `serial_arm` | none | 1 ms, 32 sweeps | 7.7e-6 | 6.1e-3 | 3.6e-6 | 22 |
//! | `serial_arm` | none | 0.5 ms, 32 sweeps | 4.0e-6 | 3.1e-3 | 9.1e-7 | 44 |
//! | `serial_arm` | none | 0.25 ms, 8 sweeps | 1.7e-5 | 1.3e-2 | 2.3e-6 | 47 |
//! | `serial_arm` | none | 0.25 ms, 32 sweeps | 2.1e-6 | 1.5e-3 | 2.3e-7 | 89 |
//! | `serial_arm` | none | 0.125 ms, 32 sweeps | 1.0e-6 | 7.7e-4 | 5.8e-8 | 177 |
//! | `serial_arm` | as shipped | own, 0.5 ms | 9.6e-8 | | | 5 |
//! | `serial_arm` | as shipped | 1 ms, 32 sweeps | 4.8e-4 | 3.7e-3 | 4.6e-6 | 22 |
//! | `serial_arm` | as shipped | 0.5 ms, 32 sweeps | 3.5e-4 | 2.0e-3 | 9.9e-7 | 46 |
//! | `serial_arm` | as shipped | 0.25 ms, 8 sweeps | 1.1e-3 | 6.0e-3 | 1.9e-6 | 48 |
//! | `serial_arm` | as shipped | 0.25 ms, 32 sweeps | 2.9e-5 | 1.2e-3 | 2.2e-7 | 92 |
//! | `serial_arm` | as shipped | 0.125 ms, 32 sweeps | 3.3e-5 | 8.8e-4 | 5.4e-8 | 177 |
//! | `prs3` | none | own, 0.5 ms | 3.7e-11 | | | 4 |
//! | `prs3` | none | 1 ms, 32 sweeps | 5.4e-7 | 2.5e-9 | 3.5e-7 | 23 |
//! | `prs3` | none | 0.5 ms, 32 sweeps | 1.6e-10 | 6.2e-10 | 8.8e-8 | 48 |
//! | `prs3` | none | 0.25 ms, 8 sweeps | 1.5e-8 | 1.5e-8 | 9.1e-8 | 51 |
//! | `prs3` | none | 0.25 ms, 32 sweeps | 3.8e-11 | 1.4e-10 | 2.2e-8 | 98 |
//! | `prs3` | none | 0.125 ms, 32 sweeps | 1.4e-11 | 1.9e-11 | 5.5e-9 | 189 |
//! | `prs3` | as shipped | own, 0.5 ms | 7.6e-9 | | | 5 |
//! | `prs3` | as shipped | 1 ms, 32 sweeps | 4.0e-5 | 2.6e-4 | 5.0e-7 | 23 |
//! | `prs3` | as shipped | 0.5 ms, 32 sweeps | 4.0e-5 | 2.8e-4 | 1.2e-7 | 49 |
//! | `prs3` | as shipped | 0.25 ms, 8 sweeps | 4.0e-5 | 2.8e-4 | 1.3e-7 | 51 |
//! | `prs3` | as shipped | 0.25 ms, 32 sweeps | 4.0e-5 | 2.8e-4 | 3.1e-8 | 100 |
//! | `prs3` | as shipped | 0.125 ms, 32 sweeps | 4.0e-5 | 2.8e-4 | 7.8e-9 | 187 |
//! | `ups3_rpu1` | none | own, 0.5 ms | 9.0e-10 | | | 6 |
//! | `ups3_rpu1` | none | 1 ms, 32 sweeps | 6.5e-6 | 5.0e-4 | 2.7e-4 | 32 |
//! | `ups3_rpu1` | none | 0.5 ms, 32 sweeps | 1.4e-6 | 3.2e-4 | 6.8e-5 | 63 |
//! | `ups3_rpu1` | none | 0.25 ms, 8 sweeps | 4.3e-6 | 2.1e-3 | 7.1e-5 | 72 |
//! | `ups3_rpu1` | none | 0.25 ms, 32 sweeps | 3.7e-7 | 1.8e-4 | 1.7e-5 | 130 |
//! | `ups3_rpu1` | none | 0.125 ms, 32 sweeps | 1.6e-7 | 9.5e-5 | 4.2e-6 | 254 |
//! | `ups3_rpu1` | as shipped | own, 0.5 ms | 4.0e-9 | | | 7 |
//! | `ups3_rpu1` | as shipped | 1 ms, 32 sweeps | 2.1e-4 | 2.4e-2 | 2.8e-4 | 33 |
//! | `ups3_rpu1` | as shipped | 0.5 ms, 32 sweeps | 9.5e-5 | 1.5e-3 | 6.9e-5 | 66 |
//! | `ups3_rpu1` | as shipped | 0.25 ms, 8 sweeps | 1.8e-4 | 2.4e-2 | 7.3e-5 | 70 |
//! | `ups3_rpu1` | as shipped | 0.25 ms, 32 sweeps | 8.5e-5 | 6.0e-4 | 1.7e-5 | 124 |
//! | `ups3_rpu1` | as shipped | 0.125 ms, 32 sweeps | 8.4e-5 | 5.5e-4 | 4.3e-6 | 256 |
//!
//! Without friction the error is what the sweeps over the fastenings leave over: long chains (the arm) need more of them, and it falls as the
//! first power of the substep; where they converge (prs3) it is of second order. With friction the rest under the controller, 3e-5 to 9e-5, is
//! the smoothing, which no substep takes away. Swinging freely against springs, the arm's energy is off by 0.4 % of the largest after 10 s,
//! that of prs3 by 4e-6 after 4 s.

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
        let Self { robot, world, coordinates, shafts, resisting, efforts, load, options, time, .. } = self;
        for shaft in shafts {
            let j = shaft.joint;
            let at = At { q: coordinates.q[j], v: coordinates.velocity(j, since), load: load[j], time: *time };
            let bearable = BEARABLE * shaft.least / kick;
            let felt = if shaft.resists { resistance(robot, j, at, options.smoothing, bearable) } else { Resistance::default() };
            efforts[j] -= felt.effort;
            let row = shaft.load(felt, at.v, kick);
            world.set_row(shaft.fastening, robot.model.joints[j].kind, row, h);
        }
        for &j in resisting.iter() {
            let at = At { q: coordinates.q[j], v: coordinates.velocity(j, since), load: load[j], time: *time };
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
