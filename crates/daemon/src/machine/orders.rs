//! Orders in the loop: who may go where from where.

use pkm_hal::{Backend, Cause, CycleSink, MAX_AXES, Mode, Phase};

use super::course::{Course, Time};
use super::session::Session;
use super::{Machine, after};
use crate::gate::Offence;
use crate::motion::{Move, Wanted};
use crate::order::{Answer, Order, OrderKind, Refusal};

impl<B: Backend, S: CycleSink> Machine<B, S> {
    /// Follows one order a period, if there is one and room for its answer.
    pub(super) fn obey(&mut self) {
        if self.answers.is_full() {
            return;
        }
        let Ok(mut order) = self.orders.pop() else { return };
        let outcome = self.follow_order(&mut order);
        self.waste.controller(order.controller.take());
        self.waste.controller(order.hold.take());
        self.waste.motion(order.motion.take());
        // What the loop has no use for is dropped outside.
        let _ = self.answers.push(Answer { id: order.id, outcome, waste: core::mem::take(&mut self.waste) });
    }

    fn follow_order(&mut self, order: &mut Order) -> Result<(), Refusal> {
        let here = Refusal::Phase(self.phase);
        match order.kind {
            OrderKind::Arm if self.phase == Phase::Ready => self.arm(order),
            OrderKind::Start if self.phase == Phase::Holding => self.start(order),
            OrderKind::Stop if self.phase.is_moving() => {
                self.slow_down();
                Ok(())
            }
            OrderKind::SafeStop if self.phase.is_moving() => {
                let cause = if order.cause == Cause::Started { Cause::Order } else { order.cause };
                self.go(after(cause), Offence::of(cause, 0.0, 0.0), self.record.read_ns);
                Ok(())
            }
            OrderKind::SafeStop if self.phase == Phase::SafeStop => Ok(()),
            OrderKind::ClearFault if matches!(self.phase, Phase::SafeStop | Phase::Fault) => self.clear(),
            OrderKind::Off if matches!(self.phase, Phase::Ready | Phase::Holding | Phase::SafeStop) => {
                self.switch_off();
                Ok(())
            }
            _ => Err(here),
        }
    }

    fn arm(&mut self, order: &mut Order) -> Result<(), Refusal> {
        if let Some(offence) = self.gate.offence(self.record.read_ns) {
            return Err(Refusal::State(offence.cause));
        }
        if self.session.is_open && self.trip.is_none() {
            return Err(Refusal::Arming);
        }
        if order.controller.is_none() || order.nonce == 0 {
            return Err(Refusal::Incomplete);
        }
        core::mem::swap(&mut self.controller, &mut order.controller);
        // A law that was stopped gives back to nobody: the position loop begins anew.
        let hold = self.hold.take();
        self.waste.controller(hold);
        if self.session.is_open {
            // A safe action goes on in this session: it leads over.
            self.stand_up(self.record.read_ns);
        } else {
            (self.session, self.trip, self.sent) = (Session::new(order.nonce), None, [0.0; MAX_AXES]);
        }
        Ok(())
    }

    fn start(&mut self, order: &mut Order) -> Result<(), Refusal> {
        let is_contact = matches!(order.phase, Phase::Force | Phase::Exercise);
        let is_complete = order.motion.is_some() || is_contact;
        if !is_complete || (order.controller.is_some() && order.hold.is_none()) {
            return Err(Refusal::Incomplete);
        }
        if order.controller.is_some() {
            core::mem::swap(&mut self.controller, &mut order.controller);
            core::mem::swap(&mut self.hold, &mut order.hold);
            self.is_first = true;
        }
        self.gate.begin();
        self.replace_course(if is_contact { Course::Led { time: Time::BEGIN, length: order.length_s } } else { Course::Stand });
        if let Some(mut motion) = order.motion.take() {
            let mut first = self.wanted;
            motion.at(0.0, &mut first);
            self.course = Course::Go { way: Move::new(self.wanted.q, first.q, &self.limits.speed), time: Time::BEGIN };
            self.next = Some(motion);
        }
        self.go(order.phase, Offence::of(Cause::Order, 0.0, 0.0), self.record.read_ns);
        Ok(())
    }

    /// Stops on the path, or where it is.
    fn slow_down(&mut self) {
        match &mut self.course {
            Course::Go { time, .. } | Course::Play { time, .. } => time.is_stopping = true,
            Course::Stand if self.phase == Phase::Holding => {}
            // Under a law of contact it stands where it is.
            Course::Stand | Course::Led { .. } => self.hold_here(Cause::Order),
        }
    }

    /// What comes when a course is at its end.
    pub(super) fn arrive(&mut self) {
        let was_stopped = matches!(self.course, Course::Go { time, .. } | Course::Play { time, .. } if time.is_stopping);
        if let Course::Go { .. } = &self.course
            && !was_stopped
            && let Some(motion) = self.next.take()
        {
            self.course = Course::Play { motion, time: Time::BEGIN };
            return;
        }
        if self.phase == Phase::Holding {
            return;
        }
        let cause = if was_stopped { Cause::Order } else { Cause::Arrived };
        if matches!(self.phase, Phase::Force | Phase::Exercise) {
            // A law of contact is not where its reference is.
            return self.hold_here(cause);
        }
        self.wanted = Wanted::standing(self.wanted.q);
        self.end_course(cause);
    }

    fn hold_here(&mut self, cause: Cause) {
        self.wanted = Wanted::standing(*self.gate.q_all());
        self.end_course(cause);
    }

    fn end_course(&mut self, cause: Cause) {
        self.replace_course(Course::Stand);
        if let Some(hold) = self.hold.take() {
            let before = self.controller.replace(hold);
            self.waste.controller(before);
            self.is_first = true;
        }
        if self.phase != Phase::Holding {
            self.go(Phase::Holding, Offence::of(cause, 0.0, 0.0), self.record.read_ns);
        }
    }

    /// Another course; what was played is dropped outside, where freeing memory is allowed.
    pub(super) fn replace_course(&mut self, course: Course) {
        if let Course::Play { motion, .. } = core::mem::replace(&mut self.course, course) {
            self.waste.motion(Some(motion));
        }
        let next = self.next.take();
        self.waste.motion(next);
    }

    fn clear(&mut self) -> Result<(), Refusal> {
        if let Some(offence) = self.gate.offence(self.record.read_ns) {
            return Err(Refusal::State(offence.cause));
        }
        if !self.session.is_open {
            self.trip = None;
        }
        self.go(Phase::Ready, Offence::of(Cause::Order, 0.0, 0.0), self.record.read_ns);
        Ok(())
    }

    fn switch_off(&mut self) {
        if self.session.is_open && self.session.sequence > 0 {
            self.command(Mode::Off, &[0.0; MAX_AXES], self.record.read_ns);
        }
        (self.session.is_open, self.trip) = (false, None);
        if !matches!(self.phase, Phase::Ready | Phase::Fault) {
            self.go(Phase::Ready, Offence::of(Cause::Order, 0.0, 0.0), self.record.read_ns);
        }
    }
}
