//! Limits around any controller: positions with the way it takes to stop, velocities, efforts and their rates, the environment's wrench,
//! workspace and singularities; input that is late, frozen or no number.
//!
//! A limit that acts changes as little as it must and says so in [`Health::acted`]; a fault latches and the command becomes the safe one.
//! Speeds are taken over the time that lies between two measurements by their own stamps ([`Input::q_dt`]): a driver that was kept waiting is
//! no fast robot, and a jump within a period is one as ever. What arrives is trusted in nothing. This is no protective system: a robot near people has an emergency stop of its own.

mod numbers;
mod workspace;

use pkm_dyn::math;

use crate::controller::{Command, ConfigError, Controller, Health, Input, first_not_finite};
use crate::fault::{Fault, FaultCode, Limit};
use crate::force::pid::usable_dt;
use numbers::check_stopping;

pub use numbers::{LimitsConfig, Safe};
pub use workspace::{Anywhere, TaskBox, Workspace};

/// A controller inside limits.
#[derive(Debug, Clone, PartialEq)]
pub struct Limited<const N: usize, C, W = Anywhere> {
    inner: C,
    workspace: W,
    config: LimitsConfig<N>,
}

/// What a [`Limited`] remembers.
#[derive(Debug, Clone, PartialEq)]
pub struct LimitedState<const N: usize, I, S> {
    inner: I,
    workspace: S,
    fault: Option<Fault>,
    /// Positions of the last step, measured or carried on `[m | rad]`.
    q_last: [f64; N],
    /// Positions measured last `[m | rad]`.
    q_seen: [f64; N],
    v: [f64; N],
    q_ref: [f64; N],
    beyond: f64,
    tau_last: [f64; N],
    weight: [f64; N],
    seen: u64,
    repeats: u32,
    has_started: bool,
}

impl<const N: usize, I, S> LimitedState<N, I, S> {
    /// The fault that stopped the robot.
    #[must_use]
    pub fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// Keeps the positions of a step for the next one's speed.
    fn remember(&mut self, input: &Input<N>) {
        // The first ones are all there is, stamped or not.
        if input.q_dt > 0.0 || !self.has_started {
            self.q_seen = input.q_meas;
        }
        (self.q_last, self.has_started) = (input.q_meas, true);
    }
}

impl<const N: usize, C: Controller<N>> Limited<N, C> {
    /// Checks the numbers; no workspace.
    ///
    /// # Errors
    /// As [`Limited::within`].
    pub fn try_new(inner: C, config: LimitsConfig<N>) -> Result<Self, ConfigError> {
        Self::within(inner, Anywhere, config)
    }
}

impl<const N: usize, C: Controller<N>, W: Workspace<N>> Limited<N, C, W> {
    /// Checks the numbers.
    ///
    /// # Errors
    /// Empty ranges, limits that are not positive, a period that is not finite, a brake that is not where there is something to stop at,
    /// anything that is no number; a workspace, or a wrench from which on to yield, around a controller that follows no reference.
    pub fn within(inner: C, workspace: W, config: LimitsConfig<N>) -> Result<Self, ConfigError> {
        let bad = |drive, what, value, limit| Err(ConfigError { drive, what, value, limit });
        let c = &config;
        check_stopping(c)?;
        if !C::FOLLOWS_REFERENCE {
            if let Some(k) = c.wrench_yield.iter().position(|w| w.is_finite()) {
                return bad(k, "wrench_yield", c.wrench_yield[k], "must be infinite: the controller follows no reference");
            }
            if !W::IS_EVERYWHERE {
                return bad(0, "workspace", 0.0, "must be none: the controller follows no reference");
            }
        }
        for k in 0..N {
            let room = c.q_upper[k] - c.q_lower[k];
            let positive = [
                ("q_upper - q_lower", room),
                ("deceleration", c.deceleration[k]),
                ("brake", c.brake[k]),
                ("v_limit", c.v_limit[k]),
                ("tau_limit", c.tau_limit[k]),
                ("tau_rate", c.tau_rate[k]),
            ];
            if let Some((what, value)) = positive.into_iter().find(|(_, x)| x.is_nan() || *x <= 0.0) {
                return bad(k, what, value, "must be > 0");
            }
            if !c.tau_limit[k].is_finite() {
                return bad(k, "tau_limit", c.tau_limit[k], "must be finite");
            }
            if let Safe::Damped(x) | Safe::Ramp(x) = &c.safe
                && !(x[k].is_finite() && x[k] >= 0.0)
            {
                return bad(k, "safe", x[k], "must be finite and >= 0");
            }
        }
        let whole = [("q_tolerance", c.q_tolerance), ("dt_limit", c.dt_limit), ("dt", c.dt)];
        let wrench = c.wrench_yield.iter().chain(&c.wrench_limit).map(|x| ("wrench", *x));
        if let Some((what, value)) = whole.into_iter().chain(wrench).find(|(_, x)| x.is_nan() || *x <= 0.0) {
            return bad(0, what, value, "must be > 0");
        }
        if !c.dt.is_finite() {
            return bad(0, "dt", c.dt, "must be finite");
        }
        Ok(Self { inner, workspace, config })
    }

    /// The guarded controller.
    #[must_use]
    pub fn inner(&self) -> &C {
        &self.inner
    }

    /// How fast the drives have been since the positions before these `[m/s | rad/s]`; zero before there are any.
    ///
    /// Measurements that are several periods apart by their stamps are so for their speed. Closer ones are taken as a period apart: a tick of
    /// an encoder over next to no time is no speed. Positions that nobody stamped anew had the period, so a jump among them is seen.
    fn speed(&self, state: &LimitedState<N, C::State, W::State>, input: &Input<N>) -> [f64; N] {
        if !state.has_started {
            return [0.0; N];
        }
        let is_new = input.q_dt > 0.0;
        let before = if is_new { &state.q_seen } else { &state.q_last };
        let dt = usable_dt(input.dt, self.config.dt);
        let passed = if is_new { input.q_dt.max(dt.min(self.config.dt)) } else { dt };
        core::array::from_fn(|k| (input.q_meas[k] - before[k]) / passed)
    }

    /// The first thing in the input that is not allowed.
    fn offence(&self, state: &LimitedState<N, C::State, W::State>, input: &Input<N>) -> Option<Fault> {
        let c = &self.config;
        let signals: [(FaultCode, &[f64]); 9] = [
            (FaultCode::PositionNotFinite, &input.q_meas),
            (FaultCode::EffortNotFinite, &input.tau_meas),
            (FaultCode::WrenchNotFinite, &input.wrench_meas),
            (FaultCode::ReferenceNotFinite, &input.q_ref),
            (FaultCode::ReferenceNotFinite, &input.v_ref),
            (FaultCode::ReferenceNotFinite, &input.a_ref),
            (FaultCode::ReferenceNotFinite, &input.wrench_ref),
            (FaultCode::ReferenceNotFinite, &input.tau_ff),
            (FaultCode::Late, &[input.dt, input.q_dt]),
        ];
        if let Some(fault) = first_not_finite(&signals) {
            return Some(fault);
        }
        if input.dt <= 0.0 || input.dt > c.dt_limit {
            return Some(Fault { code: FaultCode::Late, drive: 0, value: input.dt, limit: c.dt_limit });
        }
        if input.q_dt < 0.0 {
            return Some(Fault { code: FaultCode::Late, drive: 0, value: input.q_dt, limit: 0.0 });
        }
        if c.repeats > 0 && state.repeats > c.repeats {
            return Some(Fault { code: FaultCode::Frozen, drive: 0, value: f64::from(state.repeats), limit: f64::from(c.repeats) });
        }
        let too_much = |k: &usize| input.wrench_meas[*k].abs() > c.wrench_limit[*k];
        if let Some(drive) = (0..6).find(too_much) {
            return Some(Fault { code: FaultCode::Wrench, drive, value: input.wrench_meas[drive], limit: c.wrench_limit[drive] });
        }
        for drive in 0..N {
            let (q, v) = (input.q_meas[drive], state.v[drive]);
            let (upper, lower) = (c.q_upper[drive] + c.q_tolerance, c.q_lower[drive] - c.q_tolerance);
            if q > upper || q < lower {
                return Some(Fault { code: FaultCode::Position, drive, value: q, limit: if q > upper { upper } else { lower } });
            }
            if v.abs() > 1.5 * c.v_limit[drive] {
                return Some(Fault { code: FaultCode::Velocity, drive, value: v, limit: 1.5 * c.v_limit[drive] });
            }
        }
        None
    }

    /// The command after a fault.
    fn safe(&self, state: &mut LimitedState<N, C::State, W::State>, input: &Input<N>) -> Command<N> {
        let c = &self.config;
        let dt = usable_dt(input.dt, c.dt);
        // Before the second sample there is no difference, and a jump of an encoder is no speed.
        let v = self.speed(state, input);
        let tau = core::array::from_fn(|k| {
            let wanted = match c.safe {
                Safe::Zero => 0.0,
                Safe::Weight => state.weight[k],
                Safe::Damped(d) if v[k].is_finite() => state.weight[k] - d[k] * v[k].clamp(-c.v_limit[k], c.v_limit[k]),
                Safe::Damped(_) => state.weight[k],
                Safe::Ramp(rate) => state.tau_last[k] - state.tau_last[k].clamp(-rate[k] * dt, rate[k] * dt),
            };
            wanted.clamp(-c.tau_limit[k], c.tau_limit[k])
        });
        if input.q_meas.iter().all(|q| q.is_finite()) {
            state.remember(input);
        }
        state.tau_last = tau;
        Command { tau, health: Health { is_faulted: true, fault: state.fault, ..Health::default() } }
    }

    /// References that may be followed, in place of those that are wanted.
    fn references(&self, state: &mut LimitedState<N, C::State, W::State>, input: &mut Input<N>, health: &mut Health) {
        let c = &self.config;
        if let Some(k) = (0..6).find(|&k| input.wrench_meas[k].abs() > c.wrench_yield[k]) {
            health.acted.note(Limit::Wrench, k);
            (input.q_ref, input.v_ref, input.a_ref) = (input.q_meas, [0.0; N], [0.0; N]);
        }
        for k in 0..N {
            let wanted = input.q_ref[k];
            input.q_ref[k] = wanted.clamp(c.q_lower[k], c.q_upper[k]);
            if wanted < c.q_lower[k] || wanted > c.q_upper[k] {
                health.acted.note(Limit::Position, k);
                let is_outward = input.v_ref[k] * (wanted - input.q_ref[k]) > 0.0;
                input.v_ref[k] = if is_outward { 0.0 } else { input.v_ref[k] };
            }
        }
        match self.workspace.outside(&mut state.workspace, &input.q_ref) {
            // On the way in from outside every reference that is less far out is followed.
            Some((limit, beyond)) if state.has_started && (beyond.is_nan() || beyond >= state.beyond) => {
                health.acted.note(limit, 0);
                (input.q_ref, input.v_ref, input.a_ref) = (state.q_ref, [0.0; N], [0.0; N]);
            }
            Some((limit, beyond)) => {
                health.acted.note(limit, 0);
                (state.q_ref, state.beyond) = (input.q_ref, beyond);
            }
            None => (state.q_ref, state.beyond) = (input.q_ref, 0.0),
        }
    }

    /// One drive's effort inside its limits; what the model asks for alone holds it where it is.
    fn effort(&self, state: &LimitedState<N, C::State, W::State>, input: &Input<N>, k: usize, tau: f64, health: &mut Health) -> f64 {
        let c = &self.config;
        let (q, v, weight) = (input.q_meas[k], state.v[k], input.tau_ff[k]);
        let change = c.tau_rate[k] * input.dt;
        let mut out = tau.clamp(state.tau_last[k] - change, state.tau_last[k] + change);
        if (out - tau).abs() > 0.0 {
            health.acted.note(Limit::EffortRate, k);
        }
        // Towards the upper end, then the same mirrored: `side` turns the lower end into an upper one.
        for (side, end) in [(1.0, c.q_upper[k]), (-1.0, -c.q_lower[k])] {
            let (room, speed, push) = (end - side * q, side * v, side * (out - weight));
            let allowed = approach(room.max(0.0), c.deceleration[k], input.dt);
            // Never so much push that one period could make it too fast, were the drive four times as light; a brake beyond that.
            let per_speed = c.brake[k] / (c.deceleration[k] * input.dt);
            let most =
                if speed > allowed { -c.brake[k].min(0.5 * per_speed * (speed - allowed)) } else { 0.25 * per_speed * (allowed - speed) };
            if c.deceleration[k].is_finite() && push > most {
                health.acted.note(Limit::Position, k);
                out = weight + side * most;
            }
            // From the limit on less and less push, and a brake at a tenth above it.
            let share = (speed / c.v_limit[k] - 1.0) * 10.0;
            let most = if share > 0.0 { -c.brake[k] * share.min(1.0) } else { f64::INFINITY };
            if side * (out - weight) > most {
                health.acted.note(Limit::Velocity, k);
                out = weight + side * most;
            }
        }
        if out.abs() > c.tau_limit[k] {
            health.acted.note(Limit::Effort, k);
            health.is_saturated = true;
        }
        out.clamp(-c.tau_limit[k], c.tau_limit[k])
    }
}

/// Largest speed at which a drive still stops within `room`: five periods pass while the speed is measured and the brake comes in, then it
/// slows down by `deceleration`.
fn approach(room: f64, deceleration: f64, dt: f64) -> f64 {
    let late = 5.0 * dt * deceleration;
    math::sqrt(late * late + 2.0 * deceleration * room) - late
}

/// A number that differs when any measurement does, but for chance.
fn fingerprint<const N: usize>(input: &Input<N>) -> u64 {
    let all = input.q_meas.iter().chain(&input.tau_meas).chain(&input.wrench_meas);
    all.fold(0xCBF2_9CE4_8422_2325, |hash, x| (hash ^ x.to_bits()).wrapping_mul(0x0000_0100_0000_01B3).rotate_left(23))
}

impl<const N: usize, C: Controller<N>, W: Workspace<N>> Controller<N> for Limited<N, C, W> {
    type State = LimitedState<N, C::State, W::State>;

    const FOLLOWS_REFERENCE: bool = C::FOLLOWS_REFERENCE;

    fn at_rest(&self) -> Self::State {
        let zero = [0.0; N];
        LimitedState {
            inner: self.inner.at_rest(),
            workspace: self.workspace.at_rest(),
            fault: None,
            q_last: zero,
            q_seen: zero,
            v: zero,
            q_ref: zero,
            beyond: f64::INFINITY,
            tau_last: zero,
            weight: zero,
            seen: 0,
            repeats: 0,
            has_started: false,
        }
    }

    /// One period. The first fault latches; from then on the command is [`Safe`], whatever arrives.
    fn step(&self, state: &mut Self::State, input: &Input<N>) -> Command<N> {
        if state.fault.is_some() {
            return self.safe(state, input);
        }
        let seen = fingerprint(input);
        state.repeats = if state.has_started && seen == state.seen { state.repeats.saturating_add(1) } else { 0 };
        state.seen = seen;
        state.v = self.speed(state, input);
        if input.tau_ff.iter().all(|t| t.is_finite()) {
            state.weight = core::array::from_fn(|k| input.tau_ff[k].clamp(-self.config.tau_limit[k], self.config.tau_limit[k]));
        }
        state.fault = self.offence(state, input);
        if state.fault.is_some() {
            return self.safe(state, input);
        }
        if !state.has_started {
            (state.q_ref, state.tau_last) = (input.q_meas, input.tau_ff);
        }
        let (mut allowed, mut health) = (*input, Health::default());
        self.references(state, &mut allowed, &mut health);
        let answer = self.inner.step(&mut state.inner, &allowed);
        if answer.health.is_faulted {
            let own = Fault { code: FaultCode::Controller, drive: 0, value: 0.0, limit: 0.0 };
            state.fault = Some(answer.health.fault.unwrap_or(own));
        } else if let Some(drive) = answer.tau.iter().position(|t| !t.is_finite()) {
            state.fault = Some(Fault { code: FaultCode::CommandNotFinite, drive, value: answer.tau[drive], limit: 0.0 });
        }
        if state.fault.is_some() {
            return self.safe(state, input);
        }
        health.is_saturated = answer.health.is_saturated;
        health.acted = health.acted.and(answer.health.acted);
        let tau = core::array::from_fn(|k| self.effort(state, input, k, answer.tau[k], &mut health));
        state.remember(input);
        state.tau_last = tau;
        Command { tau, health }
    }
}
