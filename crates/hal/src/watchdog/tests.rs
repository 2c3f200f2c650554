use super::*;
use crate::backends::Loopback;
use crate::clock::ManualClock;
use crate::faulty::{Fault, FaultyHal, Injection};
use crate::limiter::{AxisLimits, Limiter};
use crate::safe_action::SafeKind;

const MS: u64 = 1_000_000;

type Dog<'c> = Watchdog<Loopback<&'c ManualClock>, &'c ManualClock>;

fn hold() -> SafeAction {
    let mut action = SafeAction::new(SafeKind::Hold);
    (action.stiffness[0], action.damping[0], action.effort[0]) = (10.0, 1.0, 50.0);
    action
}

fn dog(clock: &ManualClock) -> Dog<'_> {
    Watchdog::try_new(Loopback::new(1, clock), clock, WatchdogLimits::of_period(MS), hold()).unwrap()
}

fn send<B: Backend>(dog: &mut Watchdog<B, &ManualClock>, session: (u64, u64), mode: Mode, tau: f64) -> Result<(), HalError> {
    let now_ns = dog.clock.now_ns();
    let mut command = CommandFrame::new(1, mode);
    (command.nonce, command.sequence, command.stamp_ns, command.valid_until_ns) = (session.0, session.1, now_ns, now_ns + 5 * MS);
    command.tau[0] = tau;
    dog.write(&command.sealed())
}

#[test]
fn a_commander_that_falls_silent_loses_the_robot_and_it_holds() {
    let clock = ManualClock::new(MS);
    let mut dog = dog(&clock);
    dog.inner_mut().place(&[0.5], &[0.0]);
    assert_eq!(send(&mut dog, (7, 1), Mode::Arm, 0.0), Err(HalError::NoState));
    dog.read().unwrap();
    send(&mut dog, (7, 1), Mode::Arm, 0.0).unwrap();
    send(&mut dog, (7, 2), Mode::Effort, 3.0).unwrap();
    clock.advance(5 * MS);
    let state = dog.read().unwrap();
    assert_eq!((state.tau[0], state.status & status::SAFE, dog.is_armed()), (3.0, 0, true));
    // One period after the command expired the robot holds: last effort, and a spring about where it was.
    clock.advance(MS);
    dog.inner_mut().place(&[0.4], &[-0.2]);
    let state = dog.read().unwrap();
    assert_eq!((state.status & status::SAFE, dog.is_armed(), dog.counts().trips), (status::SAFE, false, 1));
    dog.inner_mut().place(&[0.3], &[-0.2]);
    dog.read().unwrap();
    let state = dog.read().unwrap();
    assert!((state.tau[0] - (3.0 + 10.0 * 0.1 + 0.2)).abs() < 1e-12, "{}", state.tau[0]);
    // The old session is spent; a fresh one arms, and the hold goes on until its first efforts.
    assert_eq!(send(&mut dog, (7, 3), Mode::Effort, 1.0), Err(HalError::NotArmed));
    assert_eq!(send(&mut dog, (7, 4), Mode::Arm, 1.0), Err(HalError::ForeignCommander { nonce: 7 }));
    send(&mut dog, (8, 1), Mode::Arm, 0.0).unwrap();
    assert_eq!(dog.read().unwrap().status & status::SAFE, status::SAFE);
    send(&mut dog, (8, 2), Mode::Effort, 1.5).unwrap();
    let state = dog.read().unwrap();
    assert_eq!((state.tau[0], state.status & status::SAFE, state.nonce, state.command_sequence), (1.5, 0, 8, 2));
    assert_eq!((dog.counts().refused, dog.counts().trips), (3, 1));
}

#[test]
fn a_hold_goes_on_with_what_was_sent_not_with_what_was_wished() {
    let clock = ManualClock::new(MS);
    let device = Limiter::try_new(Loopback::new(1, &clock), &[AxisLimits::of_effort(3.0)]).unwrap();
    let mut dog = Watchdog::try_new(device, &clock, WatchdogLimits::of_period(MS), hold()).unwrap();
    dog.read().unwrap();
    send(&mut dog, (7, 1), Mode::Arm, 0.0).unwrap();
    send(&mut dog, (7, 2), Mode::Effort, 40.0).unwrap();
    clock.advance(6 * MS);
    dog.read().unwrap();
    assert_eq!(dog.trip().map(|trip| trip.tau[0]), Some(3.0));
    let mut endless = hold();
    endless.effort[0] = f64::MAX;
    let refused = Watchdog::try_new(Loopback::new(1, &clock), &clock, WatchdogLimits::of_period(MS), endless);
    assert!(matches!(refused, Err(HalError::Config { axis: 0, what: "effort", .. })));
}

#[test]
fn arming_again_does_not_keep_old_efforts_alive() {
    let clock = ManualClock::new(MS);
    let mut dog = dog(&clock);
    dog.read().unwrap();
    send(&mut dog, (7, 1), Mode::Arm, 0.0).unwrap();
    send(&mut dog, (7, 2), Mode::Effort, 3.0).unwrap();
    clock.advance(4 * MS);
    dog.read().unwrap();
    assert_eq!(send(&mut dog, (7, 3), Mode::Arm, 0.0), Err(HalError::AlreadyArmed));
    clock.advance(2 * MS);
    assert_eq!(dog.read().unwrap().status & status::SAFE, status::SAFE);
}

#[test]
fn an_arm_without_efforts_powers_nothing_when_it_expires() {
    let clock = ManualClock::new(MS);
    let mut dog = dog(&clock);
    dog.inner_mut().place(&[0.5], &[0.4]);
    dog.read().unwrap();
    send(&mut dog, (7, 1), Mode::Arm, 0.0).unwrap();
    clock.advance(6 * MS);
    for _ in 0..3 {
        dog.read().unwrap();
        clock.advance(MS);
    }
    let state = dog.read().unwrap();
    assert_eq!((state.status & (status::POWERED | status::SAFE), state.tau[0], dog.is_armed()), (0, 0.0, false));
    assert_eq!((dog.counts().trips, dog.trip()), (1, None));
}

#[test]
fn a_command_after_the_last_one_expired_is_refused_even_before_a_read() {
    let clock = ManualClock::new(MS);
    let mut dog = dog(&clock);
    dog.read().unwrap();
    send(&mut dog, (7, 1), Mode::Arm, 0.0).unwrap();
    clock.advance(5 * MS + 1);
    assert_eq!(send(&mut dog, (7, 2), Mode::Effort, 1.0), Err(HalError::NotArmed));
}

#[test]
fn frozen_state_is_late_after_three_periods_and_trips_after_five() {
    let clock = ManualClock::new(MS);
    let script = [Injection { from: 10, to: 18, fault: Fault::Drop }];
    let device = FaultyHal::new(Loopback::new(1, &clock), &script);
    let mut dog = Watchdog::try_new(device, &clock, WatchdogLimits::of_period(MS), hold()).unwrap();
    let mut outcome = [(0_u64, true); 30];
    for (k, outcome) in outcome.iter_mut().enumerate() {
        let read = dog.read();
        let mode = if k == 0 { Mode::Arm } else { Mode::Effort };
        if read.is_ok() && dog.counts().trips == 0 {
            send(&mut dog, (7, 1 + k as u64), mode, 2.0).unwrap();
        }
        *outcome = (dog.counts().late, read.is_ok());
        clock.advance(MS);
    }
    // Read 9 is the last good one: ages 4 and more are late, 6 and more stale; afterwards the robot is known again but not armed.
    assert_eq!(outcome.map(|o| o.0)[12..16], [0, 1, 2, 3]);
    let blind: [bool; 30] = core::array::from_fn(|k| (15..18).contains(&k));
    assert_eq!(outcome.map(|o| !o.1), blind);
    assert_eq!((dog.is_armed(), dog.counts().trips, dog.counts().repeated), (false, 1, 8));
    assert_eq!(send(&mut dog, (7, 99), Mode::Effort, 2.0), Err(HalError::NotArmed));
}

#[test]
fn lost_reordered_and_broken_states_are_counted_and_bridged() {
    let clock = ManualClock::new(MS);
    let nan = Fault::NotANumber { signal: Signal::Position, axis: 0 };
    let script = [
        Injection { from: 5, to: 6, fault: Fault::Drop },
        Injection { from: 8, to: 9, fault: nan },
        Injection { from: 11, to: 12, fault: Fault::Corrupt { bit: 900 } },
        Injection { from: 14, to: 15, fault: Fault::Older { by: 2 } },
        Injection { from: 17, to: 18, fault: Fault::OtherLayout },
    ];
    let mut dog =
        Watchdog::try_new(FaultyHal::new(Loopback::new(1, &clock), &script), &clock, WatchdogLimits::of_period(MS), hold()).unwrap();
    let mut last = 0;
    for _ in 0..20 {
        let state = dog.read().unwrap();
        assert!(state.check().is_ok() && state.sequence >= last);
        last = state.sequence;
        clock.advance(MS);
    }
    let counts = Counts { lost: 5, rejected: 3, reordered: 1, repeated: 1, ..Counts::default() };
    assert_eq!(*dog.counts(), counts);
}

#[test]
fn a_stamp_of_another_clock_and_a_bad_action_are_refused() {
    let (clock, other) = (ManualClock::new(MS), ManualClock::new(100 * MS));
    let device = Loopback::new(1, &other);
    let mut dog = Watchdog::try_new(device, &clock, WatchdogLimits::of_period(MS), hold()).unwrap();
    assert_eq!(dog.read(), Err(HalError::Ahead { ahead_ns: 99 * MS, limit_ns: MS }));
    let mut action = hold();
    action.damping[2] = f64::NAN;
    assert!(Watchdog::try_new(Loopback::new(1, &clock), &clock, WatchdogLimits::of_period(MS), action).is_err());
}
