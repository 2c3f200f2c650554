//! What stands beside the loop: hands it orders, keeps its last seconds, tells what it does, and is missed when it dies.
//!
//! A turn every few milliseconds. The loop ends in a safe stop when turns stay away; the supervisor says so when periods do.

use alloc::collections::VecDeque;
use alloc::sync::Arc;
use core::sync::atomic::{AtomicU64, Ordering};

use pkm_ctrl::{Numbers, Running};
use pkm_hal::{Cause, CycleRecord, CycleSource, Phase, Transition};

use crate::black_box::BlackBox;
use crate::histogram::Latencies;
use crate::motion::Motion;
use crate::order::{Answer, Order, OrderKind, Refusal};
use crate::status::{REMEMBERED, Status, Told};

/// Orders and answers on their way.
pub const IN_FLIGHT: usize = 8;

/// Turns between two summaries of latencies: quantiles are not free.
const SUMMARY_EVERY: u64 = 20;

/// Turns between two looks at the numbers of controllers: about a second.
const SEALS_EVERY: u64 = 200;

/// Makes what orders need; called outside the loop.
pub trait Workshop {
    /// A controller of the position loop, at rest.
    fn hold(&mut self) -> Option<Box<dyn Running>>;

    /// A controller of the law that runs, at rest, where that is another one.
    fn run(&mut self) -> Option<Box<dyn Running>>;

    /// What is played, from its beginning.
    fn motion(&mut self) -> Option<Box<dyn Motion>>;

    /// The phase in which it is played.
    fn phase(&self) -> Phase;

    /// How long a law of contact or an exercise runs that is played without a motion `[s]`; none: until it is stopped.
    fn length_s(&self) -> Option<f64>;

    /// A number that no session had before, and not zero.
    fn nonce(&mut self) -> u64;
}

/// What becomes of what a supervisor has to say; none of it in the loop.
pub trait Reporter {
    /// The phase has changed.
    fn transition(&mut self, told: &Told);

    /// Something else, in one line.
    fn line(&mut self, text: &str);

    /// Keeps the last seconds before (and shortly after) an event; the name of the file, or why there is none.
    ///
    /// # Errors
    /// In one line.
    fn black_box(&mut self, event: &Told, records: &mut dyn ExactSizeIterator<Item = &CycleRecord>) -> Result<String, String>;
}

/// The ends of what leads into the loop and out of it.
pub struct Lines<C> {
    /// Orders.
    pub orders: rtrb::Producer<Order>,
    /// Answers to them.
    pub answers: rtrb::Consumer<Answer>,
    /// Changes of phase.
    pub transitions: rtrb::Consumer<Transition>,
    /// Every period.
    pub records: C,
    /// Told the time every turn.
    pub heartbeat: Arc<AtomicU64>,
}

/// An answer, for who asked.
pub type Outcome = (u64, Result<(), Refusal>);

/// The supervisor.
pub struct Supervisor<C, W, R> {
    lines: Lines<C>,
    workshop: W,
    reporter: R,
    black_box: BlackBox,
    latencies: Latencies,
    status: Status,
    phase: Phase,
    last_id: u64,
    turns: u64,
    outcomes: VecDeque<Outcome>,
    /// When a period was last seen `[ns]`.
    seen_ns: u64,
    /// Numbers of the controllers that were handed over, with the sums they had then.
    sealed: Vec<(Numbers, u64)>,
    /// Limits of the loop, likewise.
    limits: Vec<(Numbers, u64)>,
}

impl<C, W, R> core::fmt::Debug for Supervisor<C, W, R> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Supervisor").field("status", &self.status).finish_non_exhaustive()
    }
}

impl<C: CycleSource, W: Workshop, R: Reporter> Supervisor<C, W, R> {
    /// A supervisor that has seen nothing yet; `status` says what does not change, `now_ns` is the time `[ns]`.
    #[must_use]
    pub fn new(lines: Lines<C>, workshop: W, reporter: R, black_box: BlackBox, status: Status, now_ns: u64) -> Self {
        lines.heartbeat.store(now_ns, Ordering::Relaxed);
        Self {
            lines,
            workshop,
            reporter,
            black_box,
            latencies: Latencies::default(),
            status,
            phase: Phase::Off,
            last_id: 0,
            turns: 0,
            outcomes: VecDeque::new(),
            seen_ns: now_ns,
            sealed: Vec::new(),
            limits: Vec::new(),
        }
    }

    /// What there is to say.
    #[must_use]
    pub const fn status(&self) -> &Status {
        &self.status
    }

    /// The same, for what others know: rights, numbers of the recorder.
    pub const fn status_mut(&mut self) -> &mut Status {
        &mut self.status
    }

    /// What is being done, as last seen.
    #[must_use]
    pub const fn phase(&self) -> Phase {
        self.phase
    }

    /// Who reports.
    pub const fn reporter_mut(&mut self) -> &mut R {
        &mut self.reporter
    }

    /// Who makes what orders need.
    pub const fn workshop_mut(&mut self) -> &mut W {
        &mut self.workshop
    }

    /// When a period was last seen `[ns]`.
    #[must_use]
    pub const fn seen_ns(&self) -> u64 {
        self.seen_ns
    }

    /// Hands an order over; its number, for the answer. None where the loop does not take orders any more.
    pub fn order(&mut self, kind: OrderKind, cause: Cause) -> Option<u64> {
        self.last_id += 1;
        let mut order = Order { cause, ..Order::plain(kind, self.last_id) };
        match kind {
            OrderKind::Arm => {
                order.nonce = self.workshop.nonce();
                order.controller = self.workshop.hold();
            }
            OrderKind::Start => {
                order.controller = self.workshop.run();
                order.hold = if order.controller.is_some() { self.workshop.hold() } else { None };
                order.motion = self.workshop.motion();
                (order.phase, order.length_s) = (self.workshop.phase(), self.workshop.length_s());
            }
            OrderKind::Stop | OrderKind::SafeStop | OrderKind::ClearFault | OrderKind::Off => {}
        }
        let numbers = [&order.controller, &order.hold].into_iter().flatten().filter_map(|controller| controller.numbers());
        self.sealed.extend(numbers.map(sealed));
        self.lines.orders.push(order).ok().map(|()| self.last_id)
    }

    /// The oldest answer that nobody has taken.
    pub fn outcome(&mut self) -> Option<Outcome> {
        self.outcomes.pop_front()
    }

    /// One turn at `now_ns` `[ns]`; `is_last` when the loop has ended.
    pub fn turn(&mut self, now_ns: u64, is_last: bool) {
        self.lines.heartbeat.store(now_ns, Ordering::Relaxed);
        self.turns += 1;
        let mut last = None;
        while let Some(record) = self.lines.records.take() {
            self.black_box.put(&record);
            self.latencies.note(&record);
            self.status.count(&record);
            last = Some(record);
        }
        if let Some(record) = last {
            self.seen_ns = now_ns;
            self.status.note(&record);
            self.phase = Phase::of(record.phase).unwrap_or(self.phase);
        }
        self.status.records_lost = self.lines.records.lost();
        while let Ok(transition) = self.lines.transitions.pop() {
            self.black_box.happened(&transition);
            let told = Told::new(&transition);
            self.reporter.transition(&told);
            if self.status.transitions.len() >= REMEMBERED {
                self.status.transitions.remove(0);
            }
            self.status.transitions.push(told);
        }
        // What is in an answer is dropped here, outside the loop.
        while let Ok(answer) = self.lines.answers.pop() {
            self.outcomes.push_back((answer.id, answer.outcome));
        }
        while self.outcomes.len() > IN_FLIGHT {
            self.outcomes.pop_front();
        }
        if self.turns.is_multiple_of(SUMMARY_EVERY) || is_last {
            self.status.latency = self.latencies.summary();
        }
        if self.turns.is_multiple_of(SEALS_EVERY) {
            self.check_numbers();
        }
        self.keep_black_box(now_ns, is_last);
    }

    /// Watches over `limits` that the loop shares, from now on.
    pub fn watch(&mut self, limits: Numbers) {
        self.limits.push(sealed(limits));
    }

    /// Whether controllers still have the numbers they were made of, and the loop its limits: where not, the robot is taken from the loop.
    fn check_numbers(&mut self) {
        // What the loop has given back needs no look any more.
        self.sealed.retain(|(numbers, _)| numbers.is_used());
        if !self.phase.is_moving() {
            return;
        }
        let have_changed = |sealed: &[(Numbers, u64)]| sealed.iter().any(|(numbers, seal)| numbers.seal() != *seal);
        let told = if have_changed(&self.limits) {
            Some("limits have changed in memory (end this daemon: only its start reads them anew)")
        } else if have_changed(&self.sealed) {
            Some("numbers of a controller have changed in memory (`pkm order clear-fault` and `arm` read them anew)")
        } else {
            None
        };
        if let Some(told) = told {
            self.reporter.line(told);
            // A loop that takes no orders now is asked again at the next look.
            let _ = self.order(OrderKind::SafeStop, Cause::Corrupted);
        }
    }

    /// The last turn of all, for a loop that has not been heard of for `silence_ns` `[ns]` at `now_ns`: a fault, with its black box.
    pub fn give_up(&mut self, now_ns: u64, silence_ns: u64) {
        let fault = Transition {
            cycle: self.status.periods,
            at_ns: now_ns,
            from: self.phase,
            to: Phase::Fault,
            cause: Cause::Stalled,
            place: 0,
            value: now_ns.saturating_sub(self.seen_ns) as f64 * 1e-9,
            limit: silence_ns as f64 * 1e-9,
        };
        self.black_box.happened(&fault);
        self.reporter.transition(&Told::new(&fault));
        self.turn(now_ns, true);
    }

    fn keep_black_box(&mut self, now_ns: u64, is_last: bool) {
        let Some(event) = self.black_box.due(now_ns, is_last) else { return };
        let told = Told::new(&event);
        match self.reporter.black_box(&told, &mut self.black_box.records()) {
            Ok(file) => {
                if self.status.black_boxes.len() >= REMEMBERED {
                    self.status.black_boxes.remove(0);
                }
                self.status.black_boxes.push(file);
            }
            Err(problem) => self.reporter.line(&format!("black box not written: {problem}")),
        }
    }
}

/// A loop's and a supervisor's ends of everything between them but the records.
#[must_use]
pub fn lines<C>(records: C) -> (Lines<C>, LoopEnds) {
    let (orders, orders_in) = rtrb::RingBuffer::new(IN_FLIGHT);
    let (answers, answers_out) = rtrb::RingBuffer::new(IN_FLIGHT);
    let (transitions, transitions_out) = rtrb::RingBuffer::new(256);
    let heartbeat = Arc::new(AtomicU64::new(0));
    let ends = LoopEnds { orders: orders_in, answers, transitions, heartbeat: Arc::clone(&heartbeat) };
    (Lines { orders, answers: answers_out, transitions: transitions_out, records, heartbeat }, ends)
}

/// What the loop holds of [`lines`].
#[derive(Debug)]
pub struct LoopEnds {
    /// Orders from outside.
    pub orders: rtrb::Consumer<Order>,
    /// Answers to them.
    pub answers: rtrb::Producer<Answer>,
    /// Changes of phase.
    pub transitions: rtrb::Producer<Transition>,
    /// When the supervisor was last alive.
    pub heartbeat: Arc<AtomicU64>,
}

/// Numbers with the sum that they have now.
fn sealed(numbers: Numbers) -> (Numbers, u64) {
    let seal = numbers.seal();
    (numbers, seal)
}
