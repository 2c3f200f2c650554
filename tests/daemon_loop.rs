//! The daemon's loop on a simulated robot under a scripted clock: phases, orders, bumpless changes, time that is lost.

#[allow(dead_code, reason = "shared: no test uses all of it")]
#[path = "daemon/rig.rs"]
mod rig;

use pkm_daemon::config::DaemonConfig;
use pkm_daemon::{Motion, Order, OrderKind, Refusal, Wanted};
use pkm_hal::cycle::flags;
use pkm_hal::frame::status;
use pkm_hal::{Backend, Cause, Clock, ManualClock, Phase, Signal};
use rig::{CONFIG, Rig, controller, rig};

#[test]
fn nothing_moves_until_it_is_armed_and_every_phase_has_its_cause() {
    let clock = ManualClock::new(7_000_000_000);
    let mut rig = rig(&[], &clock);
    rig.periods(50);
    assert!(rig.records.iter().all(|r| r.flags & (flags::COMMANDED | flags::ARMED) == 0));
    assert_eq!(rig.start(None), Err(Refusal::Phase(Phase::Ready)));
    assert_eq!(rig.plain(OrderKind::Stop), Err(Refusal::Phase(Phase::Ready)));
    assert_eq!(rig.order(Order::plain(OrderKind::Arm, 0)), Err(Refusal::Incomplete));
    rig.arm().unwrap();
    assert_eq!(rig.arm(), Err(Refusal::Arming));
    rig.until(Phase::Homing, 5);
    assert_eq!(rig.arm(), Err(Refusal::Phase(Phase::Homing)));
    rig.until(Phase::Holding, 2000);
    rig.start(Some(2.0)).unwrap();
    assert_eq!(rig.arm(), Err(Refusal::Phase(Phase::Position)));
    assert_eq!(rig.plain(OrderKind::Off), Err(Refusal::Phase(Phase::Position)));
    rig.until(Phase::Holding, 1000);
    rig.plain(OrderKind::Off).unwrap();
    rig.periods(5);
    let told: Vec<_> = rig.transitions.iter().map(|t| (t.from, t.to, t.cause)).collect();
    let want = [
        (Phase::Off, Phase::Ready, Cause::RobotThere),
        (Phase::Ready, Phase::Homing, Cause::Order),
        (Phase::Homing, Phase::Holding, Cause::Arrived),
        (Phase::Holding, Phase::Position, Cause::Order),
        (Phase::Position, Phase::Holding, Cause::Arrived),
        (Phase::Holding, Phase::Ready, Cause::Order),
    ];
    assert_eq!(told, want);
    assert_eq!(rig.last().state.status & status::POWERED, 0);
    // The records say the same as the transitions.
    let phases: Vec<u32> = rig.records.iter().map(|r| r.phase).collect();
    let mut seen: Vec<u32> = phases.clone();
    seen.dedup();
    assert_eq!(seen, [Phase::Ready, Phase::Homing, Phase::Holding, Phase::Position, Phase::Holding, Phase::Ready].map(Phase::code));
}

#[test]
fn arming_starts_at_the_measured_pose_with_the_efforts_of_before() {
    let clock = ManualClock::new(0);
    let mut rig = rig(&[], &clock);
    rig.periods(3);
    rig.arm().unwrap();
    rig.until(Phase::Holding, 2000);
    let armed: Vec<_> = rig.records.iter().skip_while(|r| r.phase != Phase::Homing.code()).collect();
    for k in 0..3 {
        // Nothing was sent before, so nothing is at first; the reference begins where the drives are.
        assert!(armed[0].tau_sent[k].abs() < 1e-9, "{}", armed[0].tau_sent[k]);
        assert!((armed[0].q_ref[k] - armed[0].state.q[k]).abs() < 1e-5);
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few hundred periods")]
    let soft = (rig.settings.limits.soft_start_s * 200.0).round() as usize;
    assert_eq!(armed.iter().filter(|r| r.flags & flags::BLENDING != 0).count(), soft);
    // In no period of the way up does an effort change by more than half the weight: what falls is caught, not thrown.
    let weight = armed.iter().map(|r| r.tau_ff[0].abs()).fold(0.0, f64::max);
    for pair in armed.windows(2) {
        let step = (pair[1].tau_sent[0] - pair[0].tau_sent[0]).abs();
        assert!(step < 0.5 * weight, "{step} of {weight}");
    }
    rig.periods(100);
    let end = rig.last();
    assert!((0..3).all(|k| (end.state.q[k] - 0.15).abs() < 2e-3), "{:?}", &end.state.q[..3]);
}

#[test]
fn a_motion_is_followed_and_a_stop_stays_on_its_path() {
    let clock = ManualClock::new(0);
    let mut rig = rig(&[], &clock);
    rig.playing();
    let error = |r: &pkm_hal::CycleRecord| (0..3).map(|k| (r.q_ref[k] - r.state.q[k]).abs()).fold(0.0, f64::max);
    // What dry friction has left from standing up is gone a quarter of a second after the drives move.
    let worst = rig.records.iter().filter(|r| r.phase == Phase::Position.code()).skip(50).map(error).fold(0.0, f64::max);
    assert!(worst < 1e-3, "{worst} m");
    rig.plain(OrderKind::Stop).unwrap();
    let periods = rig.until(Phase::Holding, 1000);
    assert!((90..=101).contains(&periods), "half a second at 200 Hz: {periods}");
    let stopping = &rig.records[rig.records.len() - periods - 1..];
    for pair in stopping.windows(2) {
        for k in 0..3 {
            // All drives of the wave move alike: on the path they stay together.
            assert!((pair[1].q_ref[k] - pair[1].q_ref[0]).abs() < 1e-12);
            let v = (pair[1].q_ref[k] - pair[0].q_ref[k]) * 200.0;
            assert!(v.abs() < 0.09 && (v - pair[1].v_ref[k]).abs() < 0.01, "{v} {}", pair[1].v_ref[k]);
        }
    }
    let held = rig.last().q_ref;
    rig.periods(100);
    assert_eq!(rig.last().q_ref.map(f64::to_bits), held.map(f64::to_bits));
    assert_eq!(rig.transitions.last().map(|t| (t.to, t.cause)), Some((Phase::Holding, Cause::Order)));
}

#[test]
fn a_law_of_contact_without_its_wrench_is_stopped_and_a_position_loop_is_not() {
    let clock = ManualClock::new(0);
    let robot = rig::robot("prs3");
    // A wrench is said to be there, and the device has no sensors: no part of it is ever measured.
    let settings = pkm_daemon::config::Settings { wrench: Some(0), ..rig::settings(&robot) };
    let hal = rig::guarded(&robot, &settings, &[0.14, 0.15, 0.16], &clock);
    let mut rig = Rig::new(hal, robot, settings, &clock);
    rig.playing();
    rig.plain(OrderKind::Stop).unwrap();
    rig.until(Phase::Holding, 200);
    let (run, hold) = (Some(controller(&rig.robot)), Some(controller(&rig.robot)));
    rig.order(Order { controller: run, hold, phase: Phase::Force, ..Order::plain(OrderKind::Start, 0) }).unwrap();
    rig.periods(2);
    assert_eq!(rig.transitions.last().map(|t| (t.from, t.to, t.cause)), Some((Phase::Force, Phase::SafeStop, Cause::NotMeasured)));
}

#[test]
fn a_stop_on_the_way_home_slows_down_on_that_way() {
    let clock = ManualClock::new(0);
    let robot = rig::robot("prs3");
    let settings = rig::settings(&robot);
    let hal = rig::guarded(&robot, &settings, &[0.08; 3], &clock);
    let mut rig = Rig::new(hal, robot, settings, &clock);
    rig.periods(3);
    rig.arm().unwrap();
    rig.until(Phase::Homing, 10);
    // Until it is at its fastest.
    for _ in 0..2000 {
        rig.periods(1);
        if rig.last().v_ref[0] > 0.05 {
            break;
        }
    }
    let fast = rig.last().v_ref[0];
    assert!(fast > 0.05 && rig.machine.phase() == Phase::Homing, "{fast}");
    rig.plain(OrderKind::Stop).unwrap();
    let begin = rig.records.len() - 2;
    let periods = rig.until(Phase::Holding, 1000);
    assert!((90..=101).contains(&periods), "half a second at 200 Hz: {periods}");
    for pair in rig.records[begin..].windows(2) {
        // From its speed to a stand within half a second, evenly: never a step.
        let step = (pair[1].v_ref[0] - pair[0].v_ref[0]).abs();
        assert!(step < 4.0 * fast / 100.0, "{step} m/s in one period, from {fast}");
    }
    assert_eq!(rig.transitions.last().map(|t| (t.to, t.cause)), Some((Phase::Holding, Cause::Order)));
    let left = 0.15 - rig.last().q_ref[0];
    assert!(left > 5e-3, "it stopped on the way, not at its end: {left}");
}

/// How far a robot without brakes has come from `pose` after 3 s without a loop `[m]`.
fn gone_after(rig: &mut Rig<'_, pkm_hal::FaultyHal<'_, rig::Guarded<'_>>>, pose: &[f64]) -> f64 {
    let clock = rig.clock;
    let hal = rig.machine.hal_mut().inner_mut();
    let mut most = 0.0_f64;
    for _ in 0..600 {
        clock.advance(5_000_000);
        let Ok(state) = hal.read() else { return f64::INFINITY };
        most = (0..3).filter_map(|k| state.measured(Signal::Position, k).map(|q| (q - pose[k]).abs())).fold(most, f64::max);
    }
    most
}

#[test]
fn a_robot_that_is_left_stays_where_it_is_and_one_that_is_switched_off_falls() {
    for (is_off, range) in [(false, 0.0..0.02), (true, 0.1..f64::INFINITY)] {
        let clock = ManualClock::new(0);
        let mut rig = rig(&[], &clock);
        rig.playing();
        rig.plain(OrderKind::Stop).unwrap();
        rig.until(Phase::Holding, 200);
        let pose = rig.last().state.q;
        if is_off {
            rig.plain(OrderKind::Off).unwrap();
        }
        rig.machine.leave(clock.now_ns());
        let moved = gone_after(&mut rig, &pose);
        assert!(range.contains(&moved), "off {is_off}: {moved} m");
    }
}

#[test]
fn another_law_takes_over_without_a_bump_and_gives_back_without_one() {
    let clock = ManualClock::new(0);
    let mut rig = rig(&[], &clock);
    rig.periods(3);
    rig.arm().unwrap();
    rig.until(Phase::Holding, 2000);
    rig.periods(200);
    // Half as stiff: its first effort at the same pose is another one.
    let text = rig::CONTROLLER.replace("bandwidth = 20.0", "bandwidth = 12.0");
    let softer = pkm_ctrl::config::parse(&text, "softer", &rig.robot).unwrap();
    let (run, hold) = (Some(softer), Some(controller(&rig.robot)));
    rig.order(Order { controller: run, hold, phase: Phase::Force, ..Order::plain(OrderKind::Start, 0) }).unwrap();
    rig.periods(200);
    rig.plain(OrderKind::Stop).unwrap();
    rig.periods(200);
    assert_eq!(rig.machine.phase(), Phase::Holding);
    let from = rig.records.iter().position(|r| r.phase == Phase::Force.code()).unwrap();
    for pair in rig.records[from - 5..].windows(2) {
        for k in 0..3 {
            let step = (pair[1].tau_sent[k] - pair[0].tau_sent[k]).abs();
            assert!(step < 5.0, "period {}: {step} N", pair[1].cycle);
        }
    }
    // What the loop has no use for comes back out of it.
    let names: Vec<_> = rig.transitions.iter().map(|t| t.to).collect();
    assert_eq!(names[names.len() - 2..], [Phase::Force, Phase::Holding]);
}

#[test]
fn a_safe_stop_holds_until_it_is_cleared_and_leads_over_when_armed_again() {
    let clock = ManualClock::new(0);
    let mut rig = rig(&[], &clock);
    rig.playing();
    rig.plain(OrderKind::SafeStop).unwrap();
    let at = rig.last().state.q;
    rig.periods(400);
    assert_eq!((rig.machine.phase(), rig.last().flags & flags::SAFE), (Phase::SafeStop, flags::SAFE));
    let moved = (0..3).map(|k| (rig.last().state.q[k] - at[k]).abs()).fold(0.0, f64::max);
    assert!(moved < 0.02, "held within {moved} m");
    assert_eq!(rig.arm(), Err(Refusal::Phase(Phase::SafeStop)));
    rig.plain(OrderKind::ClearFault).unwrap();
    rig.periods(50);
    // Cleared is not let go.
    assert_eq!((rig.machine.phase(), rig.last().flags & flags::SAFE), (Phase::Ready, flags::SAFE));
    let before = rig.last().tau_sent;
    rig.arm().unwrap();
    let first = rig.records.iter().rev().find(|r| r.flags & flags::BLENDING != 0).expect("it leads over").tau_sent;
    assert!((0..3).all(|k| (first[k] - before[k]).abs() < 10.0), "{before:?} {first:?}");
    rig.until(Phase::Holding, 3000);
}

#[test]
fn a_safe_stop_that_ramps_lets_efforts_fall_evenly_to_none_and_only_clearing_leads_on() {
    let clock = ManualClock::new(0);
    let robot = rig::robot("prs3");
    let ramp = CONFIG.replace("kind      = \"hold\"", "kind      = \"ramp\"\nramp_s    = 0.5");
    let settings = DaemonConfig::parse(&ramp, "daemon.toml").unwrap().settings(&robot.model, 200.0).unwrap();
    let mut rig = Rig::new(rig::guarded(&robot, &settings, &[0.14, 0.15, 0.16], &clock), robot, settings, &clock);
    rig.playing();
    let begin = rig.records.len();
    rig.plain(OrderKind::SafeStop).unwrap();
    rig.periods(150);
    let first = rig.records[begin].command.tau;
    assert!(first[..3].iter().all(|tau| tau.abs() > 50.0), "they carry the robot: {first:?}");
    for (period, record) in rig.records[begin..].iter().enumerate() {
        let left = (1.0 - period as f64 / 100.0).max(0.0);
        let gap = (0..3).map(|k| (record.command.tau[k] - left * first[k]).abs()).fold(0.0, f64::max);
        assert!(gap < 1e-6, "period {period}: {:?} of {first:?}", record.command.tau);
    }
    assert_eq!((rig.machine.phase(), rig.arm()), (Phase::SafeStop, Err(Refusal::Phase(Phase::SafeStop))));
    rig.plain(OrderKind::ClearFault).unwrap();
    assert_eq!(rig.machine.phase(), Phase::Ready);
}

#[test]
fn late_periods_are_skipped_counted_and_told_to_the_controller() {
    let clock = ManualClock::new(0);
    let mut rig = rig(&[], &clock);
    rig.playing();
    let (before, cycle) = (*rig.machine.counts(), rig.last().cycle);
    // 5 ms periods: 7 ms of work begin the next but one.
    rig.period_of(0, 7_000_000);
    rig.periods(1);
    let late = *rig.last();
    assert_eq!((late.cycle, late.skipped, late.flags & flags::OVERRUN), (cycle + 3, 1, flags::OVERRUN));
    assert!((late.dt[0] - 0.010).abs() < 1e-12);
    assert_eq!(late.planned_ns % 5_000_000, rig.records[0].planned_ns % 5_000_000);
    rig.periods(1);
    assert_eq!((rig.last().skipped, rig.last().dt[0]), (0, 0.005));
    let after = *rig.machine.counts();
    assert_eq!((after.overruns - before.overruns, after.skipped - before.skipped, after.periods - before.periods), (1, 1, 3));
    assert_eq!(rig.machine.phase(), Phase::Position);
}

/// A motion that asks for what is no number.
struct Nonsense;

impl Motion for Nonsense {
    fn duration_s(&self) -> Option<f64> {
        None
    }

    fn at(&mut self, t: f64, wanted: &mut Wanted) {
        wanted.q[..3].fill(0.15);
        if t > 0.1 {
            wanted.q[1] = f64::NAN;
        }
    }
}

#[test]
fn a_reference_that_is_no_number_never_reaches_the_robot() {
    let clock = ManualClock::new(0);
    let mut rig = rig(&[], &clock);
    rig.periods(3);
    rig.arm().unwrap();
    rig.until(Phase::Holding, 2000);
    let motion: Option<Box<dyn Motion>> = Some(Box::new(Nonsense));
    rig.order(Order { motion, ..Order::plain(OrderKind::Start, 0) }).unwrap();
    rig.until(Phase::SafeStop, 100);
    assert_eq!(rig.transitions.last().map(|t| t.cause), Some(Cause::Reference));
    assert!(rig.records.iter().all(|r| r.command.tau.iter().chain(&r.tau_sent).all(|x| x.is_finite())));
    // In the period in which it was noticed something safe was sent.
    let noticed = rig.records.iter().find(|r| r.phase == Phase::SafeStop.code()).unwrap();
    assert_eq!(noticed.flags & (flags::SAFE | flags::COMMANDED), flags::SAFE | flags::COMMANDED);
}

#[test]
fn the_robots_own_watchdog_takes_over_when_the_loop_dies() {
    let clock = ManualClock::new(0);
    let mut rig = rig(&[], &clock);
    rig.playing();
    let pose = rig.last().state.q;
    // Nobody steps the loop any more; the robot's side is read by nobody but itself.
    let hal = rig.machine.hal_mut().inner_mut();
    let mut safe_after = None;
    for period in 1..=100_u64 {
        clock.advance(5_000_000);
        let state = hal.read().expect("the robot is there");
        if state.status & status::SAFE != 0 && safe_after.is_none() {
            safe_after = Some(period);
        }
    }
    // Valid for 50 ms, so gone after at most eleven periods of 5 ms.
    assert!(safe_after.is_some_and(|periods| periods <= 11), "{safe_after:?}");
    let state = hal.read().unwrap();
    let moved = (0..3).filter_map(|k| state.measured(Signal::Position, k).map(|q| (q - pose[k]).abs())).fold(0.0, f64::max);
    assert!(moved < 0.03, "{moved} m");
}

/// A robot whose daemon died while it played, a second after: it holds by itself.
fn held_alone(clock: &ManualClock) -> rig::Guarded<'_> {
    let robot = rig::robot("prs3");
    let settings = rig::settings(&robot);
    let mut hal = rig::guarded(&robot, &settings, &[0.14, 0.15, 0.16], clock);
    Rig::new(&mut hal, robot, settings, clock).playing();
    for _ in 0..200 {
        clock.advance(5_000_000);
        hal.read().expect("it holds by itself");
    }
    hal
}

/// Another daemon on that robot, told to arm.
fn takes_over<'c, 'h>(hal: &'h mut rig::Guarded<'c>, clock: &'c ManualClock) -> Rig<'c, &'h mut rig::Guarded<'c>> {
    let robot = rig::robot("prs3");
    let settings = rig::settings(&robot);
    let mut next = Rig::new(hal, robot, settings, clock);
    next.periods(3);
    let controller = Some(controller(&next.robot));
    next.order(Order { nonce: 77, controller, ..Order::plain(OrderKind::Arm, 0) }).expect("it may arm");
    next
}

#[test]
fn a_new_daemon_takes_over_a_robot_that_is_being_held_without_letting_it_sag() {
    let clock = ManualClock::new(0);
    let mut hal = held_alone(&clock);
    let held = hal.read().expect("a state");
    assert!(held.status & status::SAFE != 0 && held.tau[0].abs() > 20.0, "{held:?}");
    let mut next = takes_over(&mut hal, &clock);
    next.until(Phase::Homing, 10);
    next.periods(60);
    let first = next.records.iter().find(|r| r.flags & flags::BLENDING != 0).expect("it leads over");
    assert!((first.tau_sent[0] - held.tau[0]).abs() < 5.0, "{} after {}", first.tau_sent[0], held.tau[0]);
    let sagged = (0..3).map(|k| (next.last().state.q[k] - held.q[k]).abs()).fold(0.0, f64::max);
    assert!(sagged < 2e-3, "{sagged} m");
}

#[test]
fn arming_that_fails_leaves_the_robots_own_safe_action_as_it_is() {
    let clock = ManualClock::new(0);
    let mut hal = held_alone(&clock);
    let held = hal.read().expect("a state");
    let mut next = takes_over(&mut hal, &clock);
    // The loop stalls before its first efforts, for longer than its session lasts.
    clock.advance(200_000_000);
    next.periods(200);
    assert_eq!(next.machine.phase(), Phase::Fault);
    let moved = (0..3).map(|k| (next.last().state.q[k] - held.q[k]).abs()).fold(0.0, f64::max);
    assert!(moved < 2e-3 && next.last().state.status & status::SAFE != 0, "{moved} m");
}
