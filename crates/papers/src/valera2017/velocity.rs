//! Section 4: computed torque with the velocity observer (14) or with differences of positions, on a robot that the controller has a little
//! wrong.

use pkm_ctrl::observer::{CommandedAcceleration, Discretisation, FirstDifference, VelocityObserver};
use pkm_ctrl::{ComputedTorque, ComputedTorqueConfig, Controller, Input};
use pkm_dyn::effects::Robot;
use pkm_dyn::math;
use pkm_dyn::parameters::InertialParameters;
use pkm_sim::{Plant, ReducedPlant};

use crate::chance::Chance;
use crate::error::PaperError;
use crate::robot::shipped;
use crate::series::{deviation, mean, range, rms};

/// Control period `[s]`.
const TS: f64 = 0.01;

/// Periods of a run: three of the reference.
const PERIODS: u32 = 1200;

/// Judged from here on `[s]`: the second and third period.
const SETTLED_S: f64 = 4.0;

/// Coulomb `[N]` and viscous `[N·s/m]` friction of the sliders, from a recording of the real robot.
const COULOMB: [f64; 3] = [105.0, 160.0, 127.0];
const VISCOUS: [f64; 3] = [2242.0, 2170.0, 1873.0];

/// Speed below which the compensated dry friction fades `[m/s]`.
const CREEP: f64 = 0.002;

/// One closed loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Loop {
    /// Stiffness `[1/s²]` and damping `[1/s]` of the error dynamics.
    pub gains: [f64; 2],
    /// White noise of the positions, standard deviation `[m]`.
    pub noise: f64,
    /// Width of a count of the encoders `[m]`.
    pub quantum: f64,
    /// The controller's friction and masses as shares of the robot's.
    pub shares: [f64; 2],
}

/// The loop that comes nearest to Table 2: 0.11 mm of noise, friction 3 % and masses 5 % wrong.
pub const TABLE_2: Loop = Loop { gains: [100.0, 20.0], noise: 1.1e-4, quantum: 2e-5, shares: [0.97, 1.05] };

/// Quantisation alone, with gains and observer four times as fast.
pub const QUANTISED: Loop = Loop { gains: [400.0, 40.0], noise: 0.0, quantum: 2e-5, shares: [0.97, 1.05] };

/// The simulation of section 4: the model is the robot.
pub const EXACT: Loop = Loop { gains: [100.0, 20.0], noise: 0.0, quantum: 2e-5, shares: [1.0, 1.0] };

/// Slider 1 in one period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instant {
    /// Time `[s]`.
    pub t: f64,
    /// True position `[m]` and velocity `[m/s]`.
    pub motion: [f64; 2],
    /// Estimate of the velocity `[m/s]`.
    pub v_hat: f64,
    /// Command `[N]`.
    pub tau: f64,
    /// Reference, position `[m]` and velocity `[m/s]`.
    pub wanted: [f64; 2],
}

/// What Table 2 says of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Mean of the velocity estimate less the reference `[m/s]`.
    pub velocity_mean: f64,
    /// Standard deviation of it `[m/s]`.
    pub velocity_std: f64,
    /// The same as a share of the reference's range.
    pub velocity_share: f64,
    /// Standard deviation of the estimate less the true velocity `[m/s]`.
    pub velocity_truth: f64,
    /// Lag of the estimate's fundamental behind the reference `[rad]`.
    pub velocity_lag: f64,
    /// Mean and standard deviation of the position less the reference `[m]`.
    pub position: [f64; 2],
    /// Lag of the position `[rad]`.
    pub position_lag: f64,
    /// Root mean square of the command's increments `[N]`.
    pub increment: f64,
}

/// First-order differences in `setting`.
///
/// # Errors
/// A controller that faults or saturates.
pub fn with_difference(setting: &Loop) -> Result<Vec<Instant>, PaperError> {
    run(FirstDifference, setting)
}

/// The observer (14) with both poles at `1 − bandwidth·Ts`, `bandwidth` in `[1/s]`.
///
/// # Errors
/// As [`with_difference`], and a bandwidth that is none.
pub fn with_observer(bandwidth: f64, setting: &Loop) -> Result<Vec<Instant>, PaperError> {
    run(CommandedAcceleration::try_new([bandwidth; 3], Discretisation::Euler)?, setting)
}

/// The robot with friction and masses times `shares`; rotors as they are.
fn robot([friction, mass]: [f64; 2]) -> Result<Robot, PaperError> {
    let mut model = shipped("prs3")?.robot.model;
    for (k, j) in model.actuators.clone().into_iter().enumerate() {
        (model.joints[j].coulomb, model.joints[j].viscous) = (friction * COULOMB[k], friction * VISCOUS[k]);
    }
    for body in &mut model.bodies {
        *body = InertialParameters::from_vector(&(body.to_vector() * mass));
    }
    Ok(Robot::new(model, Vec::new()))
}

/// Four seconds per period, each slider with a third harmonic: positions, velocities, accelerations.
fn reference(t: f64) -> [[f64; 3]; 3] {
    let w = core::f64::consts::FRAC_PI_2;
    let part = |k: usize| (0.05, [0.012, -0.006, -0.006][k], [0.0, 0.4, -0.4][k]);
    let row = |f: &dyn Fn(f64, f64, f64) -> f64| core::array::from_fn(|k| f(part(k).0, part(k).1, part(k).2));
    [
        row(&|a, b, p| 0.1 + a * math::sin(w * t + p) - a * math::sin(p) + b * math::sin(3.0 * w * t)),
        row(&|a, b, p| a * w * math::cos(w * t + p) + 3.0 * w * b * math::cos(3.0 * w * t)),
        row(&|a, b, p| -a * w * w * math::sin(w * t + p) - 9.0 * w * w * b * math::sin(3.0 * w * t)),
    ]
}

fn run<O: VelocityObserver<3>>(observer: O, setting: &Loop) -> Result<Vec<Instant>, PaperError> {
    let [kp, kd] = setting.gains;
    let config = ComputedTorqueConfig { kp: [kp; 3], kd: [kd; 3], creep: CREEP, ..ComputedTorqueConfig::with_bandwidth(1.0, [5000.0; 3]) };
    let law = ComputedTorque::try_new(robot(setting.shares)?, observer, config)?;
    let [start, moving, _] = reference(0.0);
    let mut plant = ReducedPlant::try_new(robot([1.0, 1.0])?, &start)?;
    plant.set_velocity(&moving);
    let mut state = law.in_motion(&start, &moving);
    let (mut chance, mut out) = (Chance::new(17), Vec::new());
    for k in 0..PERIODS {
        let t = TS * f64::from(k);
        let [q_ref, v_ref, a_ref] = reference(t);
        let q_meas = core::array::from_fn(|i| {
            let q = plant.position()[i] + setting.noise * chance.normal();
            if setting.quantum > 0.0 { math::round(q / setting.quantum) * setting.quantum } else { q }
        });
        let command = law.step(&mut state, &Input { q_ref, v_ref, a_ref, ..Input::standing(q_meas, TS) });
        if command.health.is_faulted || command.health.is_saturated {
            return Err(PaperError::Other { what: "velocity observer", reason: format!("faulted or saturated at {t} s") });
        }
        let motion = [plant.position()[0], plant.velocity()[0]];
        out.push(Instant { t, motion, v_hat: state.v_hat[0], tau: command.tau[0], wanted: [q_ref[0], v_ref[0]] });
        for _ in 0..4 {
            plant.step(&command.tau, 0.25 * TS)?;
        }
    }
    Ok(out)
}

/// What Table 2 says of a run, its beginning left out.
#[must_use]
pub fn figures(run: &[Instant]) -> Figures {
    let settled: Vec<&Instant> = run.iter().filter(|i| i.t >= SETTLED_S).collect();
    let column = |f: &dyn Fn(&Instant) -> f64| settled.iter().map(|i| f(i)).collect::<Vec<f64>>();
    let (v_ref, q_ref) = (column(&|i| i.wanted[1]), column(&|i| i.wanted[0]));
    let error = column(&|i| i.v_hat - i.wanted[1]);
    let position = column(&|i| i.motion[0] - i.wanted[0]);
    let tau = column(&|i| i.tau);
    let phase = |x: &[f64]| {
        let mean = mean(x);
        let part = |f: &dyn Fn(f64) -> f64| -> f64 {
            settled.iter().zip(x).map(|(i, x)| (x - mean) * f(i.t * core::f64::consts::FRAC_PI_2)).sum()
        };
        math::atan2(-part(&math::sin), part(&math::cos))
    };
    Figures {
        velocity_mean: mean(&error),
        velocity_std: deviation(&error),
        velocity_share: deviation(&error) / range(&v_ref),
        velocity_truth: deviation(&column(&|i| i.v_hat - i.motion[1])),
        velocity_lag: phase(&v_ref) - phase(&column(&|i| i.v_hat)),
        position: [mean(&position), deviation(&position)],
        position_lag: phase(&q_ref) - phase(&column(&|i| i.motion[0])),
        increment: rms(&tau.windows(2).map(|w| w[1] - w[0]).collect::<Vec<f64>>()),
    }
}
