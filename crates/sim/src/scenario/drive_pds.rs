//! The controller of a run that names none: a PD per drive with the weight as feed-forward, scaled with the inertia in the middle of travel.

use pkm_ctrl::catalogue::Drives;
use pkm_ctrl::{About, Controller, Health, Input, PdGravity, PdGravityConfig, PdGravityState, Running, Signals};
use pkm_dyn::Data;
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{assemble, mid_pose, walk_to};
use pkm_dyn::model::Model;

use crate::error::SimError;
use crate::plant::check;

/// Bandwidth of the position loop `[rad/s]` (8 Hz): stable with the lags and delays of common drives, stiff enough to track.
const BANDWIDTH: f64 = 50.0;

/// Damping ratio of the position loop.
const DAMPING: f64 = 0.9;

/// Time constant of the controller's velocity filter `[s]`.
const FILTER_S: f64 = 1e-3;

/// A PD per drive.
pub(super) struct DrivePds {
    drives: Vec<(PdGravity<1>, PdGravityState<1>)>,
    about: About,
    health: Health,
}

impl DrivePds {
    /// For `model`, at a period `[s]`.
    pub(super) fn try_new(model: &Model, period: f64) -> Result<Self, SimError> {
        let mut drives = Vec::new();
        for (&j, mass) in model.actuators.iter().zip(mass_at_mid_pose(model)?) {
            let limit = model.joints[j].limits.effort;
            let config = PdGravityConfig {
                kp: [mass * BANDWIDTH * BANDWIDTH],
                kd: [mass * 2.0 * DAMPING * BANDWIDTH],
                tau_limit: [if limit.is_finite() && limit > 0.0 { limit } else { f64::MAX }],
                dt: period,
                filter_s: FILTER_S,
            };
            drives.push((PdGravity::try_new(config)?, PdGravityState::default()));
        }
        let name = "pd_gravity".to_string();
        let about = About { name, rate_hz: 1.0 / period, drives: Drives::Effort, effort_per_rate: Vec::new(), n_drives: drives.len() };
        Ok(Self { drives, about, health: Health::default() })
    }
}

impl Running for DrivePds {
    fn about(&self) -> &About {
        &self.about
    }

    fn step(&mut self, signals: &Signals<'_>, tau: &mut [f64]) -> Health {
        self.health = Health::default();
        for (k, ((controller, state), tau)) in self.drives.iter_mut().zip(tau).enumerate() {
            let input = Input {
                q_dt: signals.q_dt,
                q_ref: [signals.q_ref[k]],
                v_ref: [signals.v_ref[k]],
                tau_ff: [signals.tau_ff[k]],
                ..Input::standing([signals.q_meas[k]], signals.dt)
            };
            let command = controller.step(state, &input);
            *tau = command.tau[0];
            self.health.is_faulted |= command.health.is_faulted;
            self.health.is_saturated |= command.health.is_saturated;
        }
        self.health
    }

    fn health(&self) -> Health {
        self.health
    }

    fn reset(&mut self) {
        for (_, state) in &mut self.drives {
            *state = PdGravityState::default();
        }
        self.health = Health::default();
    }
}

/// Diagonal of the nominal mass matrix in the middle of travel `[kg | kg·m²]`; what the gains are scaled with.
fn mass_at_mid_pose(model: &Model) -> Result<Vec<f64>, SimError> {
    let mut data = Data::new(model);
    let (n, middle) = (model.n_act(), mid_pose(model));
    let zero = vec![0.0; n];
    for closure in [assemble(model, &mut data), walk_to(model, &mut data, &middle)] {
        check(&closure, 0.0)?;
    }
    let mut effort = |a: &[f64], k: usize| -> Result<f64, SimError> {
        check(&inverse_dynamics(model, &mut data, &middle, &zero, a), 0.0)?;
        Ok(data.tau_act[k])
    };
    let mut masses = Vec::new();
    for k in 0..n {
        let mut unit = zero.clone();
        unit[k] = 1.0;
        masses.push(effort(&unit, k)? - effort(&zero, k)?);
    }
    // A surplus drive is no coordinate of its own: as much as the lightest that is.
    let is_own = |k: usize| data.independent.contains(&model.actuators[k]);
    let least = (0..n).filter(|k| is_own(*k)).map(|k| masses[k]).fold(f64::INFINITY, f64::min);
    for k in (0..n).filter(|k| !is_own(*k)) {
        masses[k] = least;
    }
    Ok(masses)
}
