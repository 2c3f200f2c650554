//! Every controller of contact, one of each kind on three drives that carry a platform, and a platform to run them on.

use pkm_ctrl::exercise::{Assistance, Channel, Exercise, ExerciseConfig, Phase, Resistance, Script, Wave};
use pkm_ctrl::force::gains::{Decoupling, Forward};
use pkm_ctrl::force::{
    ActuatorForce, ActuatorForceConfig, Admittance, AdmittanceConfig, ExplicitForce, ExplicitForceConfig, ForceLaw, ForcePidConfig,
    GainCurve, Hybrid, HybridConfig, Impedance, ImpedanceConfig, JointTask, LinearTask, TaskMap,
};
use pkm_ctrl::limits::{LimitsConfig, Safe, TaskBox};
use pkm_ctrl::{Command, Controller, Input, Limited, PdGravity, PdGravityConfig};
use pkm_dyn::math;

/// Control period `[s]`.
pub(crate) const DT: f64 = 0.01;
/// Moving mass of each drive `[kg]`.
const MASS: f64 = 26.5;
/// Weight that each drive carries `[N]`.
const WEIGHT: f64 = 73.0;

/// dq/d(z, pitch, roll) of a 3-PRS away from its home pose.
const INVERSE_JACOBIAN: [[f64; 3]; 3] = [[1.0, -0.304, -0.003], [1.0, 0.157, 0.256], [1.0, 0.14, -0.244]];

/// Height, pitch and roll, felt as force z, moment y and moment x.
pub(crate) fn task() -> LinearTask<3, 3> {
    LinearTask::try_new([0.1; 3], [0.0; 3], INVERSE_JACOBIAN, [2, 4, 3]).expect("a Jacobian of full rank")
}

/// The position loop.
pub(crate) fn position() -> PdGravity<3> {
    let config = PdGravityConfig { kp: [10_600.0; 3], kd: [1000.0; 3], tau_limit: [1500.0; 3], dt: DT, filter_s: 0.0 };
    PdGravity::try_new(config).expect("numbers in range")
}

/// Force error to speed, in z only.
pub(crate) fn force_pid() -> ForcePidConfig<3> {
    ForcePidConfig {
        kp: [2e-3, 0.0, 0.0],
        ki: [5e-3, 0.0, 0.0],
        kd: [0.0; 3],
        output_limit: [0.1; 3],
        rate_limit: [2.0; 3],
        filter_s: 0.02,
        dt: DT,
    }
}

/// A controller with its state.
pub(crate) trait Running {
    /// One period.
    fn step(&mut self, input: &Input<3>) -> Command<3>;
}

struct With<C: Controller<3>> {
    controller: C,
    state: C::State,
}

impl<C: Controller<3>> Running for With<C> {
    fn step(&mut self, input: &Input<3>) -> Command<3> {
        self.controller.step(&mut self.state, input)
    }
}

fn start<C: Controller<3> + 'static>(controller: C) -> Box<dyn Running> {
    let state = controller.at_rest();
    Box::new(With { controller, state })
}

/// Up to a height, then along a force, against a load, with help.
pub(crate) fn script() -> Script<3> {
    let level = Channel::Position(Wave::constant(0.0));
    let phase = |duration_s, ramp_s, z| Phase { duration_s, ramp_s, channels: [z, level, level] };
    let up = Channel::Position(Wave::constant(0.02));
    let force = Channel::Force(Wave { mean: 40.0, amplitude: 20.0, w: core::f64::consts::FRAC_PI_2 });
    let resist = Channel::Resist(Resistance { load: 30.0, stiffness: 500.0, centre: 0.02, damping: 200.0 });
    let path = Wave { mean: 0.015, amplitude: 0.01, w: 1.0 };
    let assist = Channel::Assist(Assistance {
        path,
        tolerance: 2e-3,
        stiffness: 3000.0,
        learning: 2000.0,
        forgetting_s: 3.0,
        damping: 100.0,
        most: 80.0,
    });
    let phases = [phase(9.0, 6.0, up), phase(15.0, 1.0, force), phase(12.0, 1.0, resist), phase(12.0, 2.0, assist), phase(12.0, 3.0, up)];
    Script::try_new(&phases).expect("phases")
}

/// Limits that a calm run does not meet.
pub(crate) fn limits() -> LimitsConfig<3> {
    LimitsConfig {
        q_lower: [0.0; 3],
        q_upper: [0.3; 3],
        q_tolerance: 1e-3,
        deceleration: [3.0; 3],
        brake: [150.0; 3],
        v_limit: [0.4; 3],
        tau_limit: [1500.0; 3],
        tau_rate: [5e4; 3],
        wrench_yield: [200.0; 6],
        wrench_limit: [400.0; 6],
        dt: DT,
        dt_limit: 5.0 * DT,
        repeats: 0,
        safe: Safe::Damped([500.0; 3]),
    }
}

fn actuators(law: ForceLaw<3>) -> ActuatorForce<3, 3, LinearTask<3, 3>> {
    let inertia = [[13.0, 0.0, 0.0], [0.0, 0.4, 0.01], [0.0, 0.01, 0.4]];
    let config = ActuatorForceConfig { law, inertia, derivative: 2e-3, tau_limit: [1500.0; 3], dt: DT };
    ActuatorForce::try_new(task(), config).expect("numbers in range")
}

/// One of each, started, by name.
pub(crate) fn all() -> Vec<(&'static str, Box<dyn Running>)> {
    let pid = ForcePidConfig { kp: [0.2; 3], ki: [2.0; 3], output_limit: [100.0; 3], rate_limit: [1e4; 3], ..force_pid() };
    let explicit = ExplicitForceConfig { pid, tau_limit: [1500.0; 3] };
    let hybrid = HybridConfig { selection: [1.0, 0.0, 0.0], pid: force_pid(), travel: [0.1; 3], margin: 1e-3 };
    let hybrid = || Hybrid::try_new(task(), position(), hybrid).expect("numbers in range");
    let yielding =
        AdmittanceConfig { mass: [20.0; 3], damping: [400.0; 3], stiffness: [2000.0; 3], travel: [0.05; 3], speed: [0.2; 3], dt: DT };
    let stiff = ImpedanceConfig {
        stiffness: [4000.0, 200.0, 200.0],
        damping: [500.0, 25.0, 25.0],
        force_limit: [500.0; 3],
        tau_limit: [1500.0; 3],
        filter_s: 0.01,
        dt: DT,
    };
    let curve = GainCurve::try_new(&[[1.0, 0.6], [20.0, 0.2]]).expect("breakpoints that rise");
    let observer = Decoupling { share: 0.2, power: 0.5, null_share: 0.0, apparent_mass: 5.0, forward: Forward::Holding };
    let exercise = ExerciseConfig { script: script(), pid: force_pid(), lower: [-0.05, -0.2, -0.2], upper: [0.1, 0.2, 0.2] };
    let exercise = Exercise::try_new(task(), position(), exercise).expect("numbers in range");
    let space = TaskBox::try_new(task(), [-0.05, -0.2, -0.2], [0.08, 0.2, 0.2], 1e-3).expect("a box");
    vec![
        ("explicit force", start(ExplicitForce::try_new(explicit).expect("numbers in range"))),
        ("hybrid", start(hybrid())),
        ("admittance of the task", start(Admittance::try_new(task(), position(), yielding).expect("numbers in range"))),
        ("admittance of the joints", start(Admittance::try_new(JointTask, position(), yielding).expect("numbers in range"))),
        ("impedance of the task", start(Impedance::try_new(task(), stiff).expect("numbers in range"))),
        (
            "impedance of the joints",
            start(
                Impedance::try_new(JointTask, ImpedanceConfig { stiffness: [4000.0; 3], damping: [500.0; 3], ..stiff })
                    .expect("numbers in range"),
            ),
        ),
        ("directional gains", start(actuators(ForceLaw::Directional { curves: [curve; 3], null: 0.0 }))),
        ("decoupling observer", start(actuators(ForceLaw::Decoupling(observer)))),
        ("exercise", start(exercise)),
        ("limited hybrid", start(Limited::within(hybrid(), space, limits()).expect("numbers in range"))),
    ]
}

/// Three drives with friction under a platform that meets a spring at its home height.
pub(crate) struct Platform {
    pub(crate) q: [f64; 3],
    pub(crate) v: [f64; 3],
    /// Efforts that arrive at the platform `[N]`.
    pub(crate) tau: [f64; 3],
    /// Of the environment on the platform.
    pub(crate) wrench: [f64; 6],
    map: LinearTask<3, 3>,
}

impl Platform {
    pub(crate) fn new() -> Self {
        Self { q: [0.1; 3], v: [0.0; 3], tau: [WEIGHT; 3], wrench: [0.0; 6], map: task() }
    }

    /// Moves on by a period; the environment's spring is touched above z = 0.
    pub(crate) fn step(&mut self, tau: &[f64; 3]) {
        for _ in 0..10 {
            let here = self.map.at(&mut (), &self.q).expect("finite positions");
            let (z, rate) = (here.x[0], here.of_drives(&self.v)[0]);
            let fz = if z > 0.0 { (-5000.0 * z - 50.0 * rate).min(0.0) } else { 0.0 };
            self.wrench = [0.0, 0.0, fz, 0.0, 0.0, 0.0];
            let push = here.efforts(&[fz, 0.0, 0.0]);
            for k in 0..3 {
                self.tau[k] = tau[k] - 3.0 * math::tanh(self.v[k] / 1e-3);
                let a = (self.tau[k] - 170.0 * self.v[k] - WEIGHT + push[k]) / MASS;
                self.v[k] += 0.1 * DT * a;
                self.q[k] += 0.1 * DT * self.v[k];
            }
        }
    }

    /// What a controller sees that should press with a sine and swing a little, at `t` `[s]`.
    pub(crate) fn input(&self, t: f64) -> Input<3> {
        let (s, c) = math::sin_cos(t);
        let pitch = [0.0, 0.02 * s, 0.0];
        let q = self.map.drives(&mut (), &pitch).expect("finite coordinates");
        let v = core::array::from_fn(|i| INVERSE_JACOBIAN[i][1] * 0.02 * c);
        let press = -40.0 - 15.0 * math::sin(core::f64::consts::FRAC_PI_2 * t);
        let asked = [0.0, 0.7, 1.4].map(|late| WEIGHT + 4.0 * math::sin(2.0 * t - late));
        let mut input = Input { q_ref: q, v_ref: v, tau_ff: asked, tau_meas: self.tau, ..Input::standing(self.q, DT) };
        (input.q_ref, input.wrench_meas, input.wrench_ref[2]) = (q, self.wrench, press);
        input
    }
}
