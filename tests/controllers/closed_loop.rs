//! A closed loop for tests: a robot of `N` drives in a plant, a controller of the catalogue, a motion to follow.

use pkm_ctrl::catalogue::{Drives, Entry, Tuning, Visit};
use pkm_ctrl::{Command, Controller, Input};
use pkm_dyn::effects::Robot;
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{assemble, mid_pose, walk_to};
use pkm_dyn::urdf::parse;
use pkm_dyn::{Data, math};
use pkm_sim::{Plant, ReducedPlant};

/// The shipped robot of that name, as its files describe it.
///
/// # Panics
/// When there is none, or its files cannot be read.
#[must_use]
pub fn shipped_robot(name: &str) -> Robot {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("a shipped robot reads").robot
}

/// Tuning of the catalogue for `robot` with the efforts its files allow.
///
/// # Panics
/// When the robot has not `N` drives.
#[must_use]
pub fn tuning<const N: usize>(robot: &Robot, bandwidth: f64, dt: f64) -> Tuning<N> {
    assert_eq!(robot.model.n_act(), N);
    let limit = |k: usize| robot.model.joints[robot.model.actuators[k]].limits.effort;
    let tau_limit = core::array::from_fn(|k| if limit(k) > 0.0 { limit(k) } else { 1e6 });
    Tuning { bandwidth, dt, tau_limit, b0: [1.0; N], u_limit: [1e4; N] }
}

/// Sines of the drives about the middle of travel, from rest: the amplitude grows over the first second.
#[derive(Debug, Clone, PartialEq)]
pub struct Sines<const N: usize> {
    centre: [f64; N],
    amplitude: f64,
}

impl<const N: usize> Sines<N> {
    /// Of `amplitude` `[m | rad]` about the middle of travel of `robot`.
    #[must_use]
    pub fn about_the_middle(robot: &Robot, amplitude: f64) -> Self {
        let middle = mid_pose(&robot.model);
        Self { centre: core::array::from_fn(|k| middle[k]), amplitude }
    }

    /// Position, velocity and acceleration at time `t` `[s]`.
    #[must_use]
    pub fn at(&self, t: f64) -> [[f64; N]; 3] {
        let grow = 1.0 - math::exp(-2.0 * t * t);
        let (rate, bend) = (4.0 * t * (1.0 - grow), (4.0 - 16.0 * t * t) * (1.0 - grow));
        let row = |f: &dyn Fn(f64, f64, f64) -> f64| -> [f64; N] {
            core::array::from_fn(|k| {
                let w = 2.0 + 0.4 * k as f64;
                f(w, math::sin(w * t), math::cos(w * t)) * self.amplitude
            })
        };
        let mut q = row(&|_, s, _| grow * s);
        for (q, centre) in q.iter_mut().zip(self.centre) {
            *q += centre;
        }
        [q, row(&|w, s, c| rate * s + grow * w * c), row(&|w, s, c| bend * s + 2.0 * rate * w * c - grow * w * w * s)]
    }
}

/// A plant and what a controller of it needs.
#[derive(Debug, Clone)]
pub struct World<const N: usize> {
    /// What moves.
    pub plant: ReducedPlant,
    robot: Robot,
    data: Data,
    tuning: Tuning<N>,
    u: [f64; N],
}

impl<const N: usize> World<N> {
    /// `robot` at rest at the start of `motion`.
    ///
    /// # Panics
    /// When the loops do not close there.
    #[must_use]
    pub fn new(robot: &Robot, motion: &Sines<N>, tuning: &Tuning<N>) -> Self {
        let start = motion.at(0.0)[0];
        let mut data = Data::new(&robot.model);
        assert!(assemble(&robot.model, &mut data).is_closed && walk_to(&robot.model, &mut data, &start).is_closed);
        let plant = ReducedPlant::try_new(robot.clone(), &start).expect("the motion starts where the loops close");
        Self { plant, robot: robot.clone(), data, tuning: *tuning, u: [0.0; N] }
    }

    /// What the controller sees at time `t` `[s]` of `motion`, with exact positions.
    ///
    /// # Panics
    /// When the loops do not close along the motion.
    pub fn input(&mut self, t: f64, motion: &Sines<N>, entry: &Entry) -> Input<N> {
        let [q_ref, v_ref, a_ref] = motion.at(t);
        let q_meas = core::array::from_fn(|k| self.plant.position()[k]);
        let mut tau_ff = [0.0; N];
        if entry.wants_weight {
            let zero = [0.0; N];
            assert!(inverse_dynamics(&self.robot.model, &mut self.data, &q_ref, &zero, &zero).is_closed);
            tau_ff.copy_from_slice(&self.data.tau_act);
        }
        Input { q_ref, v_ref, a_ref, tau_ff, ..Input::standing(q_meas, self.tuning.dt) }
    }

    /// Moves on by a control period in two steps. Voltages become efforts by their rate.
    ///
    /// # Panics
    /// When the plant cannot go on.
    pub fn advance(&mut self, command: &Command<N>, entry: &Entry) {
        let dt = self.tuning.dt;
        let tau = match entry.drives {
            Drives::Effort => command.tau,
            Drives::Voltage => core::array::from_fn(|k| self.tuning.b0[k] * (command.tau[k] - self.u[k]) / dt),
        };
        self.u = command.tau;
        for _ in 0..2 {
            self.plant.step(&tau, 0.5 * dt).expect("the robot moves on");
        }
    }
}

/// Runs every controller it visits along a motion; `each` sees input and command of every period.
pub struct Runs<'r, const N: usize, F> {
    /// Robot, in the plant and in the controllers alike.
    pub robot: &'r Robot,
    /// Motion to follow.
    pub motion: &'r Sines<N>,
    /// Tuning of the controllers.
    pub tuning: Tuning<N>,
    /// Number of control periods.
    pub periods: u32,
    /// Called after every step of a controller.
    pub each: F,
}

impl<const N: usize, F: FnMut(&'static Entry, u32, &Input<N>, &Command<N>)> Visit<N> for Runs<'_, N, F> {
    fn visit<C: Controller<N>>(&mut self, entry: &'static Entry, controller: &C) {
        let mut world = World::new(self.robot, self.motion, &self.tuning);
        let mut state = controller.at_rest();
        for k in 0..self.periods {
            let input = world.input(self.tuning.dt * f64::from(k), self.motion, entry);
            let command = controller.step(&mut state, &input);
            (self.each)(entry, k, &input, &command);
            world.advance(&command, entry);
        }
    }
}
