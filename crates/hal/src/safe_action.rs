//! What a robot does when nobody may command it: zero effort is not always safe, a limb that is held against its weight would fall.

use crate::backend::HalError;
use crate::frame::{MAX_AXES, Mode, Signal, StateFrame};

/// What is done with the drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SafeKind {
    /// Power off.
    Off,
    /// Efforts fall evenly from those of late to zero within [`SafeAction::ramp_ns`].
    Ramp,
    /// `−damping·v`: the robot sinks slowly.
    Damp,
    /// The effort of late, which carries the weight, and `stiffness·(q₀ − q) − damping·v` about the position at the trip.
    Hold,
    /// Mechanical brakes; power off where there are none.
    Brake,
}

/// The safe action of a robot, with its numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SafeAction {
    /// Which.
    pub kind: SafeKind,
    /// Of [`SafeKind::Ramp`] `[ns]`.
    pub ramp_ns: u64,
    /// Of [`SafeKind::Hold`] `[N/m | N·m/rad]`.
    pub stiffness: [f64; MAX_AXES],
    /// Of [`SafeKind::Hold`] and [`SafeKind::Damp`] `[N·s/m | N·m·s/rad]`.
    pub damping: [f64; MAX_AXES],
    /// Largest effort of it `[N | N·m]`.
    pub effort: [f64; MAX_AXES],
}

impl SafeAction {
    /// An action without ramp, stiffness, damping or bound.
    #[must_use]
    pub const fn new(kind: SafeKind) -> Self {
        Self { kind, ramp_ns: 0, stiffness: [0.0; MAX_AXES], damping: [0.0; MAX_AXES], effort: [f64::MAX; MAX_AXES] }
    }

    /// Whether the numbers are usable.
    ///
    /// # Errors
    /// The first that is negative or none.
    pub fn check(&self) -> Result<(), HalError> {
        let rows = [("stiffness", &self.stiffness), ("damping", &self.damping), ("effort", &self.effort)];
        for (what, row) in rows {
            if let Some(axis) = row.iter().position(|x| !(x.is_finite() && *x >= 0.0)) {
                return Err(HalError::Config { axis, what, value: row[axis], limit: "must be finite and not negative" });
            }
        }
        Ok(())
    }
}

/// How long efforts are averaged over `[ns]`: a controller that goes wrong flips signs within periods, a weight changes in tenths of seconds.
const AVERAGED_NS: u64 = 50_000_000;

/// What the drives have given of late: a hold starts from it, where the last effort alone may be the one that was wrong.
///
/// A first-order low-pass of 50 ms, stepped implicitly, so that a pause of any length is stable; efforts that stay are kept bit by bit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Carried {
    tau: [f64; MAX_AXES],
    /// When efforts were noted last `[ns]`; none: the drives give nothing.
    at_ns: Option<u64>,
}

impl Carried {
    /// Notes efforts `tau` that go to the drives at `now_ns` `[ns]` `[N | N·m]`.
    pub fn note(&mut self, tau: &[f64; MAX_AXES], now_ns: u64) {
        let Some(before_ns) = self.at_ns.replace(now_ns) else {
            self.tau = *tau;
            return;
        };
        let passed = now_ns.saturating_sub(before_ns) as f64;
        let share = passed / (passed + AVERAGED_NS as f64);
        for (mean, tau) in self.tau.iter_mut().zip(tau) {
            *mean += share * (tau - *mean);
        }
    }

    /// The drives give nothing any more.
    pub const fn drop_all(&mut self) {
        *self = Self { tau: [0.0; MAX_AXES], at_ns: None };
    }

    /// The average `[N | N·m]`.
    #[must_use]
    pub const fn tau(&self) -> &[f64; MAX_AXES] {
        &self.tau
    }
}

/// What was known when the robot was taken from its commander.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trip {
    /// When `[ns]`.
    pub at_ns: u64,
    /// The efforts of late, averaged as [`Carried`] does `[N | N·m]`.
    pub tau: [f64; MAX_AXES],
    /// Positions then `[m | rad]`, where they were measured: elsewhere no spring is hung up.
    pub q: [Option<f64>; MAX_AXES],
}

impl SafeAction {
    /// Mode and efforts at `now_ns` `[ns]` after `trip`; `state` only if it can be trusted now: what it did not measure is not fed back.
    #[must_use]
    pub fn command(&self, trip: &Trip, state: Option<&StateFrame>, now_ns: u64) -> (Mode, [f64; MAX_AXES]) {
        let mut tau = [0.0; MAX_AXES];
        for (i, tau) in tau.iter_mut().enumerate() {
            let measured = |signal| state.and_then(|s| s.measured(signal, i));
            let v = measured(Signal::Velocity).unwrap_or(0.0);
            let stretch = trip.q[i].zip(measured(Signal::Position)).map_or(0.0, |(start, q)| start - q);
            let wanted = match self.kind {
                SafeKind::Off | SafeKind::Brake => 0.0,
                SafeKind::Ramp => trip.tau[i] * self.left_of_ramp(now_ns.saturating_sub(trip.at_ns)),
                SafeKind::Damp => -self.damping[i] * v,
                SafeKind::Hold => trip.tau[i] + self.stiffness[i] * stretch - self.damping[i] * v,
            };
            // A product of numbers may overflow to none.
            *tau = if wanted.is_finite() { wanted.clamp(-self.effort[i], self.effort[i]) } else { 0.0 };
        }
        let mode = match self.kind {
            SafeKind::Off => Mode::Off,
            SafeKind::Brake => Mode::Brake,
            SafeKind::Ramp | SafeKind::Damp | SafeKind::Hold => Mode::Effort,
        };
        (mode, tau)
    }

    fn left_of_ramp(&self, passed_ns: u64) -> f64 {
        if passed_ns < self.ramp_ns { 1.0 - passed_ns as f64 / self.ramp_ns as f64 } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn first(action: &SafeAction, state: Option<&StateFrame>, now_ns: u64) -> (Mode, f64) {
        let trip = Trip { at_ns: 1000, tau: [8.0; MAX_AXES], q: [Some(0.5); MAX_AXES] };
        let (mode, tau) = action.command(&trip, state, now_ns);
        (mode, tau[0])
    }

    fn measured(q: f64, v: f64) -> StateFrame {
        let mut state = StateFrame { valid_q: 1, valid_v: 1, ..StateFrame::new(1, 0) };
        (state.q[0], state.v[0]) = (q, v);
        state
    }

    #[test]
    fn what_was_not_measured_is_not_fed_back() {
        let mut action = SafeAction::new(SafeKind::Hold);
        (action.stiffness[0], action.damping[0]) = (4.0, 3.0);
        let state = measured(0.25, -2.0);
        assert_eq!(first(&action, Some(&StateFrame { valid_q: 0, ..state }), 1000), (Mode::Effort, 8.0 + 6.0));
        assert_eq!(first(&action, Some(&StateFrame { valid_v: 0, ..state }), 1000), (Mode::Effort, 8.0 + 1.0));
        let trip = Trip { at_ns: 1000, tau: [8.0; MAX_AXES], q: [None; MAX_AXES] };
        assert!((action.command(&trip, Some(&state), 1000).1[0] - 14.0).abs() < 1e-12);
    }

    #[test]
    fn what_is_carried_is_the_weight_and_not_the_last_flip() {
        let mut carried = Carried::default();
        carried.note(&[80.0; MAX_AXES], 0);
        let period_ns = 5_000_000;
        for i in 1..200 {
            carried.note(&[80.0; MAX_AXES], i * period_ns);
        }
        assert!((carried.tau()[0] - 80.0).abs() < f64::EPSILON);
        // Saturated to and fro about it: the average stays within one step of the filter, 1400·5/(5 + 50).
        for i in 200..400 {
            carried.note(&[if i % 2 == 0 { 1480.0 } else { -1320.0 }; MAX_AXES], i * period_ns);
            assert!((carried.tau()[0] - 80.0).abs() < 1400.0 / 11.0 + 1e-9, "{}", carried.tau()[0]);
        }
        // A step, after its time constant: 1 − 1/(1 + 1/10)^10.
        carried.drop_all();
        carried.note(&[0.0; MAX_AXES], 0);
        (1..=10).for_each(|i| carried.note(&[1.0; MAX_AXES], i * period_ns));
        assert!((carried.tau()[0] - (1.0 - 1.0 / (0..10).fold(1.0, |x, _| 1.1 * x))).abs() < 1e-12);
    }

    #[test]
    fn each_kind_is_its_equation() {
        let state = measured(0.25, -2.0);
        let mut action = SafeAction::new(SafeKind::Hold);
        (action.stiffness[0], action.damping[0], action.ramp_ns) = (4.0, 3.0, 400);
        assert_eq!(first(&action, Some(&state), 1000), (Mode::Effort, 8.0 + 1.0 + 6.0));
        assert_eq!(first(&action, None, 1000), (Mode::Effort, 8.0));
        action.effort[0] = 10.0;
        assert_eq!(first(&action, Some(&state), 1000), (Mode::Effort, 10.0));
        action.kind = SafeKind::Damp;
        assert_eq!(first(&action, Some(&state), 1000), (Mode::Effort, 6.0));
        action.kind = SafeKind::Ramp;
        for (now_ns, want) in [(900, 8.0), (1100, 6.0), (1400, 0.0), (u64::MAX, 0.0)] {
            assert_eq!(first(&action, None, now_ns), (Mode::Effort, want));
        }
        action.kind = SafeKind::Brake;
        assert_eq!(first(&action, Some(&state), 1000), (Mode::Brake, 0.0));
        action.kind = SafeKind::Off;
        assert_eq!(first(&action, Some(&state), 1000), (Mode::Off, 0.0));
    }

    #[test]
    fn numbers_that_overflow_give_no_effort_and_nonsense_is_refused() {
        let state = measured(0.0, 1e300);
        let mut action = SafeAction::new(SafeKind::Damp);
        action.damping[0] = 1e300;
        assert_eq!(first(&action, Some(&state), 1000), (Mode::Effort, 0.0));
        action.damping[3] = -1.0;
        assert!(matches!(action.check(), Err(HalError::Config { axis: 3, what: "damping", .. })));
    }
}
