//! Force control of all drives together \[McDaid\]: gains belong to directions of the robot, not to drives.
//!
//! `tau = G·F_cmd − H·F*`, with the commanded forces `F_cmd` in `tau_ff`, the measured ones in `tau_meas`, and
//! `F* = F + k_d/dt·(F − F_last)`. The command is the motors' force at the drives; currents are it divided by `K_t·K_a`.

use pkm_dyn::svd::Svd;

use crate::controller::{Command, ConfigError, Controller, Health, Input};
use crate::fault::Limit;
use crate::force::curve::GainCurve;
use crate::force::explicit::{check_limits, clipped, stopped};
use crate::force::gains::{Decoupling, Square, decoupling, directional, inverse_of, room, times};
use crate::force::pid::usable_dt;
use crate::force::task::{Task, TaskMap};

/// Where the gains come from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ForceLaw<const M: usize> {
    /// `G = I + K`, `H = K` along the directions of the effective mass \[McDaid, eq. 8.48\]: the final law, of gain one in every direction.
    Directional {
        /// Gains over the singular value of each direction, for falling singular values.
        curves: [GainCurve; M],
        /// Gain on efforts that move nothing.
        null: f64,
    },
    /// The decoupling disturbance observer \[McDaid, eq. 8.13\].
    Decoupling(Decoupling),
}

/// Numbers of an [`ActuatorForce`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActuatorForceConfig<const N: usize, const M: usize> {
    /// Where the gains come from.
    pub law: ForceLaw<M>,
    /// Inertia of platform and patient in the task, symmetric `[kg | kg·m²]`.
    pub inertia: [[f64; M]; M],
    /// Derivative time `k_d` of the force filter `[s]`; 0 feeds the force back as it is.
    pub derivative: f64,
    /// Largest effort of each drive `[N | N·m]`.
    pub tau_limit: [f64; N],
    /// Control period `[s]`.
    pub dt: f64,
}

/// Force control of all drives together.
#[derive(Debug, Clone, PartialEq)]
pub struct ActuatorForce<const N: usize, const M: usize, K> {
    map: K,
    config: ActuatorForceConfig<N, M>,
    inertia_inverse: [[f64; M]; M],
}

/// What an [`ActuatorForce`] remembers.
#[derive(Debug, Clone, PartialEq)]
pub struct ActuatorForceState<const N: usize, S> {
    map: S,
    svd: Svd,
    /// G and H of the last pose that had any.
    gains: [Square<N>; 2],
    force_last: [f64; N],
    tau_safe: [f64; N],
    has_started: bool,
    is_faulted: bool,
}

impl<const N: usize, const M: usize, K: TaskMap<N, M>> ActuatorForce<N, M, K> {
    /// Checks the numbers.
    ///
    /// # Errors
    /// An inertia that is not positive definite, shares outside 0 … 1, gains, limits or a period out of range, anything not finite.
    pub fn try_new(map: K, config: ActuatorForceConfig<N, M>) -> Result<Self, ConfigError> {
        let bad = |drive, what, value, limit| Err(ConfigError { drive, what, value, limit });
        check_limits("tau_limit", &config.tau_limit)?;
        check_limits("dt", &[config.dt])?;
        for i in 0..M {
            for k in 0..i {
                let skew = config.inertia[i][k] - config.inertia[k][i];
                if skew.is_nan() || skew.abs() > 1e-12 * (config.inertia[i][i].abs() + config.inertia[k][k].abs()) {
                    return bad(i, "inertia", skew, "must be symmetric");
                }
            }
        }
        let Some(inertia_inverse) = inverse_of(&config.inertia) else {
            return bad(0, "inertia", config.inertia[0][0], "must be positive definite");
        };
        if !(config.derivative.is_finite() && config.derivative >= 0.0) {
            return bad(0, "derivative", config.derivative, "must be finite and >= 0");
        }
        match config.law {
            ForceLaw::Directional { null, .. } if !(null.is_finite() && null >= 0.0) => {
                return bad(0, "null", null, "must be finite and >= 0");
            }
            ForceLaw::Decoupling(d) => {
                for (what, value) in [("share", d.share), ("null_share", d.null_share)] {
                    if !(0.0..1.0).contains(&value) {
                        return bad(0, what, value, "must be >= 0 and < 1");
                    }
                }
                if !(0.0..=1.0).contains(&d.power) {
                    return bad(0, "power", d.power, "must be 0 to 1");
                }
                check_limits("apparent_mass", &[d.apparent_mass])?;
            }
            ForceLaw::Directional { .. } => {}
        }
        Ok(Self { map, config, inertia_inverse })
    }

    /// G and H at a pose; none where a number is none.
    pub fn gains(&self, svd: &mut Svd, task: &Task<N, M>) -> Option<[Square<N>; 2]> {
        match &self.config.law {
            ForceLaw::Directional { curves, null } => {
                let H = directional(svd, task, &self.config.inertia, curves, *null)?;
                let mut G = H;
                (0..N).for_each(|i| G[i][i] += 1.0);
                Some([G, H])
            }
            ForceLaw::Decoupling(numbers) => decoupling(svd, task, &self.inertia_inverse, numbers),
        }
    }
}

impl<const N: usize, const M: usize, K: TaskMap<N, M>> Controller<N> for ActuatorForce<N, M, K> {
    type State = ActuatorForceState<N, K::State>;

    const FOLLOWS_REFERENCE: bool = false;

    fn at_rest(&self) -> Self::State {
        // Until a pose is known: the commanded force and no feedback.
        let mut one = [[0.0; N]; N];
        (0..N).for_each(|i| one[i][i] = 1.0);
        let zero = [0.0; N];
        ActuatorForceState {
            map: self.map.at_rest(),
            svd: room(N),
            gains: [one, [[0.0; N]; N]],
            force_last: zero,
            tau_safe: zero,
            has_started: false,
            is_faulted: false,
        }
    }

    /// One period. On a fault the command is the last finite commanded force, without feedback. Where the loops do not close the gains of
    /// the last pose stay.
    fn step(&self, state: &mut Self::State, input: &Input<N>) -> Command<N> {
        let signals = [&input.q_meas, &input.tau_meas, &input.tau_ff];
        state.is_faulted |= signals.into_iter().flatten().any(|x| !x.is_finite());
        if state.is_faulted {
            return stopped(state.tau_safe);
        }
        let mut health = Health::default();
        match self.map.at(&mut state.map, &input.q_meas).and_then(|task| self.gains(&mut state.svd, &task)) {
            Some(gains) => state.gains = gains,
            None => health.acted.note(Limit::Singularity, 0),
        }
        let rate = self.config.derivative / usable_dt(input.dt, self.config.dt);
        let last = if state.has_started { state.force_last } else { input.tau_meas };
        let filtered = core::array::from_fn(|k| input.tau_meas[k] + rate * (input.tau_meas[k] - last[k]));
        let [G, H] = &state.gains;
        let (forward, back) = (times(G, &input.tau_ff), times(H, &filtered));
        let tau: [f64; N] = core::array::from_fn(|k| forward[k] - back[k]);
        state.is_faulted |= tau.iter().any(|t| t.is_nan());
        if state.is_faulted {
            return stopped(state.tau_safe);
        }
        state.force_last = input.tau_meas;
        state.has_started = true;
        let limit = &self.config.tau_limit;
        state.tau_safe = core::array::from_fn(|k| input.tau_ff[k].clamp(-limit[k], limit[k]));
        Command { tau: clipped(&tau, limit, &mut health), health }
    }
}
