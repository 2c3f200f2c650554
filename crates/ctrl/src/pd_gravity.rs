//! Joint PD with a feed-forward effort: `tau = tau_ff + kp·(q_ref − q) + kd·(v_ref − v̂)`, each drive for itself.
//!
//! The velocity estimate is the first difference of the measured position through a first-order low-pass.

use crate::controller::{Command, ConfigError, Controller, Health, Input, must_be_usable};
use crate::fault::{Fault, FaultCode};
use crate::filter::low_pass_share;
use crate::observer::Gap;

/// Numbers of a [`PdGravity`]; arrays have one entry per drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PdGravityConfig<const N: usize> {
    /// Stiffness of the position loop `[N/m | N·m/rad]`.
    pub kp: [f64; N],
    /// Damping of the position loop `[N·s/m | N·m·s/rad]`.
    pub kd: [f64; N],
    /// Largest effort of each drive `[N | N·m]`.
    pub tau_limit: [f64; N],
    /// Control period `[s]`.
    pub dt: f64,
    /// Time constant of the velocity filter `[s]`; 0 is the plain difference.
    pub filter_s: f64,
}

/// Joint PD with a feed-forward effort.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PdGravity<const N: usize> {
    config: PdGravityConfig<N>,
}

/// What a [`PdGravity`] remembers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PdGravityState<const N: usize> {
    q_last: [f64; N],
    gap: Gap<N>,
    /// Velocity estimate `[m/s | rad/s]`.
    pub v_hat: [f64; N],
    tau_safe: [f64; N],
    has_started: bool,
    fault: Option<Fault>,
}

impl<const N: usize> Default for PdGravityState<N> {
    fn default() -> Self {
        Self { q_last: [0.0; N], gap: Gap::default(), v_hat: [0.0; N], tau_safe: [0.0; N], has_started: false, fault: None }
    }
}

impl<const N: usize> PdGravity<N> {
    /// Checks the numbers.
    ///
    /// # Errors
    /// Gains that are negative, limits or a period that are not positive, anything that is not finite.
    pub fn try_new(config: PdGravityConfig<N>) -> Result<Self, ConfigError> {
        let bad = |drive, what, value, limit| Err(ConfigError { drive, what, value, limit });
        for k in 0..N {
            for (what, value) in [("kp", config.kp[k]), ("kd", config.kd[k])] {
                if !(value.is_finite() && value >= 0.0) {
                    return bad(k, what, value, "must be finite and >= 0");
                }
            }
            let limit = config.tau_limit[k];
            if !(limit.is_finite() && limit > 0.0) {
                return bad(k, "tau_limit", limit, "must be finite and > 0");
            }
        }
        if !(config.dt.is_finite() && config.dt > 0.0) {
            return bad(0, "dt", config.dt, "must be finite and > 0");
        }
        if !(config.filter_s.is_finite() && config.filter_s >= 0.0) {
            return bad(0, "filter_s", config.filter_s, "must be finite and >= 0");
        }
        Ok(Self { config })
    }

    fn clip(&self, k: usize, tau: f64) -> f64 {
        tau.clamp(-self.config.tau_limit[k], self.config.tau_limit[k])
    }
}

impl<const N: usize> Controller<N> for PdGravity<N> {
    type State = PdGravityState<N>;

    fn at_rest(&self) -> Self::State {
        PdGravityState::default()
    }

    /// One period. On a fault the command is the last finite feed-forward effort: it carries the weight and pushes no further.
    fn step(&self, state: &mut Self::State, input: &Input<N>) -> Command<N> {
        let signals = [&input.q_meas, &input.q_ref, &input.v_ref, &input.tau_ff];
        state.fault = state.fault.or_else(|| must_be_usable(&signals, input.dt).err());
        if state.fault.is_some() {
            return Command::faulted(state.tau_safe, state.fault);
        }
        let share = low_pass_share(self.config.filter_s, input.dt);
        let over_gap = state.gap.ended(input);
        let mut command = Command { tau: [0.0; N], health: Health::default() };
        for k in 0..N {
            // Before the second sample there is no difference: taking the first position for the last one reads as standstill.
            let difference = if state.has_started { (input.q_meas[k] - state.q_last[k]) / input.dt } else { 0.0 };
            let filtered = state.v_hat[k] + share * (difference - state.v_hat[k]);
            state.v_hat[k] = over_gap.map_or(filtered, |v| v[k]);
            let wanted = input.tau_ff[k]
                + self.config.kp[k] * (input.q_ref[k] - input.q_meas[k])
                + self.config.kd[k] * (input.v_ref[k] - state.v_hat[k]);
            // Finite inputs can still overflow the sum: an effort that is not a number must not reach a drive.
            if wanted.is_nan() {
                state.fault = state.fault.or(Some(Fault { code: FaultCode::CommandNotFinite, drive: k, value: wanted, limit: 0.0 }));
            }
            command.tau[k] = self.clip(k, wanted);
            command.health.is_saturated |= wanted.abs() > self.config.tau_limit[k];
            if state.fault.is_none() {
                state.tau_safe[k] = self.clip(k, input.tau_ff[k]);
            }
        }
        if state.fault.is_some() {
            return Command::faulted(state.tau_safe, state.fault);
        }
        state.q_last = input.q_meas;
        state.has_started = true;
        command
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_dyn::math;

    fn controller() -> PdGravity<2> {
        PdGravity::try_new(PdGravityConfig { kp: [100.0, 50.0], kd: [10.0, 5.0], tau_limit: [20.0, 8.0], dt: 1e-3, filter_s: 0.0 }).unwrap()
    }

    fn at_rest() -> Input<2> {
        Input { tau_ff: [3.0, -1.5], ..Input::standing([0.1, -0.2], 1e-3) }
    }

    #[test]
    fn at_standstill_on_the_reference_it_sends_the_feed_forward() {
        let mut state = PdGravityState::default();
        for _ in 0..3 {
            let command = controller().step(&mut state, &at_rest());
            assert_eq!(command, Command { tau: [3.0, -1.5], health: Health::default() });
        }
    }

    #[test]
    fn a_step_of_the_reference_pushes_towards_it_and_motion_is_damped() {
        let mut state = PdGravityState::default();
        let mut input = at_rest();
        input.q_ref[0] += 0.05;
        let first = controller().step(&mut state, &input).tau[0];
        assert!((first - 8.0).abs() < 1e-12, "{first}");
        input.q_meas[0] += 1e-4;
        // The difference of 1e-4 m in 1 ms is 0.1 m/s: 3 + 100·0.0499 − 10·0.1.
        let second = controller().step(&mut state, &input).tau[0];
        assert!((second - 6.99).abs() < 1e-9, "{second}");
    }

    #[test]
    fn the_velocity_filter_reaches_63_percent_after_its_time_constant() {
        let config = PdGravityConfig { kp: [0.0], kd: [1.0], tau_limit: [1e9], dt: 1e-3, filter_s: 0.02 };
        let controller = PdGravity::try_new(config).unwrap();
        let mut state = PdGravityState::default();
        for k in 0..=20 {
            let _ = controller.step(&mut state, &Input { q_meas: [0.7e-3 * f64::from(k)], ..Input::standing([0.0], 1e-3) });
        }
        assert!((state.v_hat[0] - 0.7 * (1.0 - math::exp(-1.0))).abs() < 1e-9, "{}", state.v_hat[0]);
    }

    #[test]
    fn a_period_of_an_overrun_is_one_long_sample_and_one_that_is_none_a_fault() {
        let config = PdGravityConfig { kp: [0.0], kd: [1.0], tau_limit: [1e9], dt: 1e-3, filter_s: 0.02 };
        let controller = PdGravity::try_new(config).unwrap();
        let mut state = PdGravityState::default();
        let at = |q: f64, dt: f64| Input { q_meas: [q], ..Input::standing([0.0], dt) };
        let _ = controller.step(&mut state, &at(0.0, 1e-3));
        // 0.7 m/s for 20 ms in one sample: the same 63 percent.
        let _ = controller.step(&mut state, &at(0.014, 0.02));
        assert!((state.v_hat[0] - 0.7 * (1.0 - math::exp(-1.0))).abs() < 1e-12, "{}", state.v_hat[0]);
        for dt in [0.0, -1e-3, f64::NAN, f64::INFINITY] {
            let mut copy = state;
            let fault = controller.step(&mut copy, &at(0.014, dt)).health.fault.expect("no period");
            assert_eq!(fault.code, FaultCode::Period);
        }
    }

    #[test]
    fn every_axis_saturates_at_its_own_limit() {
        let mut state = PdGravityState::default();
        let mut input = at_rest();
        input.q_ref = [10.0, -10.0];
        let command = controller().step(&mut state, &input);
        assert_eq!((command.tau, command.health.is_saturated), ([20.0, -8.0], true));
        assert!(!command.health.is_faulted);
    }

    #[test]
    fn not_a_number_latches_a_fault_and_the_weight_stays_carried() {
        let mut state = PdGravityState::default();
        let mut input = at_rest();
        input.q_ref[0] += 0.02;
        let _ = controller().step(&mut state, &input);
        input.q_meas[1] = f64::NAN;
        let command = controller().step(&mut state, &input);
        assert_eq!((command.tau, command.health.is_faulted), ([3.0, -1.5], true));
        let after = controller().step(&mut state, &at_rest());
        assert_eq!((after.tau, after.health.is_faulted), ([3.0, -1.5], true));
        let mut untouched = PdGravityState::<2>::default();
        (input.q_meas[1], input.tau_ff[0]) = (-0.2, f64::INFINITY);
        let command = controller().step(&mut untouched, &input);
        let fault = Fault { code: FaultCode::InputNotFinite, drive: 0, value: f64::INFINITY, limit: 0.0 };
        assert_eq!(command, Command::faulted([0.0; 2], Some(fault)));
    }

    #[test]
    fn an_overflow_inside_is_a_fault_too() {
        let config = PdGravityConfig { kp: [1e300], kd: [1e300], tau_limit: [1.0], dt: 1e-3, filter_s: 0.0 };
        let mut state = PdGravityState::default();
        let input = Input { q_ref: [1e300], v_ref: [-1e300], tau_ff: [0.5], ..Input::standing([0.0], 1e-3) };
        let command = PdGravity::try_new(config).unwrap().step(&mut state, &input);
        assert!(command.health.is_faulted && command.tau[0].is_finite());
    }

    #[test]
    fn unusable_numbers_are_refused() {
        let good = PdGravityConfig { kp: [1.0], kd: [1.0], tau_limit: [1.0], dt: 1e-3, filter_s: 0.0 };
        assert!(PdGravity::try_new(good).is_ok());
        for bad in [
            PdGravityConfig { kp: [-1.0], ..good },
            PdGravityConfig { kd: [f64::NAN], ..good },
            PdGravityConfig { tau_limit: [0.0], ..good },
            PdGravityConfig { dt: 0.0, ..good },
            PdGravityConfig { filter_s: -1.0, ..good },
        ] {
            assert!(PdGravity::try_new(bad).is_err(), "{bad:?}");
        }
    }
}
