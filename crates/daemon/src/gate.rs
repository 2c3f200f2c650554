//! What is believed of a robot's states: whole frames, in order, of numbers that a robot can have reached.

use alloc::sync::Arc;

use pkm_hal::frame::{first_bits, status};
use pkm_hal::{Cause, HalError, MAX_AXES, StateFrame};

/// Frames in a row that may be broken or jump before that is more than a spike.
pub const SPIKES: u32 = 3;

/// How much faster than its limit a drive may be seen to be before a position is a jump.
const FASTER: f64 = 1.5;

/// Why the robot cannot go on, with the numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Offence {
    /// Why.
    pub cause: Cause,
    /// Which axis or component.
    pub place: usize,
    /// The value, in the unit of the cause.
    pub value: f64,
    /// What it should have been.
    pub limit: f64,
}

impl Offence {
    /// Of the robot as a whole.
    #[must_use]
    pub const fn of(cause: Cause, value: f64, limit: f64) -> Self {
        Self { cause, place: 0, value, limit }
    }
}

/// Numbers of a [`Gate`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GateLimits {
    /// Age from which a state is late `[ns]`.
    pub late_ns: u64,
    /// Age from which nobody may act on it `[ns]`.
    pub stale_ns: u64,
    /// How far ahead of the clock a stamp may lie `[ns]`.
    pub ahead_ns: u64,
    /// Speeds of the drives, ∞ where none is known `[m/s | rad/s]`.
    pub speed: [f64; MAX_AXES],
    /// How far a position may be off what speed explains `[m | rad]`.
    pub jump: [f64; MAX_AXES],
    /// How far a reference may go while its drive's position stays the same to the last bit `[m | rad]`.
    pub stuck: [f64; MAX_AXES],
}

/// What happened so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct GateCounts {
    /// States that were never seen: gaps in their sequence.
    pub lost: u64,
    /// Periods that brought no new state.
    pub repeated: u64,
    /// States that came after a newer one.
    pub reordered: u64,
    /// States that were broken.
    pub broken: u64,
    /// Positions that no drive reaches in that time.
    pub jumps: u64,
    /// Periods whose state was late.
    pub late: u64,
}

/// What a period brought.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Brought {
    /// A new state.
    pub is_new: bool,
    /// Something that was refused.
    pub is_refused: bool,
    /// The newest state is late.
    pub is_late: bool,
}

/// The newest believed state, and what is to be said against it.
#[derive(Debug, Clone)]
pub struct Gate {
    n: usize,
    /// Shared with who watches that they stay what they are.
    limits: Arc<GateLimits>,
    state: Option<StateFrame>,
    /// Positions of now: measured, or carried on `[m | rad]`.
    q: [f64; MAX_AXES],
    v: [f64; MAX_AXES],
    /// Time from the state before to one that came in this period, by their stamps `[s]`; zero where none came.
    q_dt: f64,
    is_carried: bool,
    broken: u32,
    jumps: u32,
    offence: Option<Offence>,
    /// Where position and reference were when the position last changed `[m | rad]`.
    still: [[f64; 2]; MAX_AXES],
    counts: GateCounts,
}

impl Gate {
    /// A gate for a robot of `n` axes (at most [`MAX_AXES`]).
    #[must_use]
    pub fn new(n: usize, limits: Arc<GateLimits>) -> Self {
        let zero = [0.0; MAX_AXES];
        Self {
            n: n.min(MAX_AXES),
            limits,
            state: None,
            q: zero,
            v: zero,
            q_dt: 0.0,
            is_carried: false,
            broken: 0,
            jumps: 0,
            offence: None,
            still: [[f64::NAN; 2]; MAX_AXES],
            counts: GateCounts::default(),
        }
    }

    /// The newest believed state.
    #[must_use]
    pub const fn state(&self) -> Option<&StateFrame> {
        self.state.as_ref()
    }

    /// Positions of now `[m | rad]`.
    #[must_use]
    pub fn q(&self) -> &[f64] {
        &self.q[..self.n]
    }

    /// Positions of now with room for every axis `[m | rad]`.
    #[must_use]
    pub const fn q_all(&self) -> &[f64; MAX_AXES] {
        &self.q
    }

    /// Time from the state before to one that came in this period, by the stamps of both `[s]`; zero where none came.
    ///
    /// No longer than what has passed since that state's stamp: one that is ahead of the clock was refused.
    #[must_use]
    pub const fn q_dt(&self) -> f64 {
        self.q_dt
    }

    /// What happened so far.
    #[must_use]
    pub const fn counts(&self) -> &GateCounts {
        &self.counts
    }

    /// Takes what a read brought at `now_ns` `[ns]`, `dt` `[s]` after the last.
    pub fn take(&mut self, read: Result<StateFrame, HalError>, now_ns: u64, dt: f64) -> Brought {
        (self.offence, self.q_dt) = (None, 0.0);
        let mut brought = Brought::default();
        match read.and_then(|frame| frame.check().map(|()| frame)) {
            Ok(frame) => self.weigh(&frame, now_ns, dt, &mut brought),
            Err(HalError::NoState) => {}
            Err(HalError::Layout { .. }) => self.offence = Some(Offence::of(Cause::Layout, 0.0, 0.0)),
            Err(HalError::Gone { code }) => self.offence = Some(Offence::of(Cause::Gone, f64::from(code), 0.0)),
            // A HAL that watches by itself says so before the age does.
            Err(HalError::Stale { age_ns, limit_ns }) => {
                self.offence = Some(Offence::of(Cause::Stale, age_ns as f64 * 1e-9, limit_ns as f64 * 1e-9));
            }
            Err(_) => self.refuse_broken(Cause::BrokenState, 0, &mut brought),
        }
        if !brought.is_new {
            self.counts.repeated += 1;
            self.carry_on(now_ns, dt);
        }
        if let Some(state) = &self.state {
            brought.is_late = now_ns.saturating_sub(state.stamp_ns) > self.limits.late_ns;
            self.counts.late += u64::from(brought.is_late);
        }
        brought
    }

    /// Why nobody may act on the state at `now_ns` `[ns]`, if nobody may.
    #[must_use]
    pub fn offence(&self, now_ns: u64) -> Option<Offence> {
        if self.offence.is_some() {
            return self.offence;
        }
        let Some(state) = &self.state else { return Some(Offence::of(Cause::NoState, 0.0, 0.0)) };
        let age_ns = now_ns.saturating_sub(state.stamp_ns);
        if age_ns > self.limits.stale_ns {
            return Some(Offence::of(Cause::Stale, age_ns as f64 * 1e-9, self.limits.stale_ns as f64 * 1e-9));
        }
        if state.status & status::STOPPED != 0 {
            return Some(Offence::of(Cause::EmergencyStop, 1.0, 0.0));
        }
        let place = state.drive_fault.trailing_zeros() as usize;
        (state.drive_fault != 0).then_some(Offence { cause: Cause::Drive, place, value: f64::from(state.drive_fault), limit: 0.0 })
    }

    /// A drive whose measured position stays the same to the last bit while its reference `q_ref` goes far. A period without a new state says
    /// nothing of an encoder: the age of the last one does.
    pub fn stuck(&mut self, q_ref: &[f64; MAX_AXES]) -> Option<Offence> {
        if self.is_carried {
            return None;
        }
        let mut found = None;
        for (k, q_ref) in q_ref.iter().enumerate().take(self.n) {
            let [q, wanted] = &mut self.still[k];
            if q.to_bits() != self.q[k].to_bits() || wanted.is_nan() {
                (*q, *wanted) = (self.q[k], *q_ref);
                continue;
            }
            let way = (q_ref - *wanted).abs();
            if way > self.limits.stuck[k] && found.is_none() {
                found = Some(Offence { cause: Cause::Stuck, place: k, value: way, limit: self.limits.stuck[k] });
            }
        }
        found
    }

    /// Forgets how long positions have stood: before something moves.
    pub fn begin(&mut self) {
        self.still = [[f64::NAN; 2]; MAX_AXES];
    }

    fn refuse_broken(&mut self, cause: Cause, place: usize, brought: &mut Brought) {
        brought.is_refused = true;
        self.counts.broken += 1;
        self.broken = self.broken.saturating_add(1);
        if self.broken > SPIKES {
            self.offence = Some(Offence { cause, place, value: f64::from(self.broken), limit: f64::from(SPIKES) });
        }
    }

    /// A whole frame: whether it is newer, complete, and where a robot can be.
    fn weigh(&mut self, frame: &StateFrame, now_ns: u64, dt: f64, brought: &mut Brought) {
        let missing = first_bits(self.n) & !frame.valid_q;
        if frame.stamp_ns.saturating_sub(now_ns) > self.limits.ahead_ns || frame.n_axes as usize != self.n {
            return self.refuse_broken(Cause::BrokenState, 0, brought);
        }
        let before = self.state;
        if let Some(last) = &before
            && frame.stamp_ns <= last.stamp_ns
        {
            self.counts.reordered += u64::from((frame.sequence, frame.stamp_ns) != (last.sequence, last.stamp_ns));
            // A clock that stands hides no robot that is elsewhere: what has passed since is known here.
            let passed = now_ns.abs_diff(last.stamp_ns) as f64 * 1e-9;
            if missing == 0
                && let Some(offence) = self.jumped(last, frame, passed.max(apart(last, frame)))
            {
                self.refuse_jump(offence, brought);
            }
            return;
        }
        if missing != 0 {
            return self.refuse_broken(Cause::NotMeasured, missing.trailing_zeros() as usize, brought);
        }
        self.broken = 0;
        if let Some(offence) = before.and_then(|last| self.jumped(&last, frame, apart(&last, frame))) {
            self.refuse_jump(offence, brought);
            if self.jumps <= SPIKES {
                return;
            }
            // It stays there: the robot is believed again, and nobody may go on as if nothing had been.
        }
        self.jumps = 0;
        // A driver that began anew counts from one.
        let gap = before.map_or(0, |last| frame.sequence.saturating_sub(last.sequence.saturating_add(1)));
        // Numbers of a driver that sends what it likes add up to more than there is room for.
        self.counts.lost = self.counts.lost.saturating_add(gap);
        self.believe(before.as_ref(), frame, dt);
        brought.is_new = true;
    }

    fn refuse_jump(&mut self, offence: Offence, brought: &mut Brought) {
        brought.is_refused = true;
        self.counts.jumps += 1;
        self.jumps = self.jumps.saturating_add(1);
        self.offence = (self.jumps > SPIKES).then_some(offence);
    }

    fn believe(&mut self, before: Option<&StateFrame>, frame: &StateFrame, dt: f64) {
        self.q_dt = before.map_or(dt, |last| apart(last, frame));
        // A tick of an encoder over next to no time is no speed to go on with.
        let passed = self.q_dt.max(dt);
        for k in 0..self.n {
            let past = before.map(|last| (frame.q[k] - last.q[k]) / passed);
            self.v[k] = past.filter(|v| v.is_finite()).unwrap_or(0.0);
            self.q[k] = frame.q[k];
        }
        (self.state, self.is_carried) = (Some(*frame), false);
    }

    /// Positions go on as they went for as long as anybody may act on the last ones: a robot that seems to stand would be pushed on.
    fn carry_on(&mut self, now_ns: u64, dt: f64) {
        if self.state.is_some_and(|state| now_ns.saturating_sub(state.stamp_ns) <= self.limits.stale_ns) {
            self.is_carried = true;
            for k in 0..self.n {
                self.q[k] += self.v[k] * dt;
            }
        }
    }

    /// A place where no drive can have come to within `dt` `[s]`.
    fn jumped(&self, last: &StateFrame, frame: &StateFrame, dt: f64) -> Option<Offence> {
        (0..self.n).find_map(|k| {
            let (way, most) = ((frame.q[k] - last.q[k]).abs(), FASTER * self.limits.speed[k] * dt + self.limits.jump[k]);
            (way > most).then_some(Offence { cause: Cause::Jump, place: k, value: way, limit: most })
        })
    }
}

/// Time between two states by their stamps `[s]`.
fn apart(one: &StateFrame, other: &StateFrame) -> f64 {
    one.stamp_ns.abs_diff(other.stamp_ns) as f64 * 1e-9
}
