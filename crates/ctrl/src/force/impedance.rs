//! Impedance: the robot is a spring and a damper around its reference, with the wanted contact force added; no force is measured.
//!
//! `tau = tau_ff + Jᵀ·(K·e + D·e' − f_ref)`, e the error of the task. The mass that the environment feels is the robot's own.

use crate::controller::{Command, ConfigError, Controller, Health, Input};
use crate::fault::Limit;
use crate::filter::low_pass_share;
use crate::force::explicit::{check_limits, clipped, stopped};
use crate::force::pid::usable_dt;
use crate::force::task::TaskMap;
use crate::observer::Gap;

/// Numbers of an [`Impedance`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImpedanceConfig<const N: usize, const M: usize> {
    /// Stiffness of each coordinate of the task `[N/m | N·m/rad]`.
    pub stiffness: [f64; M],
    /// Damping of each coordinate of the task `[N·s/m | N·m·s/rad]`.
    pub damping: [f64; M],
    /// Largest force in each coordinate of the task, spring and damper together `[N | N·m]`.
    pub force_limit: [f64; M],
    /// Largest effort of each drive `[N | N·m]`.
    pub tau_limit: [f64; N],
    /// Time constant of the velocity filter `[s]`; 0 is the plain difference.
    pub filter_s: f64,
    /// Control period `[s]`.
    pub dt: f64,
}

/// Impedance control in the coordinates of a task.
#[derive(Debug, Clone, PartialEq)]
pub struct Impedance<const N: usize, const M: usize, K> {
    map: K,
    config: ImpedanceConfig<N, M>,
}

/// What an [`Impedance`] remembers.
#[derive(Debug, Clone, PartialEq)]
pub struct ImpedanceState<const N: usize, S> {
    map: S,
    q_last: [f64; N],
    gap: Gap<N>,
    v_hat: [f64; N],
    tau_safe: [f64; N],
    has_started: bool,
    is_faulted: bool,
}

impl<const N: usize, const M: usize, K: TaskMap<N, M>> Impedance<N, M, K> {
    /// Checks the numbers.
    ///
    /// # Errors
    /// Stiffness or damping that is negative, limits or a period that are not positive, anything that is not finite.
    pub fn try_new(map: K, config: ImpedanceConfig<N, M>) -> Result<Self, ConfigError> {
        for (what, values) in [("stiffness", &config.stiffness), ("damping", &config.damping)] {
            if let Some(drive) = values.iter().position(|x| !(x.is_finite() && *x >= 0.0)) {
                return Err(ConfigError { drive, what, value: values[drive], limit: "must be finite and >= 0" });
            }
        }
        check_limits("force_limit", &config.force_limit)?;
        check_limits("tau_limit", &config.tau_limit)?;
        check_limits("dt", &[config.dt])?;
        if !(config.filter_s.is_finite() && config.filter_s >= 0.0) {
            return Err(ConfigError { drive: 0, what: "filter_s", value: config.filter_s, limit: "must be finite and >= 0" });
        }
        Ok(Self { map, config })
    }
}

impl<const N: usize, const M: usize, K: TaskMap<N, M>> Controller<N> for Impedance<N, M, K> {
    type State = ImpedanceState<N, K::State>;

    fn at_rest(&self) -> Self::State {
        let zero = [0.0; N];
        let (map, gap) = (self.map.at_rest(), Gap::default());
        ImpedanceState { map, q_last: zero, gap, v_hat: zero, tau_safe: zero, has_started: false, is_faulted: false }
    }

    /// One period. On a fault the command is the last finite feed-forward effort; where the task cannot be known it is the present one.
    ///
    /// The error is `J·(q_ref − q)`: zero where it should be, the task's own error to first order.
    fn step(&self, state: &mut Self::State, input: &Input<N>) -> Command<N> {
        let drives = [&input.q_meas, &input.q_ref, &input.v_ref, &input.tau_ff].into_iter().flatten();
        state.is_faulted |= drives.chain(&input.wrench_ref).any(|x| !x.is_finite());
        if state.is_faulted {
            return stopped(state.tau_safe);
        }
        let c = &self.config;
        let dt = usable_dt(input.dt, c.dt);
        let share = low_pass_share(c.filter_s, dt);
        let over_gap = state.gap.ended(input);
        for k in 0..N {
            let difference = if state.has_started { (input.q_meas[k] - state.q_last[k]) / dt } else { 0.0 };
            let filtered = state.v_hat[k] + share * (difference - state.v_hat[k]);
            state.v_hat[k] = over_gap.map_or(filtered, |v| v[k]);
        }
        let (mut tau, mut health) = (input.tau_ff, Health::default());
        if let Some(task) = self.map.at(&mut state.map, &input.q_meas) {
            let error = task.of_drives(&core::array::from_fn(|k| input.q_ref[k] - input.q_meas[k]));
            let rate = task.of_drives(&core::array::from_fn(|k| input.v_ref[k] - state.v_hat[k]));
            let [_, wanted] = self.map.forces(input, &task);
            let force = core::array::from_fn(|k| {
                let own = c.stiffness[k] * error[k] + c.damping[k] * rate[k];
                own.clamp(-c.force_limit[k], c.force_limit[k]) - wanted[k]
            });
            let push = task.efforts(&force);
            (0..N).for_each(|k| tau[k] += push[k]);
        } else {
            health.acted.note(Limit::Singularity, 0);
        }
        state.is_faulted |= tau.iter().any(|t| t.is_nan());
        if state.is_faulted {
            return stopped(state.tau_safe);
        }
        state.tau_safe = core::array::from_fn(|k| input.tau_ff[k].clamp(-c.tau_limit[k], c.tau_limit[k]));
        state.q_last = input.q_meas;
        state.has_started = true;
        Command { tau: clipped(&tau, &c.tau_limit, &mut health), health }
    }
}
