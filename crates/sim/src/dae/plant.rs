//! The plant itself: options, start, and what can be seen of it.

use pkm_dyn::constrained::reduced_mass_matrix;
use pkm_dyn::effects::Robot;
use pkm_dyn::energy::{kinetic_energy, potential_energy};
use pkm_dyn::kinematics::world_velocities;
use pkm_dyn::loops::{loop_gap, solve_velocities};
use pkm_dyn::model::SensorKind;
use pkm_dyn::spatial::{Force, Motion, Pose};
use pkm_dyn::{Data, math};

use crate::dae::events::{Smooth, Stepper};
use crate::dae::extension::Extension;
use crate::dae::start::{give_rotors, place, relax, take_up};
use crate::dae::system::{State, System};
use crate::dae::touch::link_pose;
use crate::error::SimError;
use crate::laws::ForeignLaw;
use crate::plant::Plant;

/// How the stretches between events are integrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Integrator {
    /// Runge-Kutta where springs and memories leave it accurate at the step asked for, Radau elsewhere.
    #[default]
    Auto,
    /// Runge-Kutta of order four: fast, for steps well below the period of the stiffest spring.
    RungeKutta,
    /// Radau IIA of order three: damps what is faster than the step.
    Radau,
    /// Gauss of order four: keeps energy.
    Gauss,
    /// The rule for contacts, of order two, all the time.
    Moreau,
}

/// Options of a [`ConstrainedPlant`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ConstrainedOptions {
    /// How stretches between events are integrated.
    pub integrator: Integrator,
    /// Longest step `[s]`; longer ones asked for are divided. None takes steps as they are asked for.
    pub step_s: Option<f64>,
    /// Joints stop at their limits, with this ratio of the speeds after and before an impact, 0 to 1. None lets them pass.
    pub end_stops: Option<f64>,
    /// Seed of what persons do.
    pub seed: u64,
}

/// Largest angle that the stiffest spring's oscillation turns in a step of Runge-Kutta `[rad]`: its error is then below 1e-4 a turn.
const MAX_TURN: f64 = 0.3;

/// Most that a memory's rate times the step may be for Runge-Kutta, which is stable up to 2.8.
const MAX_DECAY: f64 = 0.5;

/// A robot with every effect, in coordinates of its whole tree: motors and loads apart, structures that give, laws with memories, persons,
/// end stops, more or fewer drives than freedoms.
///
/// Loops are open by less than 1e-9 m (rad) after every step. Effects of actuators and sensors are not the plant's: see
/// [`crate::actuators`] and [`crate::sensors`]. Friction, nominal or concealed, sits on the load's side of a transmission. Runs give the
/// same bits on every machine and with any number of threads: nothing here is parallel.
#[derive(Debug)]
pub struct ConstrainedPlant {
    robot: Robot,
    extension: Extension,
    system: System,
    state: State,
    stepper: Stepper,
    options: ConstrainedOptions,
    q: Vec<f64>,
    v: Vec<f64>,
    q_load: Vec<f64>,
    tree: [Vec<f64>; 2],
    energy_data: Data,
}

impl ConstrainedPlant {
    /// The robot at rest with its drives (the motors) at `q_act` `[m | rad]`, reached from its assembly without changing branch. Springs
    /// carry the weight from the start.
    ///
    /// # Errors
    /// Loops that do not close there, nothing that can move, effects that this robot cannot have, options out of range.
    pub fn try_new(robot: Robot, q_act: &[f64], options: ConstrainedOptions) -> Result<Self, SimError> {
        Self::with_laws(robot, q_act, options, Vec::new())
    }

    /// As [`ConstrainedPlant::try_new`], with laws that are not the catalogue's; they act at joints of the robot.
    ///
    /// # Errors
    /// As [`ConstrainedPlant::try_new`]; a law at a joint that the robot does not have.
    pub fn with_laws(robot: Robot, q_act: &[f64], options: ConstrainedOptions, laws: Vec<Box<dyn ForeignLaw>>) -> Result<Self, SimError> {
        options.check()?;
        if laws.iter().any(|law| law.joint() >= robot.model.nv()) {
            return Err(SimError::NoPlace { effect: "law", problem: "the robot has no joint of that number" });
        }
        let mut extension = Extension::try_new(&robot, options.end_stops)?;
        give_rotors(&robot, &mut extension, q_act)?;
        let mut system = System::new(&robot, &extension, laws, options.seed);
        let mut state = State::new(system.model.nv(), system.n_memories());
        place(&mut system, &mut state, q_act)?;
        system.find_inertia(&state);
        relax(&mut system, &mut state, &[])?;
        take_up(&mut system, &mut state, &extension)?;
        system.bias(&state).ok_or(SimError::Massless { time: 0.0 })?;
        system.begin_at(&state);
        let _ = reduced_mass_matrix(&system.model, &mut system.data);
        let mut stepper = Stepper::new(&system, &state, extension.stops.clone(), Smooth::RungeKutta);
        stepper.look(&mut system, &state);
        let n = robot.model.n_act();
        let tree = [vec![0.0; robot.model.nv()], vec![0.0; robot.model.nv()]];
        let energy_data = system.data.clone();
        let (q, v, q_load) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let mut plant = Self { robot, extension, system, state, stepper, options, q, v, q_load, tree, energy_data };
        plant.show();
        Ok(plant)
    }

    /// The robot, effects included.
    #[must_use]
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Sets the velocities of the drives `[m/s | rad/s]`, loads moving with them: a start in motion.
    pub fn set_velocity(&mut self, v_act: &[f64]) {
        let Self { system, state, .. } = self;
        let drives = &system.model.actuators[..system.n_act];
        let of_load = |j: usize| self.extension.motors.iter().find(|m| m[1] == j).map(|m| m[0]);
        let wanted: Vec<f64> = system
            .model
            .actuators
            .iter()
            .map(|&j| drives.iter().position(|&d| d == j || Some(d) == of_load(j)).and_then(|k| v_act.get(k)).copied().unwrap_or(0.0))
            .collect();
        solve_velocities(&system.model, &mut system.data, &wanted);
        state.v.copy_from_slice(&system.data.v);
        state.a.fill(0.0);
        self.stepper.look(system, state);
        self.show();
    }

    /// Sets velocities of the whole tree `[m/s | rad/s]`, one per joint of the robot; those of dependent coordinates follow from the others.
    /// For robots with freedoms that no drive holds.
    ///
    /// # Errors
    /// Another number of velocities than the robot has joints; loops that do not close.
    pub fn set_tree_velocity(&mut self, v: &[f64]) -> Result<(), SimError> {
        if v.len() != self.robot.model.nv() {
            return Err(SimError::NotTheSameRobot { what: "number of joints" });
        }
        self.state.v.fill(0.0);
        for (&j, v) in self.extension.joint.iter().zip(v) {
            self.state.v[j] = *v;
        }
        for [motor, load] in &self.extension.motors {
            self.state.v[*motor] = self.state.v[*load];
        }
        let Self { system, state, .. } = self;
        let closure = pkm_dyn::constrained::project(&system.model, &mut system.data, &mut state.q, &mut state.v);
        crate::plant::check(&closure, state.time)?;
        state.a.fill(0.0);
        self.stepper.look(system, state);
        self.show();
        Ok(())
    }

    /// Largest gap of the loops `[m | rad]`.
    pub fn gap(&mut self) -> f64 {
        loop_gap(&self.system.model, &mut self.energy_data, &self.state.q);
        self.energy_data.loop_gap.iter().fold(0.0, |top, gap| top.max(gap.abs()))
    }

    /// Stops at end of travel or of a play that are touched.
    #[must_use]
    pub fn n_touched(&self) -> usize {
        self.stepper.touches.iter().filter(|t| **t).count()
    }

    fn show(&mut self) {
        for k in 0..self.q.len() {
            let j = self.system.model.actuators[k];
            (self.q[k], self.v[k]) = (self.state.q[j], self.state.v[j]);
            self.q_load[k] = self.state.q[self.extension.joint[self.robot.model.actuators[k]]];
        }
        for (i, &j) in self.extension.joint.iter().enumerate() {
            (self.tree[0][i], self.tree[1][i]) = (self.state.q[j], self.state.v[j]);
        }
    }

    /// The rule for stretches of `h` `[s]`.
    fn smooth(&self, h: f64) -> Smooth {
        match self.options.integrator {
            Integrator::RungeKutta => Smooth::RungeKutta,
            Integrator::Radau => Smooth::Radau,
            Integrator::Gauss => Smooth::Gauss,
            Integrator::Moreau => Smooth::Moreau,
            Integrator::Auto => {
                let (decay, turn) = self.system.fastest_memory(&self.state, |j| self.inertia_at(j));
                let is_stiff = self.fastest().max(turn) * h > MAX_TURN || decay * h > MAX_DECAY;
                if is_stiff { Smooth::Radau } else { Smooth::RungeKutta }
            }
        }
    }

    /// Angular frequency of the stiffest added spring against the inertias on it `[rad/s]`, as the rotors say.
    fn fastest(&self) -> f64 {
        let inertia = |j: usize| self.inertia_at(j);
        let rate = |s: &crate::dae::extension::Spring| {
            let softness = 1.0 / inertia(s.plus) + s.minus.map_or(0.0, |m| 1.0 / inertia(m));
            math::sqrt(s.stiffness * softness)
        };
        self.system.springs.iter().map(rate).fold(0.0, f64::max)
    }

    fn inertia_at(&self, j: usize) -> f64 {
        let data = &self.system.data;
        data.independent.iter().position(|&i| i == j).map_or(f64::INFINITY, |k| data.reduced_mass_matrix[(k, k)].max(f64::MIN_POSITIVE))
    }
}

impl ConstrainedOptions {
    fn check(&self) -> Result<(), SimError> {
        if let Some(value) = self.step_s.filter(|h| !(h.is_finite() && *h > 0.0)) {
            return Err(SimError::Scenario { what: "step_s", value, limit: "must be finite and > 0" });
        }
        if let Some(value) = self.end_stops.filter(|e| !(0.0..=1.0).contains(e)) {
            return Err(SimError::Scenario { what: "restitution of the end stops", value, limit: "must be 0 to 1" });
        }
        Ok(())
    }
}

impl Plant for ConstrainedPlant {
    fn position(&self) -> &[f64] {
        &self.q
    }

    fn velocity(&self) -> &[f64] {
        &self.v
    }

    fn step(&mut self, tau: &[f64], h: f64) -> Result<(), SimError> {
        let parts = self.options.step_s.map_or(1.0, |longest| (h / longest - 1e-9).ceil().max(1.0));
        let h = h / parts;
        self.stepper.smooth = self.smooth(h);
        let mut done = 0.0;
        while done < parts {
            self.stepper.step(&mut self.system, &mut self.state, tau, h)?;
            done += 1.0;
        }
        self.show();
        Ok(())
    }

    fn time(&self) -> Option<f64> {
        Some(self.state.time)
    }

    fn load_position(&self) -> &[f64] {
        &self.q_load
    }

    fn tree(&self) -> Option<[&[f64]; 2]> {
        Some([&self.tree[0], &self.tree[1]])
    }

    fn stored_energy(&mut self) -> Option<f64> {
        let Self { system, state, energy_data, .. } = self;
        let springs: f64 = system
            .springs
            .iter()
            .map(|s| {
                let way = state.q[s.plus] - s.minus.map_or(0.0, |m| state.q[m]);
                0.5 * s.stiffness * way * way
            })
            .sum();
        let rigid = kinetic_energy(&system.model, energy_data, &state.q, &state.v) + potential_energy(&system.model, energy_data, &state.q);
        Some(rigid + springs)
    }

    fn link_motion(&mut self, link: usize) -> Option<(Pose, Motion)> {
        let Self { system, state, .. } = self;
        let body = system.model.links.get(link)?.body;
        world_velocities(&system.model, &mut system.data, &state.v);
        let pose = link_pose(&system.model, &system.data, link);
        Some((pose, body.map(|b| system.data.velocity_w[b].at(&pose.translation)).unwrap_or_default()))
    }

    fn sensor_wrench(&mut self, sensor: usize) -> Option<Force> {
        let Self { system, state, .. } = self;
        let sensor = system.model.sensors.get(sensor).filter(|s| s.kind == SensorKind::Wrench)?.clone();
        world_velocities(&system.model, &mut system.data, &state.v);
        let wrench = system.touch_of(sensor.link, state.time);
        let frame = link_pose(&system.model, &system.data, sensor.link).compose(&sensor.pose);
        let here = wrench.about(&frame.translation);
        Some(Force { linear: frame.rotation.tr_mul(&here.linear), angular: frame.rotation.tr_mul(&here.angular) })
    }

    fn push_link(&mut self, link: usize, wrench: &Force) -> Result<(), SimError> {
        let pushed = &mut self.system.pushed;
        match pushed.iter_mut().find(|(l, _)| *l == link) {
            Some((_, old)) => *old = *wrench,
            None if link < self.system.model.links.len() => pushed.push((link, *wrench)),
            None => return Err(SimError::Scenario { what: "number of a link", value: link as f64, limit: "one of the robot's links" }),
        }
        Ok(())
    }
}
