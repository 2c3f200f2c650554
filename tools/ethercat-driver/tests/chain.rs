//! The whole driver on a wire made of bytes: a daemon's side in another thread arms it, pushes, falls silent.

use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};

use ethercat_driver::{INPUT, INPUT_OBJECTS, Image, OUTPUT, OUTPUT_OBJECTS, Wire, pack, unpack};
use pkm_hal::backends::cia402::{Cia402, DriveOutputs, DriveScale};
use pkm_hal::backends::iceoryx2::{Place, Role, SharedDriver, SharedRobot};
use pkm_hal::frame::status;
use pkm_hal::units::{EncoderScale, EncoderTicks};
use pkm_hal::{AxisLimits, Backend, Clock, CommandFrame, HalError, Limiter, MAX_AXES, Mode, SafeAction, SafeKind, SystemClock, Watchdog, WatchdogLimits};

const N: usize = 2;

/// Drives that take one step of CiA 402's state machine a cycle, in bytes.
struct Bytes<'a> {
    status: [u16; N],
    seen: &'a AtomicI32,
}

impl Wire for Bytes<'_> {
    fn cycle(&mut self, outputs: &[u8], inputs: &mut [u8]) -> Result<(), HalError> {
        for k in 0..N {
            let out = &outputs[k * OUTPUT..(k + 1) * OUTPUT];
            let (control, torque, mode) = (u16::from_le_bytes([out[0], out[1]]), i16::from_le_bytes([out[2], out[3]]), out[4]);
            self.status[k] = match (self.status[k], control & 0x0f) {
                (_, 0) => 0x40,
                (0x40, 0x06) => 0x21,
                (0x21, 0x07) => 0x23,
                (0x23 | 0x27, 0x0f) => 0x27,
                (same, _) => same,
            };
            assert!(self.status[k] != 0x27 || mode == 10, "torque mode");
            let torque = if self.status[k] == 0x27 { torque } else { 0 };
            if k == 1 {
                self.seen.store(i32::from(torque), Ordering::Relaxed);
            }
            let into = &mut inputs[k * INPUT..(k + 1) * INPUT];
            into[..2].copy_from_slice(&self.status[k].to_le_bytes());
            into[2..6].copy_from_slice(&(1000 * (k as i32 + 1)).to_le_bytes());
            into[6..10].fill(0);
            into[10..].copy_from_slice(&torque.to_le_bytes());
        }
        Ok(())
    }
}

#[test]
fn the_mapping_has_as_many_bits_as_the_image() {
    let bytes = |objects: &[u32]| objects.iter().map(|object| (object & 0xff) as usize / 8).sum::<usize>();
    assert_eq!((bytes(&OUTPUT_OBJECTS), bytes(&INPUT_OBJECTS)), (OUTPUT, INPUT));
    let output = DriveOutputs { control: 0x1234, mode: -1, torque: -2 };
    assert_eq!(pack(&output), [0x34, 0x12, 0xfe, 0xff, 0xff]);
    let input = unpack(&[0x27, 0x02, 4, 3, 2, 1, 0xff, 0xff, 0xff, 0xff, 0x00, 0x80]);
    assert_eq!((input.status, input.position, input.velocity, input.torque), (0x0227, EncoderTicks(0x0102_0304), -1, i16::MIN));
}

#[test]
fn a_daemon_arms_pushes_and_is_missed() {
    let folder = tempfile::tempdir().unwrap();
    let place = Place::try_new(&folder.path().join("meet")).unwrap();
    let (is_over, seen) = (AtomicBool::new(false), AtomicI32::new(0));
    let encoder = EncoderScale::try_new(1e-6, 0.0).unwrap();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let wire = Bytes { status: [0; N], seen: &seen };
            let device = Cia402::try_new(Image::<_, _, N>::new(wire, SystemClock), [DriveScale { encoder, rated_effort: 500.0 }; N]).unwrap();
            let action = SafeAction { effort: [100.0; MAX_AXES], ..SafeAction::new(SafeKind::Damp) };
            let limited = Limiter::try_new(device, &[AxisLimits::of_effort(400.0); N]).unwrap();
            let mut robot = Watchdog::try_new(limited, SystemClock, WatchdogLimits::of_period(50_000_000), action).unwrap();
            let mut driver = SharedDriver::try_new(&place, place.lock(Role::Driver).unwrap()).unwrap();
            while !is_over.load(Ordering::Relaxed) {
                let _ = driver.serve(&mut robot);
                std::thread::sleep(std::time::Duration::from_micros(500));
            }
        });
        let mut robot = SharedRobot::try_new(&place, place.lock(Role::Daemon).unwrap(), N, 0).unwrap();
        let begin_ns = SystemClock.now_ns();
        let mut wait = |robot: &mut SharedRobot, is_it: &dyn Fn(&pkm_hal::StateFrame) -> bool| loop {
            if let Some(state) = robot.read().ok().filter(|state| is_it(state)) {
                return state;
            }
            assert!(SystemClock.now_ns() - begin_ns < 30_000_000_000, "not within 30 s: {:?}", robot.read());
            robot.reconnect();
            std::thread::sleep(std::time::Duration::from_millis(1));
        };
        let first = wait(&mut robot, &|_| true);
        assert!((first.q[0] - 1e-3).abs() < 1e-12 && (first.q[1] - 2e-3).abs() < 1e-12);
        let command = |sequence, mode, tau| {
            let valid_until_ns = SystemClock.now_ns() + 500_000_000;
            let mut command = CommandFrame { nonce: 9, sequence, valid_until_ns, ..CommandFrame::new(N, mode) };
            command.tau[..N].fill(tau);
            command.sealed()
        };
        robot.write(&command(1, Mode::Arm, 0.0)).unwrap();
        wait(&mut robot, &|state| state.nonce == 9);
        robot.write(&command(2, Mode::Effort, 250.0)).unwrap();
        // 250 N of 500 N, once the drives are in operation.
        let pushed = wait(&mut robot, &|state| state.tau[1] > 0.0);
        assert_eq!((pushed.tau[1], pushed.status & status::POWERED), (250.0, status::POWERED));
        assert_eq!(seen.load(Ordering::Relaxed), 500);
        // Nobody commands any more: the driver's own safe action, which damps a drive that stands.
        wait(&mut robot, &|state| state.status & status::SAFE != 0);
        wait(&mut robot, &|state| state.tau[1] == 0.0);
        is_over.store(true, Ordering::Relaxed);
    });
}
