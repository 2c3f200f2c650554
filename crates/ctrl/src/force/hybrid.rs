//! Hybrid position and force control \[Raibert1981\]: some coordinates of the task follow a path, the others a force.
//!
//! `x'_c = S·PID(f_ref − f)`, `Δq = ∫ J_inv·x'_c dt`, `q_ref = IK(x_ref) + Δq` \[Valera2017, eq. 15 and Figure 9\]. The inverse
//! kinematics is the caller's (`q_ref`); the position loop is any controller.

use crate::controller::{Command, ConfigError, Controller, Input, first_not_finite};
use crate::fault::{FaultCode, Limit};
use crate::force::explicit::check_limits;
use crate::force::held::Held;
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
    held: Held<N>,
    is_inner_saturated: bool,
}

impl<const N: usize, const M: usize, K: TaskMap<N, M>, C: Controller<N>> Hybrid<N, M, K, C> {
    /// Checks the numbers.
    ///
    /// # Errors
    /// What [`ForcePid::try_new`] refuses; a selection that is neither 0 nor 1, a travel that is not positive, a margin that is negative.
    pub fn try_new(map: K, inner: C, config: HybridConfig<N, M>) -> Result<Self, ConfigError> {
        // A share in between would count twice, in the error and in the speed, and still leave the path to the caller.
        if let Some(drive) = config.selection.iter().position(|s| !(s.abs() <= 0.0 || (s - 1.0).abs() <= 0.0)) {
            return Err(ConfigError { drive, what: "selection", value: config.selection[drive], limit: "must be 0 or 1" });
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

    const FOLLOWS_REFERENCE: bool = C::FOLLOWS_REFERENCE;

    fn at_rest(&self) -> Self::State {
        HybridState {
            map: self.map.at_rest(),
            inner: self.inner.at_rest(),
            pid: ForcePidState::default(),
            travel: [0.0; N],
            held: Held::new(),
            is_inner_saturated: false,
        }
    }

    /// One period. After a fault the inner controller holds the reference it had, and its clipped command carries the robot.
    /// Where the task cannot be known, or is near a singularity, the force loop rests and the position loop holds what it has.
    fn step(&self, state: &mut Self::State, input: &Input<N>) -> Command<N> {
        let signals = [
            (FaultCode::WrenchNotFinite, &input.wrench_meas[..]),
            (FaultCode::ReferenceNotFinite, &input.wrench_ref),
            (FaultCode::PositionNotFinite, &input.q_meas),
            (FaultCode::ReferenceNotFinite, &input.q_ref),
            (FaultCode::ReferenceNotFinite, &input.v_ref),
            (FaultCode::ReferenceNotFinite, &input.tau_ff),
        ];
        if state.held.stops_at(first_not_finite(&signals)) {
            return state.held.hold(&self.inner, &mut state.inner, input);
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
        let mut command = state.held.follow(&self.inner, &mut state.inner, &moved);
        state.is_inner_saturated = command.health.is_saturated;
        if is_near {
            command.health.acted.note(Limit::Singularity, 0);
        }
        command
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::LinearTask;
    use crate::pd_gravity::{PdGravity, PdGravityConfig};

    #[test]
    fn a_coordinate_follows_a_force_or_a_path() {
        let map = LinearTask::try_new([0.0], [0.0], [[1.0]], [2]).unwrap();
        let inner = PdGravity::try_new(PdGravityConfig { kp: [1.0], kd: [1.0], tau_limit: [1.0], dt: 0.01, filter_s: 0.0 }).unwrap();
        let pid = ForcePidConfig { kp: [1.0], ki: [0.0], kd: [0.0], output_limit: [1.0], rate_limit: [1.0], filter_s: 0.0, dt: 0.01 };
        let with = |s: f64| Hybrid::try_new(map, inner, HybridConfig { selection: [s], pid, travel: [0.1], margin: 0.0 });
        assert!(with(0.0).is_ok() && with(1.0).is_ok());
        for s in [0.5, -1.0, 2.0, f64::NAN] {
            assert_eq!(with(s).expect_err("neither").what, "selection");
        }
    }
}
