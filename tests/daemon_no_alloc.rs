//! Nothing is allocated or freed in the daemon's loop: not while it plays, not at an order, not at a fault.
#![expect(unsafe_code, reason = "a global allocator cannot be written without it; it only counts and hands on to the system's")]

#[allow(dead_code, reason = "shared: one test counts what is taken, another every call")]
mod counting;
#[allow(dead_code, reason = "shared: no test uses all of it")]
#[path = "daemon/rig.rs"]
mod rig;

use pkm_daemon::gate::GateLimits;
use pkm_daemon::machine::Tick;
use pkm_daemon::{Motion, Order, OrderKind};
use pkm_hal::backends::Loopback;
use pkm_hal::{Backend, Cause, Clock, MAX_AXES, ManualClock, Phase};
use rig::{Rig, controller, robot, settings};

/// One period on a robot that follows its reference, and what it cost the allocator.
fn period(rig: &mut Rig<'_, Loopback<&ManualClock>>) -> usize {
    let q = rig.records.last().filter(|r| Phase::of(r.phase).is_some_and(Phase::is_moving)).map_or([0.14; MAX_AXES], |r| r.q_ref);
    rig.machine.hal_mut().place(&q[..3], &[0.0; 3]);
    rig.clock.advance(5_000_000);
    let now_ns = rig.clock.now_ns();
    rig.lines.heartbeat.store(now_ns, core::sync::atomic::Ordering::Relaxed);
    let tick = Tick { beat: rig.grid.woken(now_ns), woken_ns: now_ns, is_overrun: false };
    let before = counting::calls();
    rig.machine.step(&tick, rig.clock);
    let cost = counting::calls() - before;
    rig.grid.done(now_ns);
    rig.collect();
    cost
}

fn order(rig: &mut Rig<'_, Loopback<&ManualClock>>, order: Order) -> usize {
    rig.lines.orders.push(order).expect("there is room");
    let cost = period(rig);
    let answer = rig.lines.answers.pop().expect("an answer");
    assert_eq!(answer.outcome, Ok(()));
    cost
}

#[test]
fn from_arming_to_a_fault_the_loop_never_calls_the_allocator() {
    let clock = ManualClock::new(0);
    let robot = robot("prs3");
    let mut settings = settings(&robot);
    // A robot that is where it is wanted to be one period late.
    let mut limits = (*settings.limits).clone();
    (limits.home, limits.gate) = (None, GateLimits { stuck: [1.0; MAX_AXES], ..*limits.gate }.into());
    settings.limits = limits.into();
    let mut rig = Rig::new(Loopback::new(3, &clock), robot, settings, &clock);
    let mut cost = (0..5).map(|_| period(&mut rig)).sum::<usize>();
    let first = Some(controller(&rig.robot));
    cost += order(&mut rig, Order { nonce: 7, controller: first, ..Order::plain(OrderKind::Arm, 1) });
    cost += (0..5).map(|_| period(&mut rig)).sum::<usize>();
    assert_eq!(rig.machine.phase(), Phase::Holding);
    let wave = |length| -> Option<Box<dyn Motion>> {
        let mut centre = [0.0; MAX_AXES];
        centre[..3].fill(0.14);
        Some(Box::new(rig::Wave { centre, height: 0.05, length }))
    };
    // Another law, so that controllers are exchanged; to its end, then again, stopped, then a fault.
    let (run, hold) = (Some(controller(&rig.robot)), Some(controller(&rig.robot)));
    let start = Order { motion: wave(Some(1.0)), controller: run, hold, ..Order::plain(OrderKind::Start, 2) };
    cost += order(&mut rig, start);
    cost += (0..400).map(|_| period(&mut rig)).sum::<usize>();
    assert_eq!(rig.machine.phase(), Phase::Holding);
    cost += order(&mut rig, Order { motion: wave(None), ..Order::plain(OrderKind::Start, 3) });
    cost += (0..200).map(|_| period(&mut rig)).sum::<usize>();
    assert_eq!(rig.machine.phase(), Phase::Position);
    cost += order(&mut rig, Order::plain(OrderKind::Stop, 4));
    cost += (0..200).map(|_| period(&mut rig)).sum::<usize>();
    cost += order(&mut rig, Order { motion: wave(None), ..Order::plain(OrderKind::Start, 5) });
    cost += (0..100).map(|_| period(&mut rig)).sum::<usize>();
    // A position far off, three times and then for good: a fault.
    rig.machine.hal_mut().place(&[0.0; 3], &[0.0; 3]);
    for _ in 0..6 {
        rig.clock.advance(5_000_000);
        let now_ns = rig.clock.now_ns();
        let tick = Tick { beat: rig.grid.woken(now_ns), woken_ns: now_ns, is_overrun: false };
        let before = counting::calls();
        rig.machine.step(&tick, rig.clock);
        cost += counting::calls() - before;
        rig.grid.done(now_ns);
        rig.collect();
    }
    assert_eq!(rig.transitions.last().map(|t| t.cause), Some(Cause::Jump));
    assert!(rig.transitions.iter().any(|t| t.to == Phase::Holding && t.cause == Cause::Arrived));
    assert_eq!(cost, 0, "calls of the allocator in {} periods", rig.machine.counts().periods);
    // The counter counts.
    let before = counting::calls();
    drop(core::hint::black_box(Box::new(rig.machine.hal_mut().n_axes())));
    assert_eq!(counting::calls() - before, 2);
}
