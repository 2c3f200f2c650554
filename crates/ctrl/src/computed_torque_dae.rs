//! Computed torque for a robot whose drives take the integral of an effort \[Arceo2021, eq. 8-9\]: `tau = b0·u'`, `u` a voltage.
//!
//! `a_cmd = a_ref − (ki·∫e + kp·e + kv·e')`, `u' = (M_eff·a_cmd + h_eff)/b0` with the *projected* inertia `M_eff = Gᵀ·M·G` and
//! `h_eff = Gᵀ·(M·a_0 + nle + friction)`. The paper prints row 1 of the tree's equations, `M11` and `C1 + F1`, in their place: that leaves
//! the loops' efforts out, and its own identified `b0/b1` is `M_eff`, not `M11`.

use pkm_dyn::effects::Robot;

use crate::controller::{Command, ConfigError, Controller, Health, Input, clipped, must_be_finite, must_be_usable};
use crate::drive_model::{DriveModel, DriveModelState, NO_ACCELERATION};
use crate::error_dynamics::ErrorGains;
use crate::fault::{Fault, FaultCode};
use crate::observer::{Gap, VelocityObserver};

/// Numbers of a [`ComputedTorqueDae`]; arrays have one entry per drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ComputedTorqueDaeConfig<const N: usize> {
    /// Gains of the error dynamics, negative for a stable loop ([`ErrorGains::placed`], [`ErrorGains::placed_sampled`]).
    pub gains: [ErrorGains; N],
    /// Effort per rate of the voltage `[N·s/V | N·m·s/V]`.
    pub b0: [f64; N],
    /// Largest voltage of each drive `[V]`.
    pub u_limit: [f64; N],
    /// Speed below which compensated dry friction fades to zero `[m/s | rad/s]`; zero switches at standstill.
    pub creep: f64,
}

/// Computed torque with integrated voltages and a velocity observer.
#[derive(Debug, Clone)]
pub struct ComputedTorqueDae<const N: usize, O> {
    model: DriveModel<N>,
    observer: O,
    config: ComputedTorqueDaeConfig<N>,
}

/// What a [`ComputedTorqueDae`] remembers; `S` is its observer's state.
#[derive(Debug, Clone)]
pub struct ComputedTorqueDaeState<const N: usize, S> {
    model: DriveModelState,
    observer: S,
    gap: Gap<N>,
    /// Voltage of the last command `[V]`.
    pub u: [f64; N],
    /// Velocity estimate `[m/s | rad/s]`.
    pub v_hat: [f64; N],
    /// Integral of the error `[m·s | rad·s]`, by the trapezoidal rule that the sampled gains are placed with.
    integral: [f64; N],
    e_last: [f64; N],
    a_sent: [f64; N],
    tau_sent: [f64; N],
    was_saturated: [bool; N],
    has_started: bool,
    fault: Option<Fault>,
}

impl<const N: usize, O: VelocityObserver<N>> ComputedTorqueDae<N, O> {
    /// On `robot`, velocities from `observer`.
    ///
    /// # Errors
    /// Gains that are positive or not finite, `b0` or limits that are not positive, a robot without `N` drives, or one whose loops do not
    /// close at its assembly or leave a joint undriven.
    pub fn try_new(robot: Robot, observer: O, config: ComputedTorqueDaeConfig<N>) -> Result<Self, ConfigError> {
        for (what, gain) in
            [("-ki", config.gains.map(|g| -g.ki)), ("-kp", config.gains.map(|g| -g.kp)), ("-kv", config.gains.map(|g| -g.kv))]
        {
            ConfigError::unless_non_negative(what, &gain)?;
        }
        ConfigError::unless_positive("b0", &config.b0)?;
        ConfigError::unless_positive("u_limit", &config.u_limit)?;
        ConfigError::unless_non_negative("creep", &[config.creep])?;
        Ok(Self { model: DriveModel::try_new(robot)?.with_creep(config.creep), observer, config })
    }

    /// The state of a controller that takes over a robot in motion: positions `q` `[m | rad]`, velocities `v` `[m/s | rad/s]`, voltages
    /// `u` `[V]`. Allocates.
    #[must_use]
    pub fn in_motion(&self, [q, v, u]: [&[f64; N]; 3]) -> ComputedTorqueDaeState<N, O::State> {
        let mut state = self.at_rest();
        self.observer.reset_to(&mut state.observer, q, v);
        (state.u, state.has_started) = (*u, true);
        state
    }

    fn attempt(&self, state: &mut ComputedTorqueDaeState<N, O::State>, input: &Input<N>) -> Result<Command<N>, Fault> {
        let signals = [&input.q_meas, &input.q_ref, &input.v_ref, &input.a_ref];
        let dt = input.dt;
        must_be_usable(&signals, dt)?;
        let e: [f64; N] = core::array::from_fn(|k| input.q_ref[k] - input.q_meas[k]);
        if !state.has_started {
            self.observer.reset_to(&mut state.observer, &input.q_meas, &[0.0; N]);
            state.has_started = true;
        } else {
            for (k, integral) in state.integral.iter_mut().enumerate() {
                // An integral that grows while the voltage is at its limit has to be undone again: it waits.
                if !state.was_saturated[k] {
                    *integral += 0.5 * dt * (e[k] + state.e_last[k]);
                }
            }
        }
        state.e_last = e;
        state.v_hat = state.gap.observe(&self.observer, &mut state.observer, input, [state.a_sent, state.tau_sent]);
        let a: [f64; N] = core::array::from_fn(|k| {
            let gains = &self.config.gains[k];
            input.a_ref[k] - (gains.ki * state.integral[k] + gains.kp * e[k] + gains.kv * (input.v_ref[k] - state.v_hat[k]))
        });
        must_be_finite(FaultCode::CommandNotFinite, &[&state.v_hat, &state.integral, &a])?;
        let v_hat = state.v_hat;
        let wanted = self.model.effort(&mut state.model, [&input.q_meas, &v_hat, &a], &v_hat)?;
        self.integrate(state, &wanted, &a, dt)
    }

    /// The voltages after `dt` `[s]` of the rates that `wanted` efforts need, and what their limits leave of efforts and accelerations.
    fn integrate(
        &self,
        state: &mut ComputedTorqueDaeState<N, O::State>,
        wanted: &[f64; N],
        a: &[f64; N],
        dt: f64,
    ) -> Result<Command<N>, Fault> {
        let next: [f64; N] = core::array::from_fn(|k| state.u[k] + dt * wanted[k] / self.config.b0[k]);
        must_be_finite(FaultCode::CommandNotFinite, &[&next])?;
        let (u, is_saturated) = clipped(&next, &self.config.u_limit);
        state.was_saturated = core::array::from_fn(|k| next[k].abs() > self.config.u_limit[k]);
        (state.a_sent, state.tau_sent) = (*a, *wanted);
        if is_saturated {
            state.tau_sent = core::array::from_fn(|k| self.config.b0[k] * (u[k] - state.u[k]) / dt);
            let lost = core::array::from_fn(|k| state.tau_sent[k] - wanted[k]);
            let change = self.model.acceleration_of(&mut state.model, &lost).ok_or(NO_ACCELERATION)?;
            state.a_sent = core::array::from_fn(|k| a[k] + change[k]);
        }
        state.u = u;
        Ok(Command { tau: u, health: Health { is_saturated, ..Health::default() } })
    }
}

impl<const N: usize, O: VelocityObserver<N>> Controller<N> for ComputedTorqueDae<N, O> {
    type State = ComputedTorqueDaeState<N, O::State>;

    fn at_rest(&self) -> Self::State {
        let zero = [0.0; N];
        ComputedTorqueDaeState {
            model: self.model.at_rest(),
            observer: self.observer.at_rest(),
            gap: Gap::default(),
            u: zero,
            v_hat: zero,
            integral: zero,
            e_last: zero,
            a_sent: zero,
            tau_sent: zero,
            was_saturated: [false; N],
            has_started: false,
            fault: None,
        }
    }

    /// One period; the command is the voltage at its end `[V]`, the feed-forward effort is not used.
    ///
    /// On a fault the command is zero volts: a drive that takes the integral of an effort stands still without voltage, and its screw
    /// carries the weight.
    fn step(&self, state: &mut Self::State, input: &Input<N>) -> Command<N> {
        if state.fault.is_none() {
            match self.attempt(state, input) {
                Ok(command) => return command,
                Err(fault) => state.fault = Some(fault),
            }
        }
        Command::faulted([0.0; N], state.fault)
    }
}
