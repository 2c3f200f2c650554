//! The whole driver but its network card, ethercrab included, on drives made of numbers: brought up, moved, at fault, torn off the bus.
#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on fails, outside #[test] functions too")]

extern crate alloc;

#[path = "../../../../tests/cia402/drive.rs"]
mod drive;
mod segment;

use core::time::Duration;

use pkm_ethercat::bus::{Bus, FROZEN, LOST, MISSING, NOT_OPERATIONAL};
use pkm_ethercat::master::{EtherCat, MasterError};
use pkm_hal::backends::cia402::{Cia402, DriveScale};
use pkm_hal::conformance::{check_device, check_guarded};
use pkm_hal::frame::status;
use pkm_hal::units::EncoderScale;
use pkm_hal::{
    AxisLimits, Backend, Clock, CommandFrame, HalError, Limiter, MAX_AXES, ManualClock, Mode, SafeAction, SafeKind, StateFrame, Watchdog,
    WatchdogLimits,
};

use segment::{Shared, carry, drives, with};

/// One cycle `[ns]`.
const CYCLE_NS: u64 = 1_000_000;

/// These tests share their machine: a frame is lost only when it is.
const PATIENCE: Duration = Duration::from_millis(500);

type Robot<'c, const N: usize> = Cia402<Bus<EtherCat, &'c ManualClock, N>, N>;

/// Drives as `main.rs` has them, on a segment.
fn robot<'c, const N: usize>(segment: &Shared, clock: &'c ManualClock) -> Robot<'c, N> {
    let master = EtherCat::try_new(carry(segment), N, PATIENCE).expect("drives in operation");
    let scale = DriveScale { encoder: EncoderScale::try_new(1e-6, 0.15).expect("a tick"), rated_effort: 800.0 };
    Cia402::try_new(Bus::new(master, clock), [scale; N]).expect("drives")
}

fn command(n: usize, sequence: u64, mode: Mode, tau: f64) -> CommandFrame {
    let mut command = CommandFrame { nonce: 5, sequence, valid_until_ns: u64::MAX, ..CommandFrame::new(n, mode) };
    command.tau[..n].fill(tau);
    command.sealed()
}

fn cycles(robot: &mut impl Backend, clock: &ManualClock, n: u32) -> Result<StateFrame, HalError> {
    (0..n)
        .map(|_| {
            clock.advance(CYCLE_NS);
            robot.read()
        })
        .last()
        .expect("at least one")
}

fn torques(segment: &Shared) -> Vec<i16> {
    with(segment, |segment| segment.devices.iter().map(|device| device.drive.torque).collect())
}

#[test]
fn drives_are_told_what_to_exchange_and_follow_only_when_efforts_come() {
    let (segment, clock) = (drives(3), ManualClock::new(1));
    let mut robot = robot::<3>(&segment, &clock);
    with(&segment, |segment| {
        for device in &segment.devices {
            assert_eq!(device.state(), 8, "in operation");
            // As a configuration tool would show it: index, subindex, bits.
            let objects = &device.objects;
            let list = |index: u16| (1..=4).filter_map(move |k| objects.get(&(index, k)).map(|entry| format!("{entry:08x}")));
            assert_eq!(list(0x1600).collect::<Vec<_>>(), ["60400010", "60710010", "60600008"]);
            assert_eq!(list(0x1a00).collect::<Vec<_>>(), ["60410010", "60640020", "606c0020", "60770010"]);
            assert_eq!((device.objects[&(0x6060, 0)], device.drive.state), (10, "switch on disabled"));
        }
    });
    let state = cycles(&mut robot, &clock, 3).unwrap();
    // A thousand counts of a micrometre, from 0.15 m.
    assert!((state.q[2] - 0.151).abs() < 1e-12 && state.v[2] == 0.0, "{state:?}");
    assert_eq!((state.status, state.drive_fault), (0, 0));
    robot.write(&command(3, 1, Mode::Effort, 100.0)).unwrap();
    let state = cycles(&mut robot, &clock, 8).unwrap();
    // 100 N of 800 N.
    assert_eq!((state.status, torques(&segment)), (status::POWERED, vec![125; 3]));
    assert!((state.tau[1] - 100.0).abs() < 1e-12 && (state.v[1] - 0.125).abs() < 1e-12, "{state:?}");
    assert_eq!(state.stamp_ns, clock.now_ns(), "stamped by the daemon's clock");
    let early = with(&segment, |segment| segment.devices.iter().map(|device| device.drive.early).max());
    assert_eq!(early, Some(0), "no torque before operation");
    // What is asked for goes out with the next cycle, and comes back with it.
    robot.write(&command(3, 2, Mode::Effort, -40.0)).unwrap();
    let state = cycles(&mut robot, &clock, 1).unwrap();
    assert!((state.tau[0] + 40.0).abs() < 1e-12, "{state:?}");
    robot.write(&command(3, 3, Mode::Off, 0.0)).unwrap();
    let state = cycles(&mut robot, &clock, 2).unwrap();
    assert_eq!((state.status, torques(&segment)), (0, vec![0; 3]));
}

#[test]
fn the_driver_keeps_the_contract_of_hardware() {
    let clock = ManualClock::new(1);
    assert_eq!(check_device(&mut robot::<3>(&drives(3), &clock)), Ok(()));
    let action = SafeAction { effort: [10.0; MAX_AXES], ..SafeAction::new(SafeKind::Damp) };
    let device = Limiter::try_new(robot::<2>(&drives(2), &clock), &[AxisLimits::of_effort(400.0); 2]).unwrap();
    let mut hal = Watchdog::try_new(device, &clock, WatchdogLimits::of_period(CYCLE_NS), action).unwrap();
    let mut pass = |hal: &mut Watchdog<Limiter<Robot<'_, 2>>, &ManualClock>, ns: u64| {
        for _ in 0..=ns / CYCLE_NS {
            clock.advance(CYCLE_NS);
            let _ = hal.read();
        }
    };
    assert_eq!(check_guarded(&mut hal, &&clock, 15 * CYCLE_NS, &mut pass), Ok(()));
}

#[test]
fn a_drive_at_fault_is_told_and_acknowledged_when_somebody_arms() {
    let (segment, clock) = (drives(3), ManualClock::new(1));
    let mut robot = robot::<3>(&segment, &clock);
    robot.write(&command(3, 1, Mode::Effort, 50.0)).unwrap();
    assert_eq!(cycles(&mut robot, &clock, 8).unwrap().status, status::POWERED);
    with(&segment, |segment| segment.devices[1].drive.state = "fault");
    let state = cycles(&mut robot, &clock, 4).unwrap();
    assert_eq!((state.status, state.drive_fault, torques(&segment)[1]), (0, 0b010, 0));
    robot.write(&command(3, 2, Mode::Arm, 0.0)).unwrap();
    let state = cycles(&mut robot, &clock, 8).unwrap();
    assert_eq!((state.status, state.drive_fault), (0, 0));
    robot.write(&command(3, 3, Mode::Effort, 50.0)).unwrap();
    assert_eq!(cycles(&mut robot, &clock, 8).unwrap().status, status::POWERED);
}

#[test]
fn a_cycle_that_is_not_whole_is_no_state() {
    let (segment, clock) = (drives(3), ManualClock::new(1));
    let mut robot = robot::<3>(&segment, &clock);
    robot.write(&command(3, 1, Mode::Effort, 50.0)).unwrap();
    let before = cycles(&mut robot, &clock, 8).unwrap();
    let gone = |code: i32| Err(HalError::Gone { code });
    // A drive without supply.
    with(&segment, |segment| segment.devices[2].is_off = true);
    assert_eq!(cycles(&mut robot, &clock, 1), gone(MISSING));
    with(&segment, |segment| segment.devices[2].is_off = false);
    let after = cycles(&mut robot, &clock, 1).unwrap();
    assert_eq!(after.sequence, before.sequence + 1, "what was no state has no number");
    // One that stepped aside: it answers, and follows no more.
    with(&segment, |segment| segment.devices[0].fall());
    assert_eq!(cycles(&mut robot, &clock, 1), gone(NOT_OPERATIONAL));
}

#[test]
fn a_drive_whose_firmware_stands_still_is_noticed_when_its_position_ought_to_change() {
    let (segment, clock) = (drives(3), ManualClock::new(1));
    let mut robot = robot::<3>(&segment, &clock);
    // At rest the same bytes for ever are the truth.
    assert!(cycles(&mut robot, &clock, 100).is_ok());
    robot.write(&command(3, 1, Mode::Effort, 50.0)).unwrap();
    assert!(cycles(&mut robot, &clock, 8).is_ok());
    with(&segment, |segment| segment.devices[1].is_frozen = true);
    let first = (1..100).find(|_| cycles(&mut robot, &clock, 1).is_err());
    assert_eq!(first, Some(20), "within 20 ms");
    assert_eq!(cycles(&mut robot, &clock, 1), Err(HalError::Gone { code: FROZEN + 1 }));
    with(&segment, |segment| segment.devices[1].is_frozen = false);
    assert!(cycles(&mut robot, &clock, 1).is_ok());
}

#[test]
fn a_bus_that_comes_back_brings_no_old_effort_with_it() {
    let (segment, clock) = (drives(3), ManualClock::new(1));
    let device = Limiter::try_new(robot::<3>(&segment, &clock), &[AxisLimits::of_effort(400.0); 3]).unwrap();
    let mut robot = Watchdog::try_new(device, &clock, WatchdogLimits::of_period(CYCLE_NS), SafeAction::new(SafeKind::Off)).unwrap();
    cycles(&mut robot, &clock, 1).unwrap();
    let mut sequence = 0;
    let mut send = |robot: &mut Watchdog<Limiter<Robot<'_, 3>>, &ManualClock>, mode: Mode, tau: f64| {
        sequence += 1;
        let (stamp_ns, valid_until_ns) = (clock.now_ns(), clock.now_ns() + 10 * CYCLE_NS);
        robot.write(&CommandFrame { stamp_ns, valid_until_ns, ..command(3, sequence, mode, tau) }.sealed())
    };
    send(&mut robot, Mode::Arm, 0.0).unwrap();
    for _ in 0..8 {
        cycles(&mut robot, &clock, 1).unwrap();
        send(&mut robot, Mode::Effort, 100.0).unwrap();
    }
    assert_eq!(torques(&segment), [125; 3]);
    with(&segment, |segment| segment.is_cable_out = true);
    clock.advance(CYCLE_NS);
    let code = robot.inner_mut().inner_mut().read();
    assert_eq!(code, Err(HalError::Gone { code: LOST }));
    // Nobody commands while it is out: what was asked for expires.
    (0..2).for_each(|_| {
        clock.advance(20 * CYCLE_NS);
        let _ = robot.read();
    });
    assert_eq!(robot.counts().trips, 1);
    with(&segment, |segment| segment.is_cable_out = false);
    let _ = cycles(&mut robot, &clock, 1);
    assert_eq!(torques(&segment), [0; 3], "the first frame that arrives");
    // And it can be armed again.
    cycles(&mut robot, &clock, 3).unwrap();
    let anew =
        CommandFrame { nonce: 6, stamp_ns: clock.now_ns(), valid_until_ns: clock.now_ns() + 5 * CYCLE_NS, ..command(3, 1, Mode::Arm, 0.0) };
    assert_eq!(robot.write(&anew.sealed()), Ok(()));
}

#[test]
fn what_is_not_the_robot_is_refused_before_anything_moves() {
    let refusal = |segment: &Shared| EtherCat::try_new(carry(segment), 3, PATIENCE).err().map(|error| error.to_string());
    assert_eq!(refusal(&drives(2)).as_deref(), Some("2 devices on the bus (must be 3)"));
    // A digital output, and a drive that exchanges what it likes.
    let segment = drives(3);
    with(&segment, |segment| segment.devices[1].objects.insert((0x1000, 0), 0x0002_0191));
    assert_eq!(refusal(&segment).as_deref(), Some("device 1 (DRIVE1): profile 401 (must be 402)"));
    let segment = drives(3);
    with(&segment, |segment| segment.devices[2].refuses = Some(0x1a00));
    let told = EtherCat::try_new(carry(&segment), 3, PATIENCE).err();
    assert!(matches!(told, Some(MasterError::Bus(_))), "{told:?}");
    with(&segment, |segment| assert!(segment.devices.iter().all(|device| device.state() < 8)));
}
