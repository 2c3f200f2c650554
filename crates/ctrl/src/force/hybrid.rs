//! Hybrid position and force control \[Raibert1981\]: some coordinates of the task follow a path, the others a force.
//!
//! `x'_c = S·PID(f_ref − f)`, `Δq = ∫ J_inv·x'_c dt`, `q_ref = IK(x_ref) + Δq` \[Valera2017, eq. 15 and Figure 9\]. The inverse
//! kinematics is the caller's (`q_ref`); the position loop is any controller.

use crate::controller::{Command, ConfigError, Controller, Input};
use crate::fault::Limit;
use crate::force::explicit::{check_limits, stopped};
use crate::force::pid::{ForcePid, ForcePidConfig, ForcePidState, usable_dt};
use crate::force::task::TaskMap;

/// Numbers of a [`Hybrid`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HybridConfig<const N: usize, const M: usize> {
    /// Diagonal of S: 1 for a coordinate that follows a force, 0 for one that follows a path.
    pub selection: [f64; M],
    /// Force error to speed of the task `[m/s | rad/s]`.
    pub pid: ForcePidConfig<M>,
    /// Largest Δq of each drive `[m | rad]`.
    pub travel: [f64; N],
    /// The force loop rests where the task's margin is below this.
    pub margin: f64,
}

/// Hybrid position and force control around a position controller.
#[derive(Debug, Clone, PartialEq)]
pub struct Hybrid<const N: usize, const M: usize, K, C> {
    map: K,
    inner: C,
    config: HybridConfig<N, M>,
    pid: ForcePid<M>,
}

/// What a [`Hybrid`] remembers.
#[derive(Debug, Clone, PartialEq)]
pub struct HybridState<const N: usize, const M: usize, S, I> {
    map: S,
    inner: I,
    pid: ForcePidState<M>,
    /// Δq so far `[m | rad]`.
    pub travel: [f64; N],
    tau_safe: [f64; N],
    is_inner_saturated: bool,
    is_faulted: bool,
}

impl<const N: usize, const M: usize, K: TaskMap<N, M>, C: Controller<N>> Hybrid<N, M, K, C> {
    /// Checks the numbers.
    ///
    /// # Errors
    /// What [`ForcePid::try_new`] refuses; a selection outside 0 … 1, a travel that is not positive, a margin that is negative.
    pub fn try_new(map: K, inner: C, config: HybridConfig<N, M>) -> Result<Self, ConfigError> {
        if let Some(drive) = config.selection.iter().position(|s| !(0.0..=1.0).contains(s)) {
            return Err(ConfigError { drive, what: "selection", value: config.selection[drive], limit: "must be 0 to 1" });
        }
        check_limits("travel", &config.travel)?;
        if !(config.margin.is_finite() && config.margin >= 0.0) {
            return Err(ConfigError { drive: 0, what: "margin", value: config.margin, limit: "must be finite and >= 0" });
        }
        Ok(Self { map, inner, pid: ForcePid::try_new(config.pid)?, config })
    }
}

impl<const N: usize, const M: usize, K: TaskMap<N, M>, C: Controller<N>> Controller<N> for Hybrid<N, M, K, C> {
    type State = HybridState<N, M, K::State, C::State>;

    fn at_rest(&self) -> Self::State {
        HybridState {
            map: self.map.at_rest(),
            inner: self.inner.at_rest(),
            pid: ForcePidState::default(),
            travel: [0.0; N],
            tau_safe: [0.0; N],
            is_inner_saturated: false,
            is_faulted: false,
        }
    }

    /// One period. On a fault the command is the last finite feed-forward effort, or the inner controller's own safe command.
    /// Where the task cannot be known, or is near a singularity, the force loop rests and the position loop holds what it has.
    fn step(&self, state: &mut Self::State, input: &Input<N>) -> Command<N> {
        let wrenches = input.wrench_meas.iter().chain(&input.wrench_ref);
        let drives = [&input.q_meas, &input.q_ref, &input.v_ref, &input.tau_ff].into_iter().flatten();
        state.is_faulted |= wrenches.chain(drives).any(|x| !x.is_finite());
        if state.is_faulted {
            return stopped(state.tau_safe);
        }
        let dt = usable_dt(input.dt, self.config.pid.dt);
        let mut moved = Input { ..*input };
        let mut is_near = false;
        match self.map.at(&mut state.map, &input.q_meas).filter(|task| task.margin >= self.config.margin) {
            Some(task) => {
                let [measured, wanted] = self.map.forces(input, &task);
                let error = core::array::from_fn(|k| self.config.selection[k] * (measured[k] - wanted[k]));
                let (speed, _) = self.pid.step(&mut state.pid, &error, dt);
                let v = task.to_drives(&core::array::from_fn(|k| self.config.selection[k] * speed[k]));
                // A drive that pushes with all it has follows no further reference: integrating would only wind up.
                if !state.is_inner_saturated {
                    for (k, v) in v.into_iter().enumerate() {
                        let limit = self.config.travel[k];
                        state.travel[k] = (state.travel[k] + v * dt).clamp(-limit, limit);
                        moved.v_ref[k] += v;
                    }
                }
            }
            None => is_near = true,
        }
        for k in 0..N {
            moved.q_ref[k] += state.travel[k];
        }
        let mut command = self.inner.step(&mut state.inner, &moved);
        state.is_inner_saturated = command.health.is_saturated;
        state.is_faulted |= command.health.is_faulted || command.tau.iter().any(|t| !t.is_finite());
        if is_near {
            command.health.acted.note(Limit::Singularity, 0);
        }
        state.tau_safe = if state.is_faulted { command.tau.map(|t| if t.is_finite() { t } else { 0.0 }) } else { input.tau_ff };
        if state.is_faulted {
            command.tau = state.tau_safe;
            command.health.is_faulted = true;
        }
        command
    }
}
