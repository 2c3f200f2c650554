//! Plants: what moves when drives push.

use nalgebra::{DMatrix, DVector};
use pkm_dyn::constrained::reduced_mass_matrix;
use pkm_dyn::effects::{JointState, Law, Robot};
use pkm_dyn::energy::{kinetic_energy, potential_energy};
use pkm_dyn::inverse_dynamics::{closed_loop_motion, rigid_effort};
use pkm_dyn::loops::{Closure, assemble, mobility, walk_to};
use pkm_dyn::model::Model;
use pkm_dyn::spatial::{Force, Motion, Pose};
use pkm_dyn::{Data, math};

use crate::error::SimError;
use crate::stick_slip::{Contact, is_solvable, solve};

/// Something that moves when its drives push.
///
/// Encoders sit on the motors: [`Plant::position`] is theirs, [`Plant::load_position`] that of the joints where a transmission lies
/// between. What a plant cannot tell is `None`.
pub trait Plant: Send {
    /// Positions of the drives `[m | rad]`.
    fn position(&self) -> &[f64];

    /// Velocities of the drives `[m/s | rad/s]`.
    fn velocity(&self) -> &[f64];

    /// Moves on by `h` `[s]` under efforts `tau` `[N | N·m]` that are constant meanwhile.
    ///
    /// # Errors
    /// The state after which the motion cannot go on: loops open, nothing to move, or numbers beyond all bounds.
    fn step(&mut self, tau: &[f64], h: f64) -> Result<(), SimError>;

    /// Time since the start `[s]`.
    fn time(&self) -> Option<f64> {
        None
    }

    /// Positions of the driven joints on the load's side of their transmissions `[m | rad]`.
    fn load_position(&self) -> &[f64] {
        self.position()
    }

    /// Positions `[m | rad]` and velocities `[m/s | rad/s]` of all joints of the robot's tree.
    fn tree(&self) -> Option<[&[f64]; 2]> {
        None
    }

    /// Kinetic and potential energy of bodies, rotors and transmissions' springs `[J]`.
    fn stored_energy(&mut self) -> Option<f64> {
        None
    }

    /// Pose of a link in the root frame, and the velocity of its origin in the root's axes `[m/s]`, `[rad/s]`.
    fn link_motion(&mut self, link: usize) -> Option<(Pose, Motion)> {
        let _ = link;
        None
    }

    /// Force and moment of environment and persons on the link of a wrench sensor, in the sensor's frame `[N]`, `[N·m]`.
    fn sensor_wrench(&mut self, sensor: usize) -> Option<Force> {
        let _ = sensor;
        None
    }

    /// Puts a force and a moment on a link, in the link's frame and at its origin, in place of the one before `[N]`, `[N·m]`: it acts in all
    /// steps to come.
    ///
    /// # Errors
    /// A plant that takes wrenches at its drives only.
    fn push_link(&mut self, link: usize, wrench: &Force) -> Result<(), SimError> {
        let _ = (link, wrench);
        let what = "a limb at a link".to_string();
        Err(SimError::NotRepresentable { engine: "this plant", what, problem: "take the constrained one" })
    }

    /// Says which motion of the drives is wanted `[m | rad]`, `[m/s | rad/s]`: a person in the plant who assists helps that one.
    fn expect_motion(&mut self, q_ref: &[f64], v_ref: &[f64]) {
        let _ = (q_ref, v_ref);
    }
}

impl<P: Plant + ?Sized> Plant for Box<P> {
    fn position(&self) -> &[f64] {
        (**self).position()
    }

    fn velocity(&self) -> &[f64] {
        (**self).velocity()
    }

    fn step(&mut self, tau: &[f64], h: f64) -> Result<(), SimError> {
        (**self).step(tau, h)
    }

    fn time(&self) -> Option<f64> {
        (**self).time()
    }

    fn load_position(&self) -> &[f64] {
        (**self).load_position()
    }

    fn tree(&self) -> Option<[&[f64]; 2]> {
        (**self).tree()
    }

    fn stored_energy(&mut self) -> Option<f64> {
        (**self).stored_energy()
    }

    fn link_motion(&mut self, link: usize) -> Option<(Pose, Motion)> {
        (**self).link_motion(link)
    }

    fn sensor_wrench(&mut self, sensor: usize) -> Option<Force> {
        (**self).sensor_wrench(sensor)
    }

    fn push_link(&mut self, link: usize, wrench: &Force) -> Result<(), SimError> {
        (**self).push_link(link, wrench)
    }

    fn expect_motion(&mut self, q_ref: &[f64], v_ref: &[f64]) {
        (**self).expect_motion(q_ref, v_ref);
    }
}

/// A robot with its effects in the coordinates of its drives; loops are closed by Newton in every step.
///
/// Each step evaluates the dynamics once, in the middle of the step (leapfrog: second order, and energy does not drift). Friction of
/// driven and passive joints alike is set-valued at rest and solved together with the end-of-step velocity. Effects of actuators and
/// sensors ([`Law::EffortScale`] and its like) are not the plant's: see [`crate::actuators`] and [`crate::sensors`].
#[derive(Debug, Clone)]
pub struct ReducedPlant {
    robot: Robot,
    data: Data,
    /// Joints with friction or any joint effect, one contact each.
    resisting: Vec<usize>,
    contacts: Vec<Contact>,
    /// Driven joint of each coordinate, for the reverse look-up of a joint's drive.
    drive_of: Vec<Option<usize>>,
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    bias: DVector<f64>,
    mass: DMatrix<f64>,
    scratch: Vec<f64>,
    time: f64,
}

impl ReducedPlant {
    /// The robot at rest at positions `q_act` of its drives `[m | rad]`, reached from its assembly without changing branch.
    ///
    /// # Errors
    /// Loops that do not close there, or drives that do not determine the motion.
    pub fn try_new(robot: Robot, q_act: &[f64]) -> Result<Self, SimError> {
        if let Some(effect) = robot.effects.iter().find(|e| has_states(&e.entry.law)) {
            return Err(SimError::NoPlace {
                effect: effect.entry.name,
                problem: "the reduced plant has no state for it: use the constrained one",
            });
        }
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
        let resisting = resisting(&robot);
        let contacts = vec![Contact::new(n); resisting.len()];
        let drive_of = (0..model.nv()).map(|j| model.actuators.iter().position(|&a| a == j)).collect();
        let (zero, bias, mass) = (vec![0.0; n], DVector::zeros(n), DMatrix::zeros(n, n));
        let (v, a, scratch) = (zero.clone(), zero.clone(), zero);
        Ok(Self { q: q_act.to_vec(), v, a, bias, mass, scratch, resisting, contacts, drive_of, data, robot, time: 0.0 })
    }

    /// The robot, effects included.
    #[must_use]
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Tree coordinates in the middle of the last step `[m | rad]`.
    #[must_use]
    pub fn tree_position(&self) -> &[f64] {
        &self.data.q
    }

    /// Sets the velocities of the drives `[m/s | rad/s]`: a start in motion.
    pub fn set_velocity(&mut self, v_act: &[f64]) {
        self.v.copy_from_slice(v_act);
    }

    /// Kinetic and potential energy of the rigid robot, rotors included `[J]`; springs and drives are not counted.
    ///
    /// # Errors
    /// Loops that do not close.
    pub fn energy(&mut self) -> Result<f64, SimError> {
        let Self { robot, data, q, v, scratch, time, .. } = self;
        let model = &robot.model;
        scratch.fill(0.0);
        check(&closed_loop_motion(model, data, q, v, scratch), *time)?;
        let (q, v) = (data.q.clone(), data.v.clone());
        Ok(kinetic_energy(model, data, &q, &v) + potential_energy(model, data, &q))
    }

    /// `mass` and `bias` at the middle of the step.
    fn dynamics(&mut self, h: f64) -> Result<(), SimError> {
        let Self { robot, data, q, v, a, scratch, bias, mass, time, .. } = self;
        let model = &robot.model;
        for k in 0..q.len() {
            q[k] += 0.5 * h * v[k];
            // The velocity in mid-step is needed for the velocity terms only; the last acceleration foretells it to second order.
            scratch[k] = v[k] + 0.5 * h * a[k];
        }
        bias.fill(0.0);
        let closure = closed_loop_motion(model, data, q, scratch, bias.as_slice());
        check(&closure, *time)?;
        rigid_effort(model, data);
        bias.copy_from_slice(&data.tau_act);
        mass.copy_from(reduced_mass_matrix(model, data));
        Ok(())
    }

    /// Levels of every resisting joint; inertia among the effects goes into `mass`.
    fn resist(&mut self, h: f64) {
        let Self { robot, data, resisting, contacts, drive_of, v, a, bias, mass, time, .. } = self;
        let n = v.len();
        for (&j, contact) in resisting.iter().zip(contacts.iter_mut()) {
            for k in 0..n {
                contact.row[k] = data.reduction[(j, k)];
            }
            let start: f64 = (0..n).map(|k| contact.row[k] * v[k]).sum();
            let middle = start + 0.5 * h * (0..n).map(|k| contact.row[k] * a[k]).sum::<f64>();
            // Half a step ahead the velocity may have changed sign where it will in fact stop: stay on this side.
            let speed = if start * middle > 0.0 { middle } else { start };
            let load = drive_of[j].map_or(0.0, |d| bias[d] + (0..n).map(|k| mass[(d, k)] * a[k]).sum::<f64>());
            let viscous = robot.model.joints[j].viscous;
            let state = JointState { q: data.q[j], load, viscous, warmth: *time, time: *time, ..JointState::default() };
            let effort = |v: f64, sign: f64, a: f64| robot.joint_effort(j, &JointState { v, sign, a, ..state });
            (contact.low, contact.high) = levels(speed, |v, sign| effort(v, sign, 0.0));
            let inertia = effort(speed, 0.0, 1.0) - effort(speed, 0.0, 0.0);
            if inertia != 0.0 {
                mass.ger(inertia, &contact.row, &contact.row, 1.0);
            }
        }
    }
}

/// Efforts in backward and in forward motion at joint velocity `speed`.
pub(crate) fn levels(speed: f64, effort: impl Fn(f64, f64) -> f64) -> (f64, f64) {
    let (low, high) = (effort(speed.min(0.0), -1.0), effort(speed.max(0.0), 1.0));
    if low <= high {
        return (low, high);
    }
    // An effect that drives rather than resists (a negative level) has no state of rest: it is what it is in the present direction.
    let effort = effort(speed, math::sign(speed));
    (effort, effort)
}

/// Whether a law has states, freedoms or a place that the reduced plant does not have.
pub(crate) fn has_states(law: &Law) -> bool {
    matches!(law, Law::PairEffort(_) | Law::Memory(_) | Law::Transmission(_) | Law::Structure | Law::Wrench(_) | Law::Person)
}

/// An open loop as an error.
pub(crate) fn check(closure: &Closure, time: f64) -> Result<(), SimError> {
    if closure.is_closed {
        return Ok(());
    }
    Err(SimError::NotClosed { time, gap: closure.gap, row: closure.row, rank: closure.rank })
}

fn resisting(robot: &Robot) -> Vec<usize> {
    let has_effect = |j: usize| robot.effects.iter().any(|e| e.is_at_joint(j) && matches!(e.entry.law, Law::JointEffort(_)));
    let rubs = |m: &Model, j: usize| m.joints[j].viscous > 0.0 || m.joints[j].coulomb > 0.0;
    (0..robot.model.nv()).filter(|&j| rubs(&robot.model, j) || has_effect(j)).collect()
}

impl Plant for ReducedPlant {
    fn position(&self) -> &[f64] {
        &self.q
    }

    fn velocity(&self) -> &[f64] {
        &self.v
    }

    fn step(&mut self, tau: &[f64], h: f64) -> Result<(), SimError> {
        self.dynamics(h)?;
        self.resist(h);
        let factor = self.mass.clone().cholesky().ok_or(SimError::Massless { time: self.time })?;
        let inverse = factor.inverse();
        let push = DVector::from_fn(tau.len(), |k, _| h * (tau[k] - self.bias[k]));
        let mut v = DVector::from_column_slice(&self.v) + &inverse * push;
        if !is_solvable(&self.contacts, &v) {
            return Err(SimError::Diverged { time: self.time });
        }
        solve(&mut self.contacts, &inverse, h, &mut v);
        for (&j, contact) in self.resisting.iter().zip(&self.contacts) {
            // A joint that sticks has a velocity of rounding errors: make it the zero it stands for.
            if let Some(k) = self.drive_of[j]
                && contact.low < contact.effort
                && contact.effort < contact.high
            {
                v[k] = 0.0;
            }
        }
        self.time += h;
        if v.iter().any(|v| !v.is_finite()) {
            return Err(SimError::Diverged { time: self.time });
        }
        for k in 0..tau.len() {
            self.a[k] = (v[k] - self.v[k]) / h;
            self.q[k] += 0.5 * h * v[k];
            self.v[k] = v[k];
        }
        Ok(())
    }

    fn time(&self) -> Option<f64> {
        Some(self.time)
    }

    fn stored_energy(&mut self) -> Option<f64> {
        self.energy().ok()
    }

    fn link_motion(&mut self, link: usize) -> Option<(Pose, Motion)> {
        let Self { robot, data, q, v, scratch, .. } = self;
        let link = robot.model.links.get(link)?;
        scratch.fill(0.0);
        // The tree in `data` is that of mid-step: bring it to the end first.
        if !closed_loop_motion(&robot.model, data, q, v, scratch).is_closed {
            return None;
        }
        let pose = link.body.map_or(link.pose, |b| data.pose_wb[b].compose(&link.pose));
        Some((pose, link.body.map(|b| data.velocity_w[b].at(&pose.translation)).unwrap_or_default()))
    }
}
