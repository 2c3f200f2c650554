//! Every tracking controller by name, tuned for a robot from one bandwidth: what tests, benches and configuration files iterate over.

use pkm_dyn::effects::Robot;

use crate::adrc::{Adrc, AdrcConfig, Extended, Feedback};
use crate::computed_torque::{ComputedTorque, ComputedTorqueConfig};
use crate::computed_torque_dae::{ComputedTorqueDae, ComputedTorqueDaeConfig};
use crate::controller::{ConfigError, Controller};
use crate::drive_model::DriveModel;
use crate::error_dynamics::ErrorGains;
use crate::linear_system;
use crate::observer::{CommandedAcceleration, Discretisation, FilteredDerivative, ModelBased, NonlinearEso};
use crate::pd_gravity::{PdGravity, PdGravityConfig};
use crate::pd_model::{PdModel, PdModelConfig};
use crate::pid::{AntiWindup, Pid, PidConfig};

/// What a controller's command is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Drives {
    /// An effort `[N | N·m]`.
    Effort,
    /// A voltage `[V]` whose rate the drive turns into an effort ([`crate::computed_torque_dae`]).
    Voltage,
}

/// A tracking controller of the library.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Name, as in configuration files.
    pub name: &'static str,
    /// What it does, one sentence.
    pub sentence: &'static str,
    /// What its command is.
    pub drives: Drives,
    /// Whether it wants the weight as feed-forward effort, having no model of its own.
    pub wants_weight: bool,
}

/// Every tracking controller, in the order in which [`every`] visits them.
pub const ALL: &[Entry] = &[
    entry("pd_gravity", "PD with a feed-forward effort, velocity by a filtered difference", Drives::Effort, true),
    entry("pd_model", "PD with the weight of the model, velocity by the nonlinear model-based observer", Drives::Effort, false),
    entry("pid", "PID with a feed-forward effort and back-calculation", Drives::Effort, true),
    entry("pid_clamping", "PID with a feed-forward effort and a clamped integral", Drives::Effort, true),
    entry("computed_torque", "computed torque, velocity by the linear model-based observer", Drives::Effort, false),
    entry("computed_torque_dae", "computed torque with integrated voltages", Drives::Voltage, false),
    entry("adrc", "active disturbance rejection, linear observer and law", Drives::Effort, true),
    entry("adrc_nonlinear", "active disturbance rejection after Han", Drives::Effort, true),
];

const fn entry(name: &'static str, sentence: &'static str, drives: Drives, wants_weight: bool) -> Entry {
    Entry { name, sentence, drives, wants_weight }
}

/// The controller of that name.
#[must_use]
pub fn find(name: &str) -> Option<&'static Entry> {
    ALL.iter().find(|entry| entry.name == name)
}

/// Something to be done with every controller.
pub trait Visit<const N: usize> {
    /// Called once per controller.
    fn visit<C: Controller<N>>(&mut self, entry: &'static Entry, controller: &C);
}

/// What [`every`] tunes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tuning<const N: usize> {
    /// Bandwidth of the position loop `[1/s]`; observers are three times as fast.
    pub bandwidth: f64,
    /// Control period `[s]`.
    pub dt: f64,
    /// Largest effort of each drive `[N | N·m]`.
    pub tau_limit: [f64; N],
    /// Effort per rate of the voltage `[N·s/V | N·m·s/V]`, for drives that take voltages.
    pub b0: [f64; N],
    /// Largest voltage `[V]`.
    pub u_limit: [f64; N],
}

/// Builds every controller of [`ALL`] for `robot` and hands it to `visit`, in that order. Gains come from the bandwidth and the inertia at
/// the assembly. Allocates.
///
/// # Errors
/// Numbers that a controller refuses, a robot without `N` drives, or one whose inertia at the assembly is singular.
pub fn every<const N: usize>(robot: &Robot, tuning: &Tuning<N>, visit: &mut impl Visit<N>) -> Result<(), ConfigError> {
    let mass = mass_at_assembly(robot)?;
    ConfigError::unless_positive("bandwidth", &[tuning.bandwidth])?;
    let (w, limit) = (tuning.bandwidth, tuning.tau_limit);
    let kp = core::array::from_fn(|k| mass[k][k] * w * w);
    let kd = core::array::from_fn(|k| mass[k][k] * 2.0 * w);
    let fast = [3.0 * w; N];
    let linear = CommandedAcceleration::try_new(fast, Discretisation::ZeroOrderHold)?;

    let config = PdGravityConfig { kp, kd, tau_limit: limit, dt: tuning.dt, filter_s: 1.0 / fast[0] };
    visit.visit(&ALL[0], &PdGravity::try_new(config)?);
    let full = ModelBased::try_new(robot.clone(), fast, Discretisation::ZeroOrderHold)?;
    visit.visit(&ALL[1], &PdModel::try_new(robot.clone(), full, PdModelConfig { kp, kd, tau_limit: limit })?);
    let ki = core::array::from_fn(|k| mass[k][k] * w * w * w / 4.0);
    let filtered = FilteredDerivative::try_new([1.0 / fast[0]; N])?;
    let anti_windup = AntiWindup::BackCalculation { time_s: 1.0 / w };
    let pid = PidConfig { kp, ki, kd, tau_limit: limit, anti_windup };
    visit.visit(&ALL[2], &Pid::try_new(filtered, pid)?);
    visit.visit(&ALL[3], &Pid::try_new(filtered, PidConfig { anti_windup: AntiWindup::Clamping, ..pid })?);
    visit.visit(&ALL[4], &ComputedTorque::try_new(robot.clone(), linear, ComputedTorqueConfig::with_bandwidth(w, limit))?);
    let gains = [ErrorGains::placed_sampled([-w, -1.2 * w, -1.4 * w], tuning.dt); N];
    let dae = ComputedTorqueDaeConfig { gains, b0: tuning.b0, u_limit: tuning.u_limit, creep: 0.0 };
    visit.visit(&ALL[5], &ComputedTorqueDae::try_new(robot.clone(), linear, dae)?);
    visit_adrc(&mass, tuning, visit)
}

fn visit_adrc<const N: usize>(mass: &[[f64; N]; N], tuning: &Tuning<N>, visit: &mut impl Visit<N>) -> Result<(), ConfigError> {
    let singular = ConfigError { drive: 0, what: "inertia at the assembly", value: mass[0][0], limit: "must have an inverse" };
    let b = linear_system::inverse(mass).ok_or(singular)?;
    let w = tuning.bandwidth;
    let linear = AdrcConfig {
        b,
        extended: Extended::Linear { bandwidth: 3.0 * w },
        feedback: Feedback::Linear { bandwidth: w },
        reference_acceleration: f64::INFINITY,
        limit: tuning.tau_limit,
    };
    visit.visit(&ALL[6], &Adrc::try_new(linear)?);
    let nonlinear = AdrcConfig {
        extended: Extended::Nonlinear(NonlinearEso::for_period(tuning.dt, tuning.dt)),
        feedback: Feedback::TimeOptimal { r: 10.0 * w, c: 1.0, h: 10.0 * tuning.dt },
        ..linear
    };
    visit.visit(&ALL[7], &Adrc::try_new(nonlinear)?);
    Ok(())
}

/// Inertia that the drives feel at the assembly `[kg | kg·m²]`; of more drives than freedoms each is given the largest, uncoupled: which of
/// them move together changes with the pose.
pub(crate) fn mass_at_assembly<const N: usize>(robot: &Robot) -> Result<[[f64; N]; N], ConfigError> {
    let model = DriveModel::<N>::try_new(robot.clone())?;
    let mut state = model.at_rest();
    let mass = model.mass(&mut state);
    if model.freedoms() == N {
        return Ok(mass);
    }
    let largest = (0..N).fold(0.0_f64, |top, k| top.max(mass[k][k]));
    Ok(core::array::from_fn(|i| core::array::from_fn(|k| if i == k { largest } else { 0.0 })))
}
