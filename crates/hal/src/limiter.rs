//! Bounds on what is asked of the drives, kept between controller and device.

use crate::backend::{Backend, HalError};
use crate::frame::{CommandFrame, MAX_AXES, Mode, Signal, StateFrame};

/// Bounds of one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisLimits {
    /// Lower end of travel `[m | rad]`; −∞ without one.
    pub lower: f64,
    /// Upper end of travel `[m | rad]`; ∞ without one.
    pub upper: f64,
    /// Largest speed `[m/s | rad/s]`; ∞ without one.
    pub velocity: f64,
    /// Largest effort `[N | N·m]`.
    pub effort: f64,
    /// Largest change of effort in time, away from zero `[N/s | N·m/s]`; ∞ without one.
    pub effort_rate: f64,
    /// How speed must fall towards an end of travel: at distance `d` it may be `position_gain·d` `[1/s]`.
    pub position_gain: f64,
    /// Effort allowed per speed left below the bound `[N·s/m | N·m·s/rad]`; a speed above it is braked with this gain.
    pub velocity_gain: f64,
}

impl AxisLimits {
    /// A bound on the effort alone `[N | N·m]`.
    #[must_use]
    pub const fn of_effort(effort: f64) -> Self {
        let none = f64::INFINITY;
        Self { lower: -none, upper: none, velocity: none, effort, effort_rate: none, position_gain: 0.0, velocity_gain: 0.0 }
    }

    fn check(&self, axis: usize) -> Result<(), HalError> {
        let bounds = [
            ("effort", self.effort, "must be finite and not negative", self.effort.is_finite() && self.effort >= 0.0),
            ("effort rate", self.effort_rate, "must be positive", self.effort_rate > 0.0),
            ("velocity", self.velocity, "must be positive", self.velocity > 0.0),
            ("upper end", self.upper, "must be above the lower end", self.lower < self.upper),
            ("velocity gain", self.velocity_gain, "must be finite and not negative, above 0 with an end or a velocity", self.gains_fit()),
            ("position gain", self.position_gain, "must be finite and not negative, above 0 with an end", self.has_gain_for_ends()),
        ];
        match bounds.iter().find(|bound| !bound.3) {
            Some(&(what, value, limit, _)) => Err(HalError::Config { axis, what, value, limit }),
            None => Ok(()),
        }
    }

    fn gains_fit(&self) -> bool {
        let least = if self.bounds_motion() { f64::MIN_POSITIVE } else { 0.0 };
        self.velocity_gain.is_finite() && self.velocity_gain >= least
    }

    fn has_gain_for_ends(&self) -> bool {
        let has_end = self.lower.is_finite() || self.upper.is_finite();
        self.position_gain.is_finite() && self.position_gain >= if has_end { f64::MIN_POSITIVE } else { 0.0 }
    }

    fn bounds_motion(&self) -> bool {
        self.lower.is_finite() || self.upper.is_finite() || self.velocity.is_finite()
    }

    /// Least and largest effort at position `q` and velocity `v`.
    fn efforts(&self, q: f64, v: f64) -> (f64, f64) {
        if !self.bounds_motion() {
            return (-self.effort, self.effort);
        }
        let speed = |distance: f64| if distance.is_finite() { self.position_gain * distance } else { distance };
        // Beyond an end the bound points inward: it asks for a way back, at no more than the largest speed.
        let fastest = speed(self.upper - q).clamp(-self.velocity, self.velocity);
        let slowest = (-speed(q - self.lower)).clamp(-self.velocity, self.velocity);
        let effort = |v_bound: f64| {
            let effort = self.velocity_gain * (v_bound - v);
            if effort.is_nan() { 0.0 } else { effort.clamp(-self.effort, self.effort) }
        };
        (effort(slowest), effort(fastest))
    }
}

/// A backend whose commands are kept within limits.
///
/// Efforts are clipped to a window that closes towards the ends of travel and towards the largest speed, as in the soft limits of
/// `ros2_control`: `velocity_gain·(v_bound − v)` with `v_bound = position_gain·(end − q)`. A command that is not clipped passes bit by bit.
/// The window is that of the state read last through this decorator, and time for the effort rate passes as its stamps do: what the
/// commander says of time counts for nothing. An effort may fall to zero at any rate.
#[derive(Debug, Clone)]
pub struct Limiter<B, L = [AxisLimits; MAX_AXES]> {
    inner: B,
    limits: L,
    state: Option<StateFrame>,
    /// Efforts sent last.
    sent: [f64; MAX_AXES],
    /// Newest stamp of a state when they were sent.
    sent_ns: Option<u64>,
    clipped: u32,
    clips: u64,
}

/// Longest time between commands that the effort rate is counted over `[ns]`: a pause is no licence for a jump.
const LONGEST_PERIOD_NS: u64 = 20_000_000;

impl<B: Backend> Limiter<B> {
    /// Keeps `inner` within `limits`, one for each of its axes.
    ///
    /// # Errors
    /// Not one limit for each axis, or a limit that bounds nothing sensible.
    pub fn try_new(inner: B, limits: &[AxisLimits]) -> Result<Self, HalError> {
        check(inner.n_axes(), limits)?;
        let mut all = [AxisLimits::of_effort(0.0); MAX_AXES];
        all.iter_mut().zip(limits).for_each(|(to, limit)| *to = *limit);
        Ok(Self::within(inner, all))
    }
}

/// One limit for each of `n` axes, each of which bounds something sensible.
fn check(n: usize, limits: &[AxisLimits]) -> Result<(), HalError> {
    if limits.len() != n || n > MAX_AXES {
        let value = limits.len() as f64;
        return Err(HalError::Config { axis: 0, what: "number of limits", value, limit: "one for each axis, at most 16" });
    }
    limits.iter().enumerate().try_for_each(|(axis, limit)| limit.check(axis))
}

impl<B: Backend, L: AsRef<[AxisLimits]>> Limiter<B, L> {
    /// Keeps `inner` within limits that are shared with somebody, who may watch that they stay what they are.
    ///
    /// # Errors
    /// As [`Limiter::try_new`].
    pub fn sharing(inner: B, limits: L) -> Result<Self, HalError> {
        check(inner.n_axes(), limits.as_ref())?;
        Ok(Self::within(inner, limits))
    }

    const fn within(inner: B, limits: L) -> Self {
        Self { inner, limits, state: None, sent: [0.0; MAX_AXES], sent_ns: None, clipped: 0, clips: 0 }
    }

    /// Which axes the last command was clipped on, one bit each.
    #[must_use]
    pub const fn clipped(&self) -> u32 {
        self.clipped
    }

    /// How many commands were clipped.
    #[must_use]
    pub const fn clips(&self) -> u64 {
        self.clips
    }

    /// The backend inside.
    pub const fn inner_mut(&mut self) -> &mut B {
        &mut self.inner
    }

    /// Stamp of the state read last `[ns]`.
    fn stamp_ns(&self) -> u64 {
        self.state.map_or(0, |state| state.stamp_ns)
    }

    /// The efforts nearest to `command`'s that the limits allow.
    fn limited(&self, command: &CommandFrame) -> Result<[f64; MAX_AXES], HalError> {
        // The first command comes as after a pause, from rest.
        let passed = self.sent_ns.map_or(LONGEST_PERIOD_NS, |ns| self.stamp_ns().saturating_sub(ns)).min(LONGEST_PERIOD_NS);
        let dt = passed as f64 * 1e-9;
        let mut tau = [0.0; MAX_AXES];
        for (i, tau) in tau.iter_mut().enumerate().take(self.inner.n_axes()) {
            let limits = &self.limits.as_ref()[i];
            let (low, high) = if limits.bounds_motion() {
                let state = self.state.as_ref().ok_or(HalError::NoState)?;
                let (q, v) = (state.measured(Signal::Position, i), state.measured(Signal::Velocity, i));
                let (Some(q), Some(v)) = (q, v) else { return Err(HalError::NoState) };
                limits.efforts(q, v)
            } else {
                (-limits.effort, limits.effort)
            };
            let most = if limits.effort_rate.is_infinite() { f64::INFINITY } else { limits.effort_rate * dt };
            let rated = command.tau[i].clamp((self.sent[i] - most).min(0.0), (self.sent[i] + most).max(0.0));
            // The window comes last: it protects the limb, the rate only the drive.
            *tau = rated.clamp(low, high.max(low));
        }
        Ok(tau)
    }
}

impl<B: Backend, L: AsRef<[AxisLimits]>> Backend for Limiter<B, L> {
    fn n_axes(&self) -> usize {
        self.inner.n_axes()
    }

    fn n_sensors(&self) -> usize {
        self.inner.n_sensors()
    }

    fn read(&mut self) -> Result<StateFrame, HalError> {
        let state = self.inner.read()?;
        if state.check().is_ok() {
            self.state = Some(state);
        }
        Ok(state)
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        let mode = command.check(self.n_axes())?;
        let mut allowed = *command;
        let mut clipped = 0;
        if mode == Mode::Effort {
            allowed.tau = self.limited(command)?;
            for i in 0..self.n_axes() {
                clipped |= u32::from(allowed.tau[i].to_bits() != command.tau[i].to_bits()) << i;
            }
        }
        self.inner.write(&allowed.sealed())?;
        self.clipped = clipped;
        self.clips += u64::from(clipped != 0);
        self.sent = if mode == Mode::Effort { allowed.tau } else { [0.0; MAX_AXES] };
        // States that come out of order give no time twice.
        self.sent_ns = self.sent_ns.max(Some(self.stamp_ns()));
        Ok(())
    }

    fn sent(&self) -> Option<&[f64; MAX_AXES]> {
        self.inner.sent().or(Some(&self.sent))
    }

    fn reconnect(&mut self) {
        self.inner.reconnect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backends::Loopback;
    use crate::clock::ManualClock;

    const KNEE: AxisLimits =
        AxisLimits { lower: -1.0, upper: 1.0, velocity: 2.0, effort: 50.0, effort_rate: 1000.0, position_gain: 10.0, velocity_gain: 20.0 };

    fn asked<B: Backend>(limiter: &mut Limiter<B>, tau: f64, stamp_ns: u64) -> Result<(), HalError> {
        let mut command = CommandFrame { stamp_ns, ..CommandFrame::new(1, Mode::Effort) };
        command.tau[0] = tau;
        limiter.write(&command.sealed())
    }

    #[test]
    fn efforts_stay_in_the_window_of_position_and_speed() {
        let clock = ManualClock::new(0);
        let limits = AxisLimits { effort_rate: f64::INFINITY, ..KNEE };
        // Position, velocity, asked, allowed: 20·(bound − v), bound = 10·(end − q) within ±2, efforts within ±50.
        let cases = [
            (0.0, 0.0, 60.0, 40.0),
            (0.0, 0.0, 30.0, 30.0),
            (0.0, 1.9, 30.0, 20.0 * (2.0 - 1.9)),
            (0.0, 3.0, 30.0, -20.0),
            (0.95, 0.0, 30.0, 20.0 * 10.0 * (1.0 - 0.95)),
            (0.95, 0.0, -30.0, -30.0),
            (1.1, 0.0, 30.0, 20.0 * 10.0 * (1.0 - 1.1)),
            (-1.1, 0.0, -30.0, 20.0),
            (9.0, 0.0, 30.0, -40.0),
        ];
        for (q, v, tau, want) in cases {
            let mut limiter = Limiter::try_new(Loopback::new(1, &clock), &[limits]).unwrap();
            assert_eq!(asked(&mut limiter, tau, 0), Err(HalError::NoState));
            limiter.inner_mut().place(&[q], &[v]);
            limiter.read().unwrap();
            asked(&mut limiter, tau, 0).unwrap();
            let got = limiter.read().unwrap().tau[0];
            assert!((got - want).abs() < 1e-12, "at {q}, {v}: {got}, not {want}");
            let is_clipped = u32::from((tau - want).abs() > 1e-12);
            assert_eq!((limiter.clipped(), limiter.clips()), (is_clipped, u64::from(is_clipped)));
        }
    }

    #[test]
    fn efforts_change_no_faster_than_their_rate_and_a_pause_is_no_licence() {
        let clock = ManualClock::new(0);
        let mut limiter = Limiter::try_new(Loopback::new(1, &clock), &[AxisLimits { velocity: 1e3, ..KNEE }]).unwrap();
        // The commander's own stamps run wild.
        let mut after = |ms: u64, tau: f64| {
            clock.advance(ms * 1_000_000);
            limiter.read().unwrap();
            asked(&mut limiter, tau, u64::MAX / (1 + ms)).unwrap();
            limiter.read().unwrap().tau[0]
        };
        let got = [after(5, 0.0), after(1, 10.0), after(2, 10.0), after(0, 10.0), after(1, -10.0), after(1, -10.0), after(10_000, 49.0)];
        for (got, want) in got.iter().zip([0.0, 1.0, 3.0, 3.0, 0.0, -1.0, 19.0]) {
            assert!((got - want).abs() < 1e-9, "{got}, not {want}");
        }
    }

    #[test]
    fn a_first_effort_is_rated_and_one_towards_zero_is_not() {
        let clock = ManualClock::new(0);
        let mut limiter = Limiter::try_new(Loopback::new(1, &clock), &[AxisLimits { velocity: 1e3, ..KNEE }]).unwrap();
        limiter.read().unwrap();
        asked(&mut limiter, 49.0, 0).unwrap();
        assert!((limiter.read().unwrap().tau[0] - 20.0).abs() < 1e-12);
        // No time has passed: no more, but as much less as is wished.
        for (tau, want) in [(49.0, 20.0), (4.0, 4.0), (49.0, 4.0), (-49.0, 0.0)] {
            asked(&mut limiter, tau, 1_000_000_000).unwrap();
            assert!((limiter.read().unwrap().tau[0] - want).abs() < 1e-12, "{tau}");
        }
    }

    #[test]
    fn numbers_that_are_none_and_limits_that_bound_nothing_are_refused() {
        let clock = ManualClock::new(0);
        let mut limiter = Limiter::try_new(Loopback::new(1, &clock), &[AxisLimits::of_effort(5.0)]).unwrap();
        assert_eq!(asked(&mut limiter, f64::NAN, 0), Err(HalError::NotFinite { signal: "tau", index: 0 }));
        assert_eq!(limiter.read().unwrap().command_sequence, 0);
        let bad = [
            AxisLimits { effort: f64::NAN, ..KNEE },
            AxisLimits { effort_rate: 0.0, ..KNEE },
            AxisLimits { velocity: f64::NAN, ..KNEE },
            AxisLimits { lower: 2.0, ..KNEE },
            AxisLimits { velocity_gain: 0.0, ..KNEE },
            AxisLimits { position_gain: f64::INFINITY, ..KNEE },
        ];
        for limits in bad {
            assert!(Limiter::try_new(Loopback::new(1, &clock), &[limits]).is_err(), "{limits:?}");
        }
        assert!(Limiter::try_new(Loopback::new(2, &clock), &[KNEE]).is_err());
    }
}
