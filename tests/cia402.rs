//! Drives of the profile `CiA 402` behind a fieldbus, beside drives made here by the tables of IEC 61800-7-201: how they are brought to operation,
//! what numbers mean, faults, a bus that falls silent, and the contract of hardware.

#[path = "cia402/drive.rs"]
mod drive;

use drive::Drive;
use pkm_hal::backends::cia402::{Cia402, DriveInputs, DriveOutputs, DriveScale, DriveState, Fieldbus};
use pkm_hal::conformance::{check_device, check_guarded};
use pkm_hal::frame::status;
use pkm_hal::units::{EncoderScale, EncoderTicks};
use pkm_hal::{
    AxisLimits, Backend, Clock, CommandFrame, HalError, Limiter, MAX_AXES, ManualClock, Mode, SafeAction, SafeKind, Watchdog,
    WatchdogLimits,
};

struct Bus<'c, const N: usize> {
    clock: &'c ManualClock,
    drives: [Drive; N],
    controls: Vec<u16>,
    is_silent: bool,
}

impl<const N: usize> Fieldbus for Bus<'_, N> {
    fn exchange(&mut self, outputs: &[DriveOutputs], inputs: &mut [DriveInputs]) -> Result<u64, HalError> {
        if self.is_silent {
            return Err(HalError::Gone { code: 7 });
        }
        for ((drive, output), input) in self.drives.iter_mut().zip(outputs).zip(inputs) {
            drive.cycle(output);
            let position = EncoderTicks(drive.position);
            *input = DriveInputs { status: drive.status(), position, velocity: i32::from(drive.torque), torque: drive.torque };
        }
        self.controls.push(outputs[0].control);
        Ok(self.clock.now_ns())
    }
}

fn robot<const N: usize>(clock: &ManualClock) -> Cia402<Bus<'_, N>, N> {
    let bus = Bus { clock, drives: [Drive::NEW; N], controls: Vec::new(), is_silent: false };
    // A drive that runs against its axis: both the counter and the torque.
    let scale = |k: usize| DriveScale {
        encoder: EncoderScale::try_new(if k == 1 { -1e-6 } else { 1e-6 }, 0.15).expect("a tick"),
        rated_effort: if k == 1 { -800.0 } else { 800.0 },
    };
    Cia402::try_new(bus, core::array::from_fn(scale)).expect("drives")
}

fn command(n: usize, sequence: u64, mode: Mode, tau: f64) -> CommandFrame {
    let mut command = CommandFrame { nonce: 5, sequence, valid_until_ns: u64::MAX, ..CommandFrame::new(n, mode) };
    command.tau[..n].fill(tau);
    command.sealed()
}

#[test]
fn statuswords_are_told_apart_as_the_standard_has_them() {
    // x: any value. Of the standard's table, bits 15 to 0.
    for (pattern, state) in [
        ("xxxxxxxxx0xx0000", DriveState::NotReady),
        ("xxxxxxxxx1xx0000", DriveState::SwitchOnDisabled),
        ("xxxxxxxxx01x0001", DriveState::ReadyToSwitchOn),
        ("xxxxxxxxx01x0011", DriveState::SwitchedOn),
        ("xxxxxxxxx01x0111", DriveState::OperationEnabled),
        ("xxxxxxxxx00x0111", DriveState::QuickStopActive),
        ("xxxxxxxxx0xx1111", DriveState::FaultReaction),
        ("xxxxxxxxx0xx1000", DriveState::Fault),
    ] {
        let matches = |word: u16| {
            pattern.bytes().enumerate().all(|(i, c)| match c {
                b'x' => true,
                bit => (word >> (15 - i) & 1 == 1) == (bit == b'1'),
            })
        };
        let words: Vec<u16> = (0..=u16::MAX).filter(|word| matches(*word)).collect();
        assert!(words.len() >= 1 << 10);
        assert!(words.iter().all(|word| DriveState::of(*word) == state), "{pattern}");
    }
}

#[test]
fn efforts_bring_drives_to_operation_step_by_step_and_off_takes_their_voltage() {
    let clock = ManualClock::new(1);
    let mut robot = robot::<3>(&clock);
    let pass = |robot: &mut Cia402<_, 3>, cycles: u32| {
        (0..cycles).for_each(|_| {
            clock.advance(1_000_000);
            let _ = Backend::read(robot);
        });
        Backend::read(robot).expect("a state")
    };
    assert_eq!(pass(&mut robot, 3).status, 0, "nothing by itself");
    robot.write(&command(3, 1, Mode::Effort, 100.3)).unwrap();
    // 100.3 N of 800 N are 125.4 per mille: the nearest whole number acts, and is told.
    assert_eq!(robot.sent().unwrap()[..3], [100.0, 100.0, 100.0]);
    robot.bus_mut().controls.clear();
    let state = pass(&mut robot, 8);
    let mut steps = robot.bus_mut().controls.clone();
    steps.dedup();
    assert_eq!(steps, [0x06, 0x07, 0x0f], "the first of them with the next cycle");
    assert_eq!((state.status, &state.tau[..3]), (status::POWERED, &[100.0; 3][..]));
    assert!(robot.bus_mut().drives.iter().all(|drive| drive.early == 0), "torque before operation");
    assert_eq!(robot.bus_mut().drives.map(|drive| drive.torque), [125, -125, 125]);
    // 125 ticks per second of a micrometre, and the counter that runs backwards.
    assert!((state.v[0] - 125e-6).abs() < 1e-15 && (state.v[1] - 125e-6).abs() < 1e-15, "{:?}", state.v);
    assert!(state.q[0] > 0.15 && (state.q[0] - state.q[1]).abs() < 1e-12);
    robot.write(&command(3, 2, Mode::Off, 0.0)).unwrap();
    let state = pass(&mut robot, 3);
    assert_eq!((state.status, state.tau[0], state.command_sequence), (0, 0.0, 2));
    // More than the number can say stops at its end.
    robot.write(&command(3, 3, Mode::Effort, 1e9)).unwrap();
    assert!((robot.sent().unwrap()[0] - 0.8 * 32767.0).abs() < 1e-9);
}

#[test]
fn a_fault_is_told_and_acknowledged_when_somebody_arms() {
    let clock = ManualClock::new(1);
    let mut robot = robot::<3>(&clock);
    let pass = |robot: &mut Cia402<Bus<'_, 3>, 3>| (0..8).map(|_| robot.read().expect("a state")).last().expect("eight");
    robot.write(&command(3, 1, Mode::Effort, 50.0)).unwrap();
    assert_eq!(pass(&mut robot).status, status::POWERED);
    robot.bus_mut().drives[1].state = "fault";
    let state = pass(&mut robot);
    assert_eq!((state.status, state.drive_fault, state.tau[1]), (0, 0b010, 0.0));
    // Commanding on does not reset it.
    robot.write(&command(3, 2, Mode::Effort, 50.0)).unwrap();
    assert_eq!(pass(&mut robot).drive_fault, 0b010);
    robot.write(&command(3, 3, Mode::Arm, 0.0)).unwrap();
    let state = pass(&mut robot);
    assert_eq!((state.status, state.drive_fault), (0, 0));
    robot.write(&command(3, 4, Mode::Effort, 50.0)).unwrap();
    assert_eq!(pass(&mut robot).status, status::POWERED);
    robot.bus_mut().is_silent = true;
    assert_eq!(robot.read(), Err(HalError::Gone { code: 7 }));
}

#[test]
fn drives_on_a_bus_keep_the_contract_and_keep_strangers_out() {
    let clock = ManualClock::new(1);
    assert_eq!(check_device(&mut robot::<1>(&clock)), Ok(()));
    assert_eq!(check_device(&mut robot::<7>(&clock)), Ok(()));
    let limits = WatchdogLimits::of_period(1_000_000);
    let action = SafeAction { effort: [10.0; MAX_AXES], ..SafeAction::new(SafeKind::Damp) };
    let device = Limiter::try_new(robot::<3>(&clock), &[AxisLimits::of_effort(400.0); 3]).unwrap();
    let mut hal = Watchdog::try_new(device, &clock, limits, action).unwrap();
    let mut pass = |hal: &mut Watchdog<Limiter<Cia402<Bus<'_, 3>, 3>>, &ManualClock>, ns: u64| {
        for _ in 0..=ns / 1_000_000 {
            clock.advance(1_000_000);
            let _ = hal.read();
        }
    };
    assert_eq!(check_guarded(&mut hal, &&clock, 15_000_000, &mut pass), Ok(()));
    // What cannot be scaled is refused.
    let bus = || Bus { clock: &clock, drives: [Drive::NEW; 1], controls: Vec::new(), is_silent: false };
    let encoder = EncoderScale::try_new(1e-6, 0.0).unwrap();
    for rated_effort in [0.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(Cia402::try_new(bus(), [DriveScale { encoder, rated_effort }]), Err(HalError::Config { axis: 0, .. })));
    }
}
