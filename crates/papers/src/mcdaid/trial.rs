//! A foot on the robot: the force controller on the sampled linear model of drives and ankle, with Coulomb friction on the rods.

#![expect(non_snake_case, reason = "matrices carry the capital letters of the literature")]

use nalgebra::{DMatrix, DVector};
use pkm_ctrl::design::discretise::{Hold, discretise};
use pkm_ctrl::design::force_loop::DriveTrain;
use pkm_ctrl::force::{ActuatorForce, ActuatorForceConfig, ForceLaw, GainCurve, LinearTask};
use pkm_ctrl::{Controller, Input};
use pkm_dyn::math;

use super::ankle::{DT, K_D, force_loop, jacobian, null_direction, surroundings};
use crate::error::PaperError;
use crate::refused::refused;

const WHAT: &str = "trial with a foot";

/// Steps of the plant per control period.
const FINE: usize = 20;

/// Control periods of a trial: ten seconds, of which the first two are not counted.
const PERIODS: i32 = 5000;
const SETTLED_S: f64 = 2.0;

/// Commanded forces are brought in over this time: a step of all of them would ask for more than the drives have `[s]`.
const RISE_S: f64 = 1.5;

/// How the foot moves: most in flexion, a little in the other directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foot {
    /// Largest moment `[N·m]`.
    pub moment: f64,
    /// How fast it changes, against about one turn in two seconds.
    pub pace: f64,
}

/// What is left of commanded forces and moments.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Errors {
    /// Root mean square of the drives' force errors `[N]`.
    pub force: [f64; 4],
    /// Of the moments' errors `[N·m]`.
    pub moment: [f64; 3],
    /// Largest turn of the foot about x `[rad]`.
    pub reach: f64,
}

/// Drives and ankle between samples of a tenth of a millisecond.
struct Plant {
    A: DMatrix<f64>,
    B: DMatrix<f64>,
    C: DMatrix<f64>,
    x: DVector<f64>,
    coulomb: f64,
}

impl Plant {
    fn new(coulomb: f64) -> Result<Self, PaperError> {
        let plant = force_loop([0.0; 3], K_D)?.lagged().map_err(refused(WHAT))?;
        let fine = discretise(&plant, DT / FINE as f64, Hold::ZeroOrder).map_err(refused(WHAT))?;
        let [A, B, C, _] = fine.matrices();
        Ok(Self { A: A.clone(), B: B.clone(), C: C.clone(), x: DVector::zeros(26), coulomb })
    }

    fn force(&self) -> [f64; 4] {
        let F = &self.C * &self.x;
        core::array::from_fn(|k| F[k])
    }

    /// One control period under motor forces `tau` `[N]` and moments on the foot `[N·m]`.
    fn step(&mut self, tau: &[f64; 4], moment: [f64; 3]) {
        let mut u = DVector::zeros(11);
        for _ in 0..FINE {
            for k in 0..4 {
                u[k] = tau[k] / DriveTrain::ANKLE.force_constant();
                // The rods' speeds; friction comes in within a tenth of a millimetre per second.
                u[4 + k] = self.coulomb * math::tanh(self.x[14 + k] / 1e-4);
            }
            moment.iter().enumerate().for_each(|(k, m)| u[8 + k] = *m);
            self.x = &self.A * &self.x + &self.B * &u;
        }
    }
}

/// The legs at an orientation `[rad]` as a task: forces of the environment are moments about the ankle.
///
/// # Errors
/// An orientation at which the legs hold the foot no more.
pub fn legs(angles: [f64; 3]) -> Result<LinearTask<4, 3>, PaperError> {
    let J = jacobian(angles);
    let rows = core::array::from_fn(|i| core::array::from_fn(|k| J[(i, k)]));
    LinearTask::try_new([0.0; 4], [0.0; 3], rows, [3, 4, 5]).map_err(refused(WHAT))
}

fn controller(k: [f64; 4]) -> Result<ActuatorForce<4, 3, LinearTask<4, 3>>, PaperError> {
    let inertia = core::array::from_fn(|i| core::array::from_fn(|j| surroundings().inertia[(i, j)]));
    let law = ForceLaw::Directional { curves: [k[0], k[1], k[2]].map(GainCurve::constant), null: k[3] };
    let config = ActuatorForceConfig { law, inertia, derivative: K_D, tau_limit: [2000.0; 4], dt: DT };
    ActuatorForce::try_new(legs([0.0; 3])?, config).map_err(refused(WHAT))
}

/// Forces of `size` `[N]` along the direction that moves nothing.
///
/// # Errors
/// Never.
pub fn internal(size: f64) -> Result<[f64; 4], PaperError> {
    let v0 = null_direction([0.0; 3])?;
    Ok(core::array::from_fn(|k| size * v0[k]))
}

/// Ten seconds of a foot that moves while `commanded` forces `[N]` are held with gains `k`; `coulomb` friction on every rod `[N]`.
///
/// # Errors
/// Gains with which the loop runs into its limits.
pub fn try_out(k: [f64; 4], commanded: [f64; 4], coulomb: f64, foot: Foot) -> Result<Errors, PaperError> {
    let (controller, mut plant, J) = (controller(k)?, Plant::new(coulomb)?, jacobian([0.0; 3]));
    let mut state = controller.at_rest();
    let (mut force, mut moment, mut reach, mut count) = ([0.0; 4], [0.0; 3], 0.0_f64, 0.0);
    for period in 0..PERIODS {
        let t = DT * f64::from(period);
        let p = foot.pace * t;
        let push = [math::sin(3.0 * p), 0.4 * math::sin(4.1 * p + 0.5), 0.3 * math::sin(2.3 * p + 1.0)].map(|m| foot.moment * m);
        let measured = plant.force();
        let commanded = commanded.map(|f| f * (t / RISE_S).min(1.0));
        let input = Input { tau_meas: measured, tau_ff: commanded, ..Input::standing([0.0; 4], DT) };
        let command = controller.step(&mut state, &input);
        if command.health.is_faulted || command.health.is_saturated {
            return Err(PaperError::Other { what: WHAT, reason: format!("the loop runs into its limits at {t} s") });
        }
        plant.step(&command.tau, push);
        if t > SETTLED_S {
            let error = DVector::from_fn(4, |i, _| measured[i] - commanded[i]);
            let along = J.transpose() * &error;
            (0..4).for_each(|i| force[i] += error[i] * error[i]);
            (0..3).for_each(|i| moment[i] += along[i] * along[i]);
            reach = reach.max(plant.x[0].abs());
            count += 1.0;
        }
    }
    let rms = |sum: f64| math::sqrt(sum / count);
    Ok(Errors { force: force.map(rms), moment: moment.map(rms), reach })
}
