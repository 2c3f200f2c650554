//! Both sides of shared memory as processes of their own, in any order and killed at any moment of their start: the first command is heard.
//!
//! The processes are this very program, which runs the test [`side`] alone when it is told which side it is.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails, outside #[test] functions too")]
#![cfg(target_os = "linux")]

use core::time::Duration;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use pkm_hal::backends::Loopback;
use pkm_hal::backends::iceoryx2::{Place, Role, SharedDriver, SharedRobot};
use pkm_hal::{
    AxisLimits, Backend, Clock, CommandFrame, Limiter, MAX_AXES, Mode, SafeAction, SafeKind, SystemClock, Watchdog, WatchdogLimits,
};

/// Longest wait for anything that must come `[ns]`: a wait ends when it comes.
const PATIENCE_NS: u64 = 60_000_000_000;

/// Which side this process is, where it is one: `driver`, or `daemon` with the nonce that it arms with.
const SIDE: &str = "PKM_TEST_SIDE";
const PLACE: &str = "PKM_TEST_PLACE";
const NONCE: &str = "PKM_TEST_NONCE";

fn millisecond() {
    std::thread::sleep(Duration::from_millis(1));
}

/// The life of a side, until it is killed.
#[test]
fn side() {
    let Ok(side) = std::env::var(SIDE) else { return };
    let place = Place::try_new(&PathBuf::from(std::env::var_os(PLACE).unwrap())).unwrap();
    if side == "driver" {
        let action = SafeAction { effort: [1.0; MAX_AXES], ..SafeAction::new(SafeKind::Damp) };
        let device = Limiter::try_new(Loopback::new(2, SystemClock), &[AxisLimits::of_effort(10.0); 2]).unwrap();
        let mut robot = Watchdog::try_new(device, SystemClock, WatchdogLimits::of_period(1_000_000_000), action).unwrap();
        let mut driver = SharedDriver::try_new(&place, place.lock(Role::Driver).unwrap()).unwrap();
        loop {
            let _ = driver.serve(&mut robot);
            millisecond();
        }
    }
    let nonce: u64 = std::env::var(NONCE).unwrap().parse().unwrap();
    let mut robot = SharedRobot::try_new(&place, place.lock(Role::Daemon).unwrap(), 2, 0).unwrap();
    let fresh = |robot: &mut SharedRobot| robot.read().is_ok_and(|state| SystemClock.now_ns() - state.stamp_ns < 1_000_000_000);
    while !fresh(&mut robot) {
        robot.reconnect();
        millisecond();
    }
    // Once, at the first moment at which the robot is there.
    let valid_until_ns = SystemClock.now_ns() + 15_000_000_000;
    robot.write(&CommandFrame { nonce, sequence: 1, valid_until_ns, ..CommandFrame::new(2, Mode::Arm) }.sealed()).unwrap();
    while !robot.read().is_ok_and(|state| state.nonce == nonce) {
        millisecond();
    }
    std::fs::write(heard(place.dir(), nonce), "").unwrap();
    loop {
        millisecond();
    }
}

/// The file by which a daemon's side says that its robot has heard it.
fn heard(place: &Path, nonce: u64) -> PathBuf {
    place.join(format!("heard.{nonce}"))
}

struct Side(Child);

impl Side {
    fn start(place: &Path, side: &str, nonce: u64) -> Self {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "side", "--nocapture"]).env(SIDE, side).env(PLACE, place).env(NONCE, nonce.to_string());
        Self(command.stdin(Stdio::null()).stdout(Stdio::null()).spawn().unwrap())
    }
}

impl Drop for Side {
    fn drop(&mut self) {
        // SIGKILL: it cleans nothing up. It may have ended by a failure, which its silence has told.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Xorshift (Marsaglia): the same in every run.
struct Dice(u64);

impl Dice {
    fn below(&mut self, end: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % end
    }

    fn pause(&mut self, most_us: u64) {
        std::thread::sleep(Duration::from_micros(self.below(most_us)));
    }
}

const SIDES: [&str; 2] = ["driver", "daemon"];

/// Waits until the daemon's side with this nonce is heard.
fn is_heard(place: &Path, nonce: u64) -> bool {
    let begin_ns = SystemClock.now_ns();
    while !heard(place, nonce).exists() {
        if SystemClock.now_ns() - begin_ns > PATIENCE_NS {
            return false;
        }
        millisecond();
    }
    true
}

fn trials(some: u64, many: u64) -> u64 {
    if std::env::var_os("PKM_LONG").is_some() { many } else { some }
}

#[test]
fn the_first_command_is_heard_in_either_order_of_starts() {
    let mut dice = Dice(0x2545_F491_4F6C_DD1D);
    for trial in 0..trials(50, 400) {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("meet");
        let first = usize::from(trial % 2 == 1);
        let _first = Side::start(&place, SIDES[first], 1 + trial);
        dice.pause(150_000);
        let _second = Side::start(&place, SIDES[1 - first], 1 + trial);
        assert!(is_heard(&place, 1 + trial), "trial {trial}, the {} first", SIDES[first]);
    }
}

#[test]
fn sides_killed_twice_while_they_start_lock_nobody_out() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("meet");
    let mut dice = Dice(0x9E37_79B9_7F4A_7C15);
    for trial in 0..trials(20, 1000) {
        for _ in 0..2 {
            let k = usize::from(dice.below(2) == 1);
            let first = Side::start(&place, SIDES[k], 0);
            dice.pause(15_000);
            let second = Side::start(&place, SIDES[1 - k], 0);
            dice.pause(15_000);
            drop(first);
            dice.pause(5_000);
            drop(second);
        }
        let k = usize::from(dice.below(2) == 1);
        let _first = Side::start(&place, SIDES[k], 1 + trial);
        dice.pause(15_000);
        let _second = Side::start(&place, SIDES[1 - k], 1 + trial);
        assert!(is_heard(&place, 1 + trial), "trial {trial}");
    }
}
