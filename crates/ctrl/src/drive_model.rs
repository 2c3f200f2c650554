//! The robot's model inside a controller: efforts and inertia of the drives, with friction and every other joint effect, loops closed.

use alloc::vec;
use alloc::vec::Vec;

use pkm_dyn::constrained::reduced_mass_matrix;
use pkm_dyn::effects::{JointState, Law, Robot};
use pkm_dyn::inverse_dynamics::{inverse_dynamics, project_efforts};
use pkm_dyn::loops::{assemble, distribute, drive_jacobian};
use pkm_dyn::{Data, math};

use crate::controller::{ConfigError, must_be_finite};
use crate::fault::{Fault, FaultCode};
use crate::linear_system;
use crate::pose_walk::{walk, walk_if_far};

/// Parts of the way from the assembly to the first measured pose: one Newton jump over a long way can land on another branch.
const WALK_PARTS: u32 = 40;

/// Why a command whose clipped efforts have no acceleration is none: the inertia at its pose cannot be inverted.
pub(crate) const NO_ACCELERATION: Fault = Fault { code: FaultCode::CommandNotFinite, drive: 0, value: f64::NAN, limit: 0.0 };

/// A robot with `N` drives, checked once: it can be followed from sample to sample without allocating.
#[derive(Debug, Clone)]
pub(crate) struct DriveModel<const N: usize> {
    robot: Robot,
    /// Passive joints with friction or any joint effect.
    resisting: Vec<usize>,
    freedoms: usize,
    /// Speed below which the direction of motion fades to zero `[m/s | rad/s]`; zero switches at standstill.
    creep: f64,
    /// Largest contradiction of surplus drives' coordinates `[m | rad]`.
    misfit_limit: f64,
}

/// The pose that a [`DriveModel`] was last solved at.
#[derive(Debug, Clone)]
pub(crate) struct DriveModelState {
    data: Data,
    /// Efforts of passive joints, nv.
    passive: Vec<f64>,
    /// Tree coordinates of the last pose at which the loops closed; the assembly before there is any.
    good: Vec<f64>,
    has_started: bool,
}

impl<const N: usize> DriveModel<N> {
    pub(crate) fn try_new(robot: Robot) -> Result<Self, ConfigError> {
        let model = &robot.model;
        let bad = |what, value, limit| ConfigError { drive: 0, what, value, limit };
        if model.n_act() != N || N == 0 {
            return Err(bad("number of the robot's drives", model.n_act() as f64, "must be the controller's, above 0"));
        }
        let mut data = Data::new(model);
        let closure = assemble(model, &mut data);
        if !closure.is_closed || (!model.is_constrained() && !data.dependent.is_empty()) {
            return Err(bad("gap of the loops at the assembly", closure.gap, "must close and leave no joint undriven"));
        }
        let has_effect = |j: usize| robot.effects.iter().any(|e| e.place == j && matches!(e.entry.law, Law::JointEffort(_)));
        let rubs = |j: usize| model.joints[j].viscous > 0.0 || model.joints[j].coulomb > 0.0;
        let resisting = model.passive().into_iter().filter(|&j| rubs(j) || has_effect(j)).collect();
        Ok(Self { freedoms: data.n_ind(), resisting, robot, creep: 0.0, misfit_limit: f64::INFINITY })
    }

    pub(crate) fn with_creep(self, creep: f64) -> Self {
        Self { creep, ..self }
    }

    pub(crate) fn with_misfit_limit(self, misfit_limit: f64) -> Self {
        Self { misfit_limit, ..self }
    }

    pub(crate) fn freedoms(&self) -> usize {
        self.freedoms
    }

    /// The one place that allocates.
    pub(crate) fn at_rest(&self) -> DriveModelState {
        let mut data = Data::new(&self.robot.model);
        // Closes: it did in `try_new`. What happens if it does not is found out by the first sample.
        let _ = assemble(&self.robot.model, &mut data);
        let good = data.q.clone();
        DriveModelState { data, passive: vec![0.0; self.robot.model.nv()], good, has_started: false }
    }

    /// Efforts of the drives for `[q, v, a]` of the drives, friction and joint effects included, their friction at velocities
    /// `v_friction`.
    ///
    /// # Errors
    /// Loops that do not close, surplus drives that contradict the others, a number that is not finite. The pose stays the last good one.
    pub(crate) fn effort(&self, state: &mut DriveModelState, [q, v, a]: [&[f64; N]; 3], v_friction: &[f64; N]) -> Result<[f64; N], Fault> {
        let model = &self.robot.model;
        must_be_finite(FaultCode::InputNotFinite, &[q, v, a])?;
        let data = &mut state.data;
        let is_there = if state.has_started { walk_if_far(model, data, q) } else { walk(model, data, q, WALK_PARTS) };
        let closure = inverse_dynamics(model, data, q, v, a);
        if !is_there || !closure.is_closed || closure.misfit > self.misfit_limit {
            // What Newton left behind is no start for the next sample.
            data.q.copy_from_slice(&state.good);
            return Err(if is_there && closure.is_closed {
                Fault { code: FaultCode::Misfit, drive: 0, value: closure.misfit, limit: self.misfit_limit }
            } else {
                Fault { code: FaultCode::LoopGap, drive: 0, value: closure.gap, limit: 0.0 }
            });
        }
        state.has_started = true;
        state.good.copy_from_slice(&state.data.q);
        let mut tau: [f64; N] = core::array::from_fn(|k| state.data.tau_act[k]);
        for (k, &j) in model.actuators.iter().enumerate() {
            let speed = v_friction[k];
            tau[k] += self.robot.joint_effort(j, &self.joint_state(&state.data, j, speed, state.data.tau_act[k]));
        }
        self.add_passive(state, v_friction, &mut tau);
        must_be_finite(FaultCode::CommandNotFinite, &[&tau])?;
        Ok(tau)
    }

    /// Effort that carries the robot at rest at the last pose at which its loops closed; `None` before there was one.
    pub(crate) fn weight(&self, state: &mut DriveModelState) -> Option<[f64; N]> {
        if !state.has_started {
            return None;
        }
        state.data.q.copy_from_slice(&state.good);
        let q = core::array::from_fn(|k| state.good[self.robot.model.actuators[k]]);
        let zero = [0.0; N];
        self.effort(state, [&q, &zero, &zero], &zero).ok()
    }

    /// Inertia of the drives at the pose of the last [`DriveModel::effort`] `[kg | kg·m²]`, that of joint effects included.
    ///
    /// In the independent coordinates; they are the drives unless there are more drives than freedoms, where the entries beyond are zero.
    pub(crate) fn mass(&self, state: &mut DriveModelState) -> [[f64; N]; N] {
        let model = &self.robot.model;
        reduced_mass_matrix(model, &mut state.data);
        let data = &state.data;
        let n = data.n_ind();
        let mut mass = [[0.0; N]; N];
        for (i, row) in mass.iter_mut().enumerate().take(n) {
            for (k, m) in row.iter_mut().enumerate().take(n) {
                *m = data.reduced_mass_matrix[(i, k)];
            }
        }
        for &j in model.actuators.iter().chain(&self.resisting) {
            let at = |a: f64| self.robot.joint_effort(j, &JointState { q: data.q[j], a, ..JointState::default() });
            let inertia = at(1.0) - at(0.0);
            if inertia > 0.0 {
                for (i, row) in mass.iter_mut().enumerate().take(n) {
                    for (k, m) in row.iter_mut().enumerate().take(n) {
                        *m += data.reduction[(j, i)] * inertia * data.reduction[(j, k)];
                    }
                }
            }
        }
        mass
    }

    /// Acceleration that efforts `tau` give the drives beyond that of the last [`DriveModel::effort`], at its pose.
    pub(crate) fn acceleration_of(&self, state: &mut DriveModelState, tau: &[f64; N]) -> Option<[f64; N]> {
        let mass = self.mass(state);
        drive_jacobian(&self.robot.model, &mut state.data);
        let (b, n) = (&state.data.drive_jacobian, state.data.n_ind());
        let mut a_ind = [0.0; N];
        for (i, a) in a_ind.iter_mut().enumerate().take(n) {
            *a = (0..N).map(|k| b[(k, i)] * tau[k]).sum();
        }
        let is_sound = linear_system::solve(mass, n, &mut a_ind);
        is_sound.then(|| core::array::from_fn(|k| (0..n).map(|i| b[(k, i)] * a_ind[i]).sum()))
    }

    fn add_passive(&self, state: &mut DriveModelState, v_friction: &[f64; N], tau: &mut [f64; N]) {
        if self.resisting.is_empty() {
            return;
        }
        let DriveModelState { data, passive, .. } = state;
        passive.fill(0.0);
        for &j in &self.resisting {
            let drive_of = |i: usize| self.robot.model.actuators.iter().position(|&d| d == data.independent[i]);
            let speed = (0..data.n_ind()).map(|i| data.reduction[(j, i)] * drive_of(i).map_or(0.0, |k| v_friction[k])).sum();
            passive[j] = self.robot.joint_effort(j, &self.joint_state(data, j, speed, 0.0));
        }
        project_efforts(data, passive);
        distribute(&self.robot.model, data);
        for (tau, extra) in tau.iter_mut().zip(&data.tau_act) {
            *tau += extra;
        }
    }

    fn joint_state(&self, data: &Data, j: usize, v: f64, load: f64) -> JointState {
        let sign = if self.creep > 0.0 { math::tanh(v / self.creep) } else { math::sign(v) };
        JointState { q: data.q[j], v, a: data.a[j], sign, load, ..JointState::default() }
    }
}
