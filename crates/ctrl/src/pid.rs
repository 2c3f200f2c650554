//! Joint PID with a feed-forward effort, each drive for itself: `tau = tau_ff + kp·e + ∫ki·e + kd·(v_ref − v̂)`.
//!
//! The integral is kept from winding up where efforts are clipped, and starts wherever the command has to go on from.

use crate::controller::{Command, ConfigError, Controller, Health, Input, clipped, must_be_finite, must_be_usable};
use crate::fault::{Fault, FaultCode};
use crate::observer::{Gap, VelocityObserver};

/// What happens to the integral while the effort is at its limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AntiWindup {
    /// It runs back to where the effort just fits, with this time constant `[s]`.
    BackCalculation {
        /// Time constant `[s]`; at or below the period the integral fits at once.
        time_s: f64,
    },
    /// It waits whenever it would push further into the limit.
    Clamping,
}

/// Numbers of a [`Pid`]; arrays have one entry per drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PidConfig<const N: usize> {
    /// Proportional gain `[N/m | N·m/rad]`.
    pub kp: [f64; N],
    /// Gain of the integral `[N/(m·s) | N·m/(rad·s)]`.
    pub ki: [f64; N],
    /// Gain of the velocity's error `[N·s/m | N·m·s/rad]`.
    pub kd: [f64; N],
    /// Largest effort of each drive `[N | N·m]`.
    pub tau_limit: [f64; N],
    /// What happens at the limit.
    pub anti_windup: AntiWindup,
}

/// Joint PID with a velocity observer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pid<const N: usize, O> {
    config: PidConfig<N>,
    observer: O,
}

/// What a [`Pid`] remembers; `S` is its observer's state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PidState<const N: usize, S> {
    observer: S,
    gap: Gap<N>,
    /// Integral term `[N | N·m]`.
    pub integral: [f64; N],
    /// Command to go on from in the first step; none starts the integral at zero.
    resume: Option<[f64; N]>,
    tau_sent: [f64; N],
    a_ref_last: [f64; N],
    tau_safe: [f64; N],
    has_started: bool,
    fault: Option<Fault>,
}

impl<const N: usize, O: VelocityObserver<N>> Pid<N, O> {
    /// With velocities from `observer`.
    ///
    /// # Errors
    /// Gains that are negative, limits or a time constant that are not positive, anything that is not finite.
    pub fn try_new(observer: O, config: PidConfig<N>) -> Result<Self, ConfigError> {
        ConfigError::unless_non_negative("kp", &config.kp)?;
        ConfigError::unless_non_negative("ki", &config.ki)?;
        ConfigError::unless_non_negative("kd", &config.kd)?;
        ConfigError::unless_positive("tau_limit", &config.tau_limit)?;
        if let AntiWindup::BackCalculation { time_s } = config.anti_windup {
            ConfigError::unless_positive("time_s", &[time_s])?;
        }
        Ok(Self { config, observer })
    }

    /// The state of a controller that takes over from another without a jump: its first command is `tau` `[N | N·m]`, whatever the error.
    #[must_use]
    pub fn resuming(&self, tau: [f64; N]) -> PidState<N, O::State> {
        PidState { resume: Some(tau), ..self.at_rest() }
    }

    fn attempt(&self, state: &mut PidState<N, O::State>, input: &Input<N>) -> Result<Command<N>, Fault> {
        let signals = [&input.q_meas, &input.q_ref, &input.v_ref, &input.a_ref, &input.tau_ff];
        let dt = input.dt;
        must_be_usable(&signals, dt)?;
        let is_first = !state.has_started;
        if is_first {
            self.observer.reset_to(&mut state.observer, &input.q_meas, &[0.0; N]);
            state.has_started = true;
        }
        // No acceleration is commanded; the reference's is the best guess of what was sent.
        let v_hat = state.gap.observe(&self.observer, &mut state.observer, input, [state.a_ref_last, state.tau_sent]);
        let error: [f64; N] = core::array::from_fn(|k| input.q_ref[k] - input.q_meas[k]);
        let open: [f64; N] =
            core::array::from_fn(|k| input.tau_ff[k] + self.config.kp[k] * error[k] + self.config.kd[k] * (input.v_ref[k] - v_hat[k]));
        if let (true, Some(tau)) = (is_first, state.resume) {
            state.integral = core::array::from_fn(|k| tau[k] - open[k]);
        }
        let wanted: [f64; N] = core::array::from_fn(|k| open[k] + state.integral[k]);
        must_be_finite(FaultCode::CommandNotFinite, &[&wanted])?;
        let (tau, is_saturated) = clipped(&wanted, &self.config.tau_limit);
        for k in 0..N {
            // Added after the command is made: this period's error acts from the next on, and a resumed command is met exactly.
            state.integral[k] += self.increment(k, error[k], wanted[k] - tau[k], dt);
        }
        (state.tau_sent, state.a_ref_last) = (tau, input.a_ref);
        state.tau_safe = clipped(&input.tau_ff, &self.config.tau_limit).0;
        Ok(Command { tau, health: Health { is_saturated, ..Health::default() } })
    }

    /// Change of the integral of drive `k` after a period with `error`, whose effort was `beyond` its limit.
    fn increment(&self, k: usize, error: f64, beyond: f64, dt: f64) -> f64 {
        // Without a gain there is nothing to run back, and nothing that would bring it up again.
        if self.config.ki[k] <= 0.0 {
            return 0.0;
        }
        let gained = self.config.ki[k] * error * dt;
        match self.config.anti_windup {
            AntiWindup::BackCalculation { time_s } => gained - (dt / time_s).min(1.0) * beyond,
            AntiWindup::Clamping if gained * beyond > 0.0 => 0.0,
            AntiWindup::Clamping => gained,
        }
    }
}

impl<const N: usize, O: VelocityObserver<N>> Controller<N> for Pid<N, O> {
    type State = PidState<N, O::State>;

    fn at_rest(&self) -> Self::State {
        let zero = [0.0; N];
        PidState {
            observer: self.observer.at_rest(),
            gap: Gap::default(),
            integral: zero,
            resume: None,
            tau_sent: zero,
            a_ref_last: zero,
            tau_safe: zero,
            has_started: false,
            fault: None,
        }
    }

    /// One period. On a fault the command is the last finite feed-forward effort, clipped: it carries the weight and pushes no further.
    fn step(&self, state: &mut Self::State, input: &Input<N>) -> Command<N> {
        if state.fault.is_none() {
            match self.attempt(state, input) {
                Ok(command) => return command,
                Err(fault) => state.fault = Some(fault),
            }
        }
        Command::faulted(state.tau_safe, state.fault)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observer::FirstDifference;

    const GOOD: PidConfig<1> =
        PidConfig { kp: [100.0], ki: [40.0], kd: [5.0], tau_limit: [20.0], anti_windup: AntiWindup::BackCalculation { time_s: 0.1 } };

    fn input(q_meas: f64, q_ref: f64) -> Input<1> {
        Input { q_ref: [q_ref], tau_ff: [3.0], ..Input::standing([q_meas], 0.01) }
    }

    #[test]
    fn a_constant_error_is_integrated_once_per_period() {
        let pid = Pid::try_new(FirstDifference, GOOD).expect("good");
        let mut state = pid.at_rest();
        for k in 0..5 {
            let tau = pid.step(&mut state, &input(0.0, 0.1)).tau[0];
            assert!((tau - (3.0 + 10.0 + 0.04 * f64::from(k))).abs() < 1e-12, "{tau}");
        }
    }

    #[test]
    fn it_resumes_exactly_where_another_left_whatever_the_error() {
        let pid = Pid::try_new(FirstDifference, GOOD).expect("good");
        let mut state = pid.resuming([-7.5]);
        let first = pid.step(&mut state, &input(0.0, 0.13)).tau[0];
        let second = pid.step(&mut state, &input(0.0, 0.13)).tau[0];
        assert!((first + 7.5).abs() < 1e-12 && (second - first - 0.4 * 0.13).abs() < 1e-12, "{first} {second}");
    }

    /// Time the effort stays at its limit after the error has changed sign.
    fn late(anti_windup: AntiWindup) -> usize {
        let pid = Pid::try_new(FirstDifference, PidConfig { anti_windup, ..GOOD }).expect("good");
        let mut state = pid.at_rest();
        for _ in 0..2000 {
            assert!(pid.step(&mut state, &input(0.0, 1.0)).health.is_saturated);
        }
        (0..2000).find(|_| pid.step(&mut state, &input(1.01, 1.0)).tau[0] < 20.0).unwrap_or(usize::MAX)
    }

    #[test]
    fn the_integral_does_not_wind_up_at_the_limit() {
        assert!(late(AntiWindup::Clamping) <= 1 && late(AntiWindup::BackCalculation { time_s: 0.1 }) <= 1);
        // With so slow a way back it does: what is tested above is not a matter of course.
        assert!(late(AntiWindup::BackCalculation { time_s: 1e9 }) > 100);
    }

    #[test]
    fn back_calculation_settles_where_gain_and_loss_balance() {
        let pid = Pid::try_new(FirstDifference, GOOD).expect("good");
        let mut state = pid.at_rest();
        for _ in 0..3000 {
            let _ = pid.step(&mut state, &input(0.0, 1.0));
        }
        // ki·e = (wanted − limit)/time_s, wanted = 3 + 100 + integral.
        assert!((state.integral[0] - (20.0 + 0.1 * 40.0 - 103.0)).abs() < 1e-9, "{state:?}");
    }

    #[test]
    fn not_a_number_latches_a_fault_and_the_weight_stays_carried() {
        let pid = Pid::try_new(FirstDifference, GOOD).expect("good");
        let mut state = pid.at_rest();
        let _ = pid.step(&mut state, &input(0.0, 0.1));
        for bad in [input(f64::NAN, 0.0), input(0.0, 0.1), Input { dt: 0.0, ..input(0.0, 0.1) }] {
            let command = pid.step(&mut state, &bad);
            let fault = command.health.fault.expect("a fault");
            assert_eq!((command.tau, command.health.is_faulted, fault.code), ([3.0], true, FaultCode::InputNotFinite));
        }
        let late = Fault { code: FaultCode::Period, drive: 0, value: 0.0, limit: 0.0 };
        assert_eq!(pid.step(&mut pid.at_rest(), &Input { dt: 0.0, ..input(0.0, 0.1) }), Command::faulted([0.0], Some(late)));
    }

    #[test]
    fn without_a_gain_the_integral_stays_at_zero_through_saturation() {
        let pid = Pid::try_new(FirstDifference, PidConfig { ki: [0.0], ..GOOD }).expect("good");
        let mut state = pid.at_rest();
        for _ in 0..100 {
            assert!(pid.step(&mut state, &input(0.0, 1.0)).health.is_saturated);
        }
        let _ = pid.step(&mut state, &input(0.0, 0.05));
        // Velocity zero, error 0.05: 3 + 100·0.05, and no offset left of the time at the limit.
        let tau = pid.step(&mut state, &input(0.0, 0.05)).tau[0];
        assert!((tau - 8.0).abs() < 1e-12, "{tau}");
    }
}
