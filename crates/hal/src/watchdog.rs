//! The dead man's switch: one commander, fresh state, commands that expire, and a safe action when any of them fails.

use crate::backend::{Backend, HalError};
use crate::clock::Clock;
use crate::frame::{CommandFrame, MAX_AXES, Mode, Signal, StateFrame, status};
use crate::safe_action::{Carried, SafeAction, SafeKind, Trip};
use crate::session::Session;

/// Times that a [`Watchdog`] watches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WatchdogLimits {
    /// Age of the newest state from which it is counted as late `[ns]`.
    pub late_ns: u64,
    /// Age of the newest state from which nobody may act on it `[ns]`.
    pub stale_ns: u64,
    /// How far ahead of the clock a stamp may lie `[ns]`.
    pub ahead_ns: u64,
    /// How long a command may be valid `[ns]`.
    pub horizon_ns: u64,
}

impl WatchdogLimits {
    /// Those of a loop of this period `[ns]`: late after 3 periods, stale after 5, commands for at most 20.
    #[must_use]
    pub const fn of_period(period_ns: u64) -> Self {
        Self {
            late_ns: period_ns.saturating_mul(3),
            stale_ns: period_ns.saturating_mul(5),
            ahead_ns: period_ns,
            horizon_ns: period_ns.saturating_mul(20),
        }
    }
}

/// What happened so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// States that were never seen: gaps in their sequence.
    pub lost: u64,
    /// Reads that brought no new state.
    pub repeated: u64,
    /// States that came after a newer one, and were ignored.
    pub reordered: u64,
    /// States that were refused: wrong layout, checksum, or numbers.
    pub rejected: u64,
    /// Reads whose newest state was late.
    pub late: u64,
    /// Commands that were refused.
    pub refused: u64,
    /// Times the robot was taken from its commander.
    pub trips: u64,
}

/// A backend that answers to one commander, for as long as he goes on commanding and the state is fresh.
///
/// Call [`Backend::read`] once a period whether somebody commands or not: it is there that an expired command or stale state is noticed,
/// the session ended, and the safe action applied, every period, until somebody arms again with a fresh nonce and sends efforts.
/// A session that never sent efforts has moved nothing: it ends with the drives off.
/// A state that is broken, or comes after a newer one, is dropped and the last good one returned instead, until that is stale.
#[derive(Debug, Clone)]
pub struct Watchdog<B, C> {
    inner: B,
    clock: C,
    limits: WatchdogLimits,
    action: SafeAction,
    session: Session,
    /// Newest good state.
    state: Option<StateFrame>,
    /// End of the last admitted command's validity `[ns]`.
    valid_until_ns: u64,
    /// Efforts that admitted commands came to, as the device's limits let them through.
    carried: Carried,
    /// Whether the session had efforts accepted.
    has_efforts: bool,
    trip: Option<Trip>,
    /// Whether the drives have yet to be switched off after a session without efforts.
    is_off_due: bool,
    /// Sequence of what was last written to the device; safe commands count on from the commander's.
    written: u64,
    counts: Counts,
}

impl<B: Backend, C: Clock> Watchdog<B, C> {
    /// Watches over `inner` with `clock`, which must be the one its states are stamped by.
    ///
    /// # Errors
    /// A safe action whose numbers are negative or none, or one that holds with an unbounded effort.
    pub fn try_new(inner: B, clock: C, limits: WatchdogLimits, action: SafeAction) -> Result<Self, HalError> {
        action.check()?;
        let unbounded = action.effort.iter().take(inner.n_axes()).position(|&effort| effort >= f64::MAX);
        if let (SafeKind::Hold, Some(axis)) = (action.kind, unbounded) {
            let limit = "must be bounded: a hold goes on for ever";
            return Err(HalError::Config { axis, what: "effort", value: f64::MAX, limit });
        }
        let session = Session::new(limits.horizon_ns);
        Ok(Self {
            inner,
            clock,
            limits,
            action,
            session,
            state: None,
            valid_until_ns: 0,
            carried: Carried::default(),
            has_efforts: false,
            trip: None,
            is_off_due: false,
            written: 0,
            counts: Counts::default(),
        })
    }

    /// What happened so far.
    #[must_use]
    pub const fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Whether a session is open.
    #[must_use]
    pub const fn is_armed(&self) -> bool {
        self.session.is_open()
    }

    /// Why the safe action is being applied, if it is: what was known at the trip.
    #[must_use]
    pub const fn trip(&self) -> Option<&Trip> {
        self.trip.as_ref()
    }

    /// The backend inside.
    pub const fn inner_mut(&mut self) -> &mut B {
        &mut self.inner
    }

    /// Takes a state from the device if it is a good one and newer than the last.
    fn take(&mut self, read: Result<StateFrame, HalError>) -> Result<(), HalError> {
        // A device without a state yet, or gone, does not answer; what came before may still be fresh.
        let state = read?;
        if let Err(error) = state.check() {
            self.counts.rejected += 1;
            return if self.state.is_some() { Ok(()) } else { Err(error) };
        }
        match self.state.map(|last| (last.sequence, state.sequence)) {
            Some((last, new)) if new == last => self.counts.repeated += 1,
            Some((last, new)) if new < last => self.counts.reordered += 1,
            before => {
                self.counts.lost += before.map_or(0, |(last, new)| new - last - 1);
                self.state = Some(state);
            }
        }
        Ok(())
    }

    /// The newest good state, if it is fresh.
    fn fresh(&mut self, now_ns: u64) -> Result<StateFrame, HalError> {
        let state = self.state.ok_or(HalError::NoState)?;
        let (age_ns, ahead_ns) = (now_ns.saturating_sub(state.stamp_ns), state.stamp_ns.saturating_sub(now_ns));
        if ahead_ns > self.limits.ahead_ns {
            return Err(HalError::Ahead { ahead_ns, limit_ns: self.limits.ahead_ns });
        }
        self.counts.late += u64::from(age_ns > self.limits.late_ns);
        if age_ns > self.limits.stale_ns {
            return Err(HalError::Stale { age_ns, limit_ns: self.limits.stale_ns });
        }
        Ok(state)
    }

    /// Takes the robot from its commander.
    fn take_over(&mut self, now_ns: u64) {
        if self.session.is_open() {
            self.session.end();
            self.counts.trips += 1;
            // A session that was armed after a trip and never sent efforts leaves the first trip's aim in place.
            if self.trip.is_none() && !self.has_efforts {
                self.is_off_due = true;
            } else if self.trip.is_none() {
                let q = core::array::from_fn(|i| self.state.and_then(|state| state.measured(Signal::Position, i)));
                self.trip = Some(Trip { at_ns: now_ns, tau: *self.carried.tau(), q });
            }
        }
    }

    /// Sends the safe command of this moment.
    fn apply(&mut self, trip: &Trip, state: Option<&StateFrame>, now_ns: u64) -> Result<(), HalError> {
        let (mode, tau) = self.action.command(trip, state, now_ns);
        let mut command = self.own(mode, now_ns);
        let n = self.inner.n_axes().min(MAX_AXES);
        command.tau[..n].copy_from_slice(&tau[..n]);
        // A device without this mode, or without the state its limits need, is switched off.
        let sent = self.inner.write(&command.sealed());
        sent.or_else(|_| self.inner.write(&self.own(Mode::Off, now_ns).sealed()))?;
        self.written += 1;
        Ok(())
    }

    /// An empty command in the last session's name, next in order.
    fn own(&self, mode: Mode, now_ns: u64) -> CommandFrame {
        CommandFrame {
            nonce: self.session.nonce(),
            sequence: self.written + 1,
            stamp_ns: now_ns,
            valid_until_ns: now_ns.saturating_add(self.limits.horizon_ns),
            state_sequence: self.state.map_or(0, |state| state.sequence),
            ..CommandFrame::new(self.inner.n_axes(), mode)
        }
    }
}

impl<B: Backend, C: Clock> Backend for Watchdog<B, C> {
    fn n_axes(&self) -> usize {
        self.inner.n_axes()
    }

    fn n_sensors(&self) -> usize {
        self.inner.n_sensors()
    }

    fn read(&mut self) -> Result<StateFrame, HalError> {
        let read = self.inner.read();
        let now_ns = self.clock.now_ns();
        let taken = self.take(read);
        let state = self.fresh(now_ns);
        if state.is_err() || now_ns > self.valid_until_ns {
            self.take_over(now_ns);
        }
        if let Some(trip) = self.trip {
            self.apply(&trip, state.as_ref().ok(), now_ns)?;
        } else if self.is_off_due {
            self.inner.write(&self.own(Mode::Off, now_ns).sealed())?;
            self.written += 1;
            self.is_off_due = false;
        }
        match (state, taken) {
            (Ok(mut state), _) => {
                (state.nonce, state.command_sequence) = (self.session.nonce(), self.session.sequence());
                if self.trip.is_some() {
                    state.status |= status::SAFE;
                }
                Ok(state.sealed())
            }
            (Err(HalError::NoState), Err(error)) | (Err(error), _) => Err(error),
        }
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        let now_ns = self.clock.now_ns();
        let admitted = self.admit(command, now_ns);
        self.counts.refused += u64::from(admitted.is_err());
        admitted
    }

    fn sent(&self) -> Option<&[f64; MAX_AXES]> {
        self.inner.sent()
    }

    fn reconnect(&mut self) {
        self.inner.reconnect();
    }
}

impl<B: Backend, C: Clock> Watchdog<B, C> {
    fn admit(&mut self, command: &CommandFrame, now_ns: u64) -> Result<(), HalError> {
        // A command that comes after the last one expired comes too late, though no read has noticed yet.
        if self.session.is_open() && now_ns > self.valid_until_ns {
            self.take_over(now_ns);
        }
        if Mode::of(command.mode) == Some(Mode::Arm) {
            // Nobody gets the robot before its state is known.
            self.fresh(now_ns)?;
        }
        let before = self.session;
        let mode = self.session.admit(command, self.inner.n_axes(), now_ns)?;
        // Arming moves nothing: the safe action goes on until the first efforts come.
        if mode == Mode::Arm {
            self.has_efforts = false;
        } else {
            let sent = CommandFrame { sequence: self.written + 1, ..*command };
            if let Err(error) = self.inner.write(&sent.sealed()) {
                self.session = before;
                return Err(error);
            }
            self.written += 1;
            (self.trip, self.is_off_due) = (None, false);
            if mode == Mode::Effort {
                self.carried.note(self.inner.sent().unwrap_or(&command.tau), now_ns);
            } else {
                self.carried.drop_all();
            }
            self.has_efforts |= mode == Mode::Effort;
        }
        self.valid_until_ns = command.valid_until_ns;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
