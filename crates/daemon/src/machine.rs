//! One period of the loop: read, check, decide, limit, command, record.

mod course;
mod orders;
mod session;

use alloc::sync::Arc;
use core::sync::atomic::{AtomicU64, Ordering};

use pkm_ctrl::{Limit, Running, Signals};
use pkm_hal::cycle::flags;
use pkm_hal::frame::status;
use pkm_hal::safe_action::Trip;
use pkm_hal::{
    Backend, Carried, Cause, Clock, CommandFrame, CycleRecord, CycleSink, HalError, MAX_AXES, Mode, Phase, SafeAction, Signal, Transition,
};

use crate::blend::Blend;
use crate::gate::{Brought, Gate, GateCounts, GateLimits, Offence};
use crate::grid::{Beat, LateShare};
use crate::motion::{Motion, Move, Wanted};
use crate::order::{Answer, Order, Waste};
use crate::weigher::{Weigher, Wrench};
use course::{Course, Progress, Time};
use session::Session;

/// Numbers of a [`Machine`].
#[derive(Debug, Clone, PartialEq)]
pub struct Limits {
    /// Period `[ns]`.
    pub period_ns: u64,
    /// What is believed of states.
    pub gate: Arc<GateLimits>,
    /// Largest force `[N]` and moment `[N·m]` of the environment while anything moves; ∞ where there is no limit.
    pub contact: [f64; 2],
    /// How far a drive may be from its reference `[m | rad]`.
    pub following: [f64; MAX_AXES],
    /// Speeds of moves to a pose `[m/s | rad/s]`.
    pub speed: [f64; MAX_AXES],
    /// The pose that everything starts from `[m | rad]`; none: the one it stands in.
    pub home: Option<[f64; MAX_AXES]>,
    /// How long efforts lead over from those before `[s]`.
    pub soft_start_s: f64,
    /// How long a motion that is stopped takes to slow down `[s]`.
    pub stop_s: f64,
    /// How long a command is valid `[ns]`.
    pub valid_for_ns: u64,
    /// Periods until a command must have been heard.
    pub patience: u64,
    /// Periods in a row that may end late.
    pub overruns: u64,
    /// Share of a second's periods that may end late.
    pub overrun_share: f64,
    /// How long the loop itself may stand still `[ns]`.
    pub stall_ns: u64,
    /// How long the supervisor may be silent `[ns]`.
    pub supervisor_ns: u64,
    /// What is done in a safe stop.
    pub safe: SafeAction,
}

/// Longest time that controllers are told has passed, in periods: integrators must not leap.
const LONGEST_DT: f64 = 5.0;

/// What a loop is made of.
pub struct Parts<B, S> {
    /// The robot.
    pub hal: B,
    /// Who records.
    pub sink: S,
    /// The model.
    pub weigher: Weigher,
    /// Number of the wrench sensor in the model, whose six components are the robot's first six sensors; none: no wrench.
    pub wrench: Option<usize>,
    /// Numbers; shared, so that who has time can watch that they stay what they are.
    pub limits: Arc<Limits>,
    /// Orders from outside.
    pub orders: rtrb::Consumer<Order>,
    /// Answers to them.
    pub answers: rtrb::Producer<Answer>,
    /// Changes of phase.
    pub transitions: rtrb::Producer<Transition>,
    /// When the supervisor was last alive, by the loop's clock `[ns]`.
    pub heartbeat: Arc<AtomicU64>,
}

/// What there is to know when a period begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tick {
    /// The period.
    pub beat: Beat,
    /// When the loop woke `[ns]`.
    pub woken_ns: u64,
    /// Whether the period before ended late.
    pub is_overrun: bool,
}

/// Counts of a loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Counts {
    /// Periods that ran.
    pub periods: u64,
    /// Periods that were skipped.
    pub skipped: u64,
    /// Periods that ended late.
    pub overruns: u64,
}

/// The loop.
pub struct Machine<B, S> {
    hal: B,
    sink: S,
    weigher: Weigher,
    wrench_sensor: Option<usize>,
    limits: Arc<Limits>,
    orders: rtrb::Consumer<Order>,
    answers: rtrb::Producer<Answer>,
    transitions: rtrb::Producer<Transition>,
    heartbeat: Arc<AtomicU64>,
    n: usize,
    gate: Gate,
    phase: Phase,
    session: Session,
    course: Course,
    /// What is played when the pose it begins at is reached.
    next: Option<Box<dyn Motion>>,
    wanted: Wanted,
    wrench: Wrench,
    /// The first part of the wrench that the newest state does not have.
    wrench_gap: Option<usize>,
    controller: Option<Box<dyn Running>>,
    /// The controller to return to when a law of contact has ended.
    hold: Option<Box<dyn Running>>,
    /// What is to be dropped outside.
    waste: Waste,
    blend: Blend,
    /// Whether the next effort is the first under its controller.
    is_first: bool,
    trip: Option<Trip>,
    /// Efforts sent last.
    sent: [f64; MAX_AXES],
    /// Efforts of late.
    carried: Carried,
    late_in_a_row: u64,
    late: LateShare,
    since_reconnect_ns: u64,
    counts: Counts,
    record: CycleRecord,
}

impl<B, S> core::fmt::Debug for Machine<B, S> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Machine").field("phase", &self.phase).field("counts", &self.counts).finish_non_exhaustive()
    }
}

impl<B: Backend, S: CycleSink> Machine<B, S> {
    /// A loop that has not begun: the phase is off.
    #[must_use]
    pub fn new(parts: Parts<B, S>) -> Self {
        let n = parts.hal.n_axes().min(MAX_AXES);
        let record = CycleRecord::new(n, parts.hal.n_sensors());
        let late = LateShare::new(parts.limits.period_ns);
        Self {
            gate: Gate::new(n, Arc::clone(&parts.limits.gate)),
            hal: parts.hal,
            sink: parts.sink,
            weigher: parts.weigher,
            wrench_sensor: parts.wrench,
            limits: parts.limits,
            orders: parts.orders,
            answers: parts.answers,
            transitions: parts.transitions,
            heartbeat: parts.heartbeat,
            n,
            phase: Phase::Off,
            session: Session::default(),
            course: Course::Stand,
            next: None,
            wanted: Wanted::standing([0.0; MAX_AXES]),
            wrench: [0.0; 6],
            wrench_gap: None,
            controller: None,
            hold: None,
            waste: Waste::default(),
            blend: Blend::NONE,
            is_first: false,
            trip: None,
            sent: [0.0; MAX_AXES],
            carried: Carried::default(),
            late_in_a_row: 0,
            late,
            since_reconnect_ns: 0,
            counts: Counts::default(),
            record,
        }
    }

    /// What is being done.
    #[must_use]
    pub const fn phase(&self) -> Phase {
        self.phase
    }

    /// What happened so far.
    #[must_use]
    pub const fn counts(&self) -> &Counts {
        &self.counts
    }

    /// What happened to states so far.
    #[must_use]
    pub const fn gate_counts(&self) -> &GateCounts {
        self.gate.counts()
    }

    /// The robot.
    pub const fn hal_mut(&mut self) -> &mut B {
        &mut self.hal
    }

    /// One period. `clock` is asked for stamps only.
    pub fn step(&mut self, tick: &Tick, clock: &dyn Clock) {
        let period = self.limits.period_ns as f64 * 1e-9;
        let passed = (1 + tick.beat.skipped) as f64;
        let dt = period * passed.min(LONGEST_DT);
        self.begin(tick, dt);
        let read = self.hal.read();
        let now_ns = clock.now_ns();
        self.record.read_ns = now_ns;
        let brought = self.gate.take(read, now_ns, dt);
        self.note(brought);
        self.judge(tick, now_ns);
        self.obey();
        self.carry_on_arming(now_ns);
        let command = self.decide(dt, now_ns);
        self.record.computed_ns = clock.now_ns();
        if let Some((mode, tau)) = command {
            self.command(mode, &tau, now_ns);
        }
        self.find_again(now_ns);
        self.finish(clock.now_ns());
    }

    /// Lets the robot go after the program itself has failed: what it needs is the last that was sent, and nothing else.
    pub fn abandon(&mut self, now_ns: u64) {
        self.go(Phase::Fault, Offence::of(Cause::Internal, 0.0, 0.0), now_ns);
        if self.session.is_open {
            self.let_go(now_ns);
        }
    }

    /// Leaves the robot to its own safe action, at once where the loop was moving or holding it.
    pub fn leave(&mut self, now_ns: u64) {
        // In a safe stop the last command, which may be a brake's, stays until it expires.
        if self.session.is_open && self.phase.is_moving() {
            self.let_go(now_ns);
        }
    }

    fn begin(&mut self, tick: &Tick, dt: f64) {
        let Beat { cycle, planned_ns, skipped } = tick.beat;
        let record = &mut self.record;
        (record.cycle, record.planned_ns, record.skipped, record.woken_ns) = (cycle, planned_ns, skipped, tick.woken_ns);
        (record.dt, record.q_dt, record.flags, record.limited, record.clipped) = ([dt], [0.0], 0, 0, 0);
        record.command = CommandFrame::new(self.n, Mode::Off);
        self.counts.periods += 1;
        self.counts.skipped += skipped;
        self.counts.overruns += u64::from(tick.is_overrun);
        self.late_in_a_row = if tick.is_overrun { self.late_in_a_row + 1 } else { 0 };
        if tick.is_overrun {
            record.flags |= flags::OVERRUN;
        }
        self.late.note(tick.is_overrun);
    }

    fn note(&mut self, brought: Brought) {
        let bits = [(brought.is_new, flags::NEW_STATE), (brought.is_late, flags::LATE_STATE), (brought.is_refused, flags::REFUSED_STATE)];
        self.record.flags |= bits.iter().filter(|(is_set, _)| *is_set).fold(0, |all, (_, bit)| all | bit);
        let Some(state) = self.gate.state() else { return };
        self.record.state = *state;
        self.record.q_dt = [self.gate.q_dt()];
        if let Some(sensor) = self.wrench_sensor {
            let parts: [Option<f64>; 6] = core::array::from_fn(|i| state.measured(Signal::Sensor, i));
            self.wrench_gap = parts.iter().position(Option::is_none);
            // A part that is missing is not zero newtons: under a law of contact it ends what is being done.
            let measured: Wrench = parts.map(|part| part.unwrap_or(0.0));
            self.wrench = self.weigher.in_root_axes(sensor, &measured);
            self.record.wrench = self.wrench;
        }
    }

    /// Everything that may end what is being done, the gravest first.
    fn judge(&mut self, tick: &Tick, now_ns: u64) {
        let session = match self.gate.state() {
            Some(state) if self.record.flags & flags::NEW_STATE != 0 => self.session.offence(state, self.limits.patience),
            _ => None,
        };
        let bad = self.gate.offence(now_ns).or_else(|| self.missing_wrench()).or_else(|| self.excess_wrench());
        match self.phase {
            Phase::Off if bad.is_none() => self.go(Phase::Ready, Offence::of(Cause::RobotThere, 0.0, 0.0), now_ns),
            Phase::Off | Phase::Fault => {}
            Phase::Ready if !self.session.is_open => {
                if let Some(offence) = bad {
                    self.go(Phase::Off, offence, now_ns);
                }
            }
            Phase::Ready => {
                if let Some(offence) = session.or(bad) {
                    self.go(Phase::Fault, offence, now_ns);
                }
            }
            // What the robot's side does by itself then is its own safe action.
            Phase::SafeStop => self.session.is_open &= session.is_none(),
            _ => {
                if let Some(offence) = self.timing(tick, now_ns).or(bad) {
                    self.go(after(offence.cause), offence, now_ns);
                } else if let Some(offence) = session {
                    self.go(Phase::Fault, offence, now_ns);
                }
            }
        }
    }

    /// A wrench that is not whole under a law that acts on it.
    fn missing_wrench(&self) -> Option<Offence> {
        let place = self.wrench_gap.filter(|_| matches!(self.phase, Phase::Force | Phase::Exercise))?;
        Some(Offence { cause: Cause::NotMeasured, place, value: 0.0, limit: 0.0 })
    }

    /// A push of the environment that is harder than anybody may be pushed back.
    fn excess_wrench(&self) -> Option<Offence> {
        if !self.phase.is_moving() {
            return None;
        }
        let [force, moment] = [0, 3].map(|from| self.wrench[from..from + 3].iter().map(|x| x * x).sum::<f64>().sqrt());
        let is_over = |(value, limit): &(f64, f64)| value > limit;
        let place = [(force, self.limits.contact[0]), (moment, self.limits.contact[1])].iter().position(is_over)?;
        Some(Offence { cause: Cause::Wrench, place, value: [force, moment][place], limit: self.limits.contact[place] })
    }

    /// What the loop's own time says.
    fn timing(&self, tick: &Tick, now_ns: u64) -> Option<Offence> {
        let limits = &self.limits;
        let still_ns = (1 + tick.beat.skipped).saturating_mul(limits.period_ns);
        if tick.beat.skipped > 0 && still_ns > limits.stall_ns {
            return Some(Offence::of(Cause::Stalled, still_ns as f64 * 1e-9, limits.stall_ns as f64 * 1e-9));
        }
        if self.late_in_a_row > limits.overruns {
            return Some(Offence::of(Cause::Overruns, self.late_in_a_row as f64, limits.overruns as f64));
        }
        let share = self.late.share();
        if share > limits.overrun_share {
            return Some(Offence::of(Cause::OverrunShare, share, limits.overrun_share));
        }
        let silent_ns = now_ns.saturating_sub(self.heartbeat.load(Ordering::Relaxed));
        (silent_ns > limits.supervisor_ns)
            .then(|| Offence::of(Cause::Supervisor, silent_ns as f64 * 1e-9, limits.supervisor_ns as f64 * 1e-9))
    }

    /// Opens a session, and begins when the robot's side has heard of it.
    fn carry_on_arming(&mut self, now_ns: u64) {
        if self.phase != Phase::Ready || !self.session.is_open || self.controller.is_none() || self.trip.is_some() {
            return;
        }
        if self.session.sequence == 0 {
            self.command(Mode::Arm, &[0.0; MAX_AXES], now_ns);
        } else if self.session.is_heard {
            self.stand_up(now_ns);
        }
    }

    /// From the measured pose, with what was sent last: nothing leaps.
    fn stand_up(&mut self, now_ns: u64) {
        let here = *self.gate.q_all();
        if !self.session.has_efforts() {
            // What the robot's side does by itself until then.
            let state = self.gate.state().filter(|state| state.status & status::POWERED != 0);
            let now = |k| state.and_then(|state| state.measured(Signal::Effort, k)).unwrap_or(0.0);
            self.sent = core::array::from_fn(|k| if k < self.n { now(k) } else { 0.0 });
        }
        (self.trip, self.is_first) = (None, true);
        self.wanted = Wanted::standing(here);
        self.gate.begin();
        let order = Offence::of(Cause::Order, 0.0, 0.0);
        let course = self.limits.home.map(|home| Course::Go { way: Move::new(here, home, &self.limits.speed), time: Time::BEGIN });
        let phase = if course.is_some() { Phase::Homing } else { Phase::Holding };
        self.replace_course(course.unwrap_or(Course::Stand));
        self.go(phase, order, now_ns);
    }

    /// Mode and efforts of this period, if anything is to be asked.
    fn decide(&mut self, dt: f64, now_ns: u64) -> Option<(Mode, [f64; MAX_AXES])> {
        if self.phase.is_moving() {
            match self.follow(dt) {
                Ok(tau) => return Some((Mode::Effort, tau)),
                // The safe action follows in the same period.
                Err(offence) => self.go(after(offence.cause), offence, now_ns),
            }
        }
        if !self.session.is_open {
            return None;
        }
        // Without a state that can be believed the loop has nothing to hold with; the robot's side may have one.
        if self.phase == Phase::Fault || (self.trip.is_some() && self.gate.offence(now_ns).is_some()) {
            self.let_go(now_ns);
            return None;
        }
        let trip = self.trip?;
        self.record.flags |= flags::SAFE;
        Some(self.limits.safe.command(&trip, self.gate.state(), now_ns))
    }

    /// The last efforts once more, for half a period: then the robot's side applies its own safe action, and the session is over.
    fn let_go(&mut self, now_ns: u64) {
        let efforts = self.sent;
        // A session without efforts leaves the robot's own safe action as it is: none of ours may end it.
        if self.session.has_efforts() {
            self.hand_over(Mode::Effort, &efforts, now_ns, self.limits.period_ns / 2);
        }
        (self.session.is_open, self.trip) = (false, None);
    }

    /// The controller's efforts on the way.
    fn follow(&mut self, dt: f64) -> Result<[f64; MAX_AXES], Offence> {
        // A way to a pose begins when efforts no longer lead over from those before: the robot would sag on it.
        let is_leading_over = self.is_first || self.blend.is_going();
        let waits = is_leading_over && matches!(self.course, Course::Go { .. });
        if !waits && self.course.advance(&mut self.wanted, dt, self.limits.stop_s) == Progress::Done {
            self.arrive();
        }
        if !self.wanted.is_finite() {
            return Err(Offence::of(Cause::Reference, 0.0, 0.0));
        }
        self.check_following()?;
        let mut weight = [0.0; MAX_AXES];
        let q_ref = self.wanted.q;
        self.weigher.weigh(&q_ref[..self.n], &mut weight).map_err(|gap| Offence::of(Cause::Model, gap, 0.0))?;
        self.record.tau_ff = weight;
        let mut tau = self.ask(dt)?;
        if self.is_first {
            (self.blend, self.is_first) = (Blend::new(&self.sent, &tau, self.limits.soft_start_s), false);
        }
        if self.blend.is_going() {
            self.record.flags |= flags::BLENDING;
            self.blend.apply(&mut tau[..self.n], dt);
        }
        match tau.iter().position(|x| !x.is_finite()) {
            Some(place) => Err(Offence { cause: Cause::NotFinite, place, value: tau[place], limit: 0.0 }),
            None => Ok(tau),
        }
    }

    /// One step of the controller, noted with everything it was given: whoever has the record can do it again.
    fn ask(&mut self, dt: f64) -> Result<[f64; MAX_AXES], Offence> {
        let Some(controller) = &mut self.controller else { return Err(Offence::of(Cause::Internal, 0.0, 0.0)) };
        let (n, record) = (self.n, &mut self.record);
        let mut tau_meas = [0.0; MAX_AXES];
        for (k, tau) in tau_meas.iter_mut().enumerate().take(n) {
            *tau = record.state.measured(Signal::Effort, k).unwrap_or(0.0);
        }
        record.q_given = *self.gate.q_all();
        let signals = Signals {
            dt,
            q_dt: record.q_dt[0],
            q_meas: &record.q_given[..n],
            tau_meas: &tau_meas[..n],
            wrench_meas: self.wrench,
            q_ref: &self.wanted.q[..n],
            v_ref: &self.wanted.v[..n],
            a_ref: &self.wanted.a[..n],
            wrench_ref: record.wrench_ref,
            tau_ff: &record.tau_ff[..n],
        };
        let mut tau = [0.0; MAX_AXES];
        let health = controller.step(&signals, &mut tau[..n]);
        record.tau_answer = tau;
        let bits = [
            (true, flags::STEPPED),
            (self.is_first, flags::AT_REST),
            (self.hold.is_some(), flags::OTHER_LAW),
            (health.is_saturated, flags::SATURATED),
            (health.is_faulted, flags::CONTROLLER_FAULT),
        ];
        record.flags |= bits.iter().filter(|(is_set, _)| *is_set).fold(0, |all, (_, bit)| all | bit);
        record.limited = Limit::ALL.iter().enumerate().fold(0, |bits, (i, limit)| bits | u32::from(health.acted.any(*limit)) << i);
        if health.is_faulted {
            let (code, place) = health.fault.map_or((0, 0), |fault| (fault.code as u8, fault.drive));
            return Err(Offence { cause: Cause::Controller, place, value: f64::from(code), limit: 0.0 });
        }
        Ok(tau)
    }

    /// Whether the drives are where they are wanted; a law of contact goes where it is pushed.
    fn check_following(&mut self) -> Result<(), Offence> {
        if matches!(self.phase, Phase::Force | Phase::Exercise) {
            return Ok(());
        }
        if let Some(offence) = self.gate.stuck(&self.wanted.q) {
            return Err(offence);
        }
        for k in 0..self.n {
            let (error, limit) = ((self.wanted.q[k] - self.gate.q()[k]).abs(), self.limits.following[k]);
            if error > limit {
                return Err(Offence { cause: Cause::Following, place: k, value: error, limit });
            }
        }
        Ok(())
    }

    /// Hands a command over for as long as commands are valid.
    fn command(&mut self, mode: Mode, tau: &[f64; MAX_AXES], now_ns: u64) {
        self.hand_over(mode, tau, now_ns, self.limits.valid_for_ns);
    }

    /// Hands a command over, and believes what the limits outside made of it.
    fn hand_over(&mut self, mode: Mode, tau: &[f64; MAX_AXES], now_ns: u64, valid_for_ns: u64) {
        let mut command = self.session.command(self.n, mode, now_ns, valid_for_ns);
        command.state_sequence = self.record.state.sequence;
        command.tau[..self.n].copy_from_slice(&tau[..self.n]);
        let command = command.sealed();
        self.record.command = command;
        match self.hal.write(&command) {
            Ok(()) => {
                self.record.flags |= flags::COMMANDED;
                let passed = *self.hal.sent().unwrap_or(&command.tau);
                self.sent = if mode == Mode::Effort { passed } else { [0.0; MAX_AXES] };
                if mode == Mode::Effort {
                    self.carried.note(&passed, now_ns);
                } else {
                    self.carried.drop_all();
                }
                for (k, (passed, wanted)) in passed.iter().zip(&command.tau).enumerate().take(self.n) {
                    let is_clipped = mode == Mode::Effort && passed.to_bits() != wanted.to_bits();
                    self.record.clipped |= u32::from(is_clipped) << k;
                }
                self.session.is_open = mode != Mode::Off;
            }
            // The robot's side has taken over, with a safe action of its own.
            Err(_) if self.phase == Phase::SafeStop => self.session.is_open = false,
            Err(error) if self.phase != Phase::Fault => {
                self.session.is_open = false;
                self.go(Phase::Fault, Offence::of(refused(error), 0.0, 0.0), now_ns);
            }
            Err(_) => self.session.is_open = false,
        }
    }

    /// Looks for a robot that has been away for a while; never while anything moves.
    fn find_again(&mut self, now_ns: u64) {
        let is_away = !self.phase.is_moving() && self.gate.offence(now_ns).is_some();
        if is_away && now_ns.saturating_sub(self.since_reconnect_ns) > RECONNECT_NS {
            self.since_reconnect_ns = now_ns;
            self.hal.reconnect();
        }
    }

    /// Changes the phase, and says why.
    fn go(&mut self, to: Phase, why: Offence, now_ns: u64) {
        let place = u32::try_from(why.place).unwrap_or(u32::MAX);
        let transition = Transition {
            cycle: self.record.cycle,
            at_ns: now_ns,
            from: self.phase,
            to,
            cause: why.cause,
            place,
            value: why.value,
            limit: why.limit,
        };
        // A reader who sleeps misses some; the records have them all.
        let _ = self.transitions.push(transition);
        let record = &mut self.record;
        (record.cause, record.place, record.value, record.limit) = (why.cause.code(), place, [why.value], [why.limit]);
        if to == Phase::SafeStop {
            let q = core::array::from_fn(|k| (k < self.n).then(|| self.gate.q_all()[k]));
            self.trip = Some(Trip { at_ns: now_ns, tau: *self.carried.tau(), q });
        }
        if to == Phase::Fault {
            self.trip = None;
        }
        self.phase = to;
    }

    fn finish(&mut self, now_ns: u64) {
        let record = &mut self.record;
        record.phase = self.phase.code();
        record.motion_time = [self.course.time()];
        (record.q_ref, record.v_ref, record.a_ref) = (self.wanted.q, self.wanted.v, self.wanted.a);
        record.tau_sent = self.sent;
        if self.session.is_open {
            record.flags |= flags::ARMED;
        }
        record.done_ns = now_ns;
        self.sink.put(record);
    }
}

/// How long a robot is away before it is looked for in another place `[ns]`.
const RECONNECT_NS: u64 = 500_000_000;

/// What a cause ends in: the loop's own safe action while robot and state can be trusted, else the robot's.
#[must_use]
pub const fn after(cause: Cause) -> Phase {
    match cause {
        Cause::Jump
        | Cause::Stuck
        | Cause::Foreign
        | Cause::Tripped
        | Cause::Refused
        | Cause::Unheard
        | Cause::EmergencyStop
        | Cause::Drive
        | Cause::Gone
        | Cause::Layout
        | Cause::Internal
        | Cause::Corrupted => Phase::Fault,
        _ => Phase::SafeStop,
    }
}

fn refused(error: HalError) -> Cause {
    match error {
        HalError::ForeignCommander { .. } => Cause::Foreign,
        HalError::NotArmed | HalError::Expired { .. } => Cause::Tripped,
        HalError::Gone { .. } => Cause::Gone,
        _ => Cause::Refused,
    }
}
