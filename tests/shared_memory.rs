//! A robot in another process, over shared memory: the contract of hardware across it, either side coming back, locks, strangers, leftovers.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails, outside #[test] functions too")]
#![cfg(target_os = "linux")]

extern crate alloc;

use alloc::sync::Arc;
use core::sync::atomic::{AtomicBool, Ordering};
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::thread::JoinHandle;

use pkm_hal::backends::Loopback;
use pkm_hal::backends::iceoryx2::{Mended, Place, Role, SharedDriver, SharedError, SharedRobot, ping_pong};
use pkm_hal::conformance::{check_device, check_guarded};
use pkm_hal::frame::status;
use pkm_hal::{
    AxisLimits, Backend, Clock, CommandFrame, HalError, Limiter, MAX_AXES, Mode, SafeAction, SafeKind, StateFrame, SystemClock, Watchdog,
    WatchdogLimits,
};

const PERIOD_NS: u64 = 1_000_000;

/// A driver on a thread of its own, as its process would be.
struct Driver {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl Driver {
    fn start<B: Backend>(place: &Place, hal: impl FnOnce() -> B + Send + 'static) -> Self {
        Self::slow(place, core::time::Duration::from_micros(50), hal)
    }

    /// One that rests between two turns.
    fn slow<B: Backend>(place: &Place, rest: core::time::Duration, hal: impl FnOnce() -> B + Send + 'static) -> Self {
        let (place, stop) = (place.clone(), Arc::new(AtomicBool::new(false)));
        let told = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            let mut driver = driver(&place).unwrap();
            let mut hal = hal();
            while !told.load(Ordering::Relaxed) {
                let _ = driver.serve(&mut hal);
                std::thread::sleep(rest);
            }
        });
        Self { stop, thread }
    }

    fn end(self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap();
    }
}

fn driver(place: &Place) -> Result<SharedDriver, SharedError> {
    SharedDriver::try_new(place, place.lock(Role::Driver)?)
}

fn robot(place: &Place, n_axes: usize) -> Result<SharedRobot, SharedError> {
    SharedRobot::try_new(place, place.lock(Role::Daemon)?, n_axes, 0)
}

fn place() -> (tempfile::TempDir, Place) {
    let dir = tempfile::tempdir().unwrap();
    let place = Place::try_new(&dir.path().join("meet")).unwrap();
    (dir, place)
}

/// The first state that satisfies `is_it`, looked for as a loop does while nothing moves.
fn wait(robot: &mut SharedRobot, is_it: impl Fn(&StateFrame) -> bool) -> StateFrame {
    let begin = SystemClock.now_ns();
    loop {
        if let Some(state) = robot.read().ok().filter(|state| is_it(state)) {
            return state;
        }
        assert!(SystemClock.now_ns() - begin < 20_000_000_000, "no such state within 20 s: {robot:?} {:?}", robot.read());
        robot.reconnect();
        std::thread::sleep(core::time::Duration::from_millis(1));
    }
}

fn effort(n: usize, sequence: u64) -> CommandFrame {
    CommandFrame { nonce: 5, sequence, valid_until_ns: u64::MAX, ..CommandFrame::new(n, Mode::Effort) }.sealed()
}

/// Reads no faster than the other side can live: the checks count reads.
struct Patient(SharedRobot);

impl Backend for Patient {
    fn n_axes(&self) -> usize {
        self.0.n_axes()
    }

    fn n_sensors(&self) -> usize {
        self.0.n_sensors()
    }

    fn read(&mut self) -> Result<StateFrame, HalError> {
        std::thread::sleep(core::time::Duration::from_micros(20));
        self.0.read()
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        self.0.write(command)
    }
}

#[test]
fn a_device_in_another_process_keeps_the_contract() {
    for n in [1, 7, 16] {
        let (_dir, place) = place();
        let driver = Driver::start(&place, move || Loopback::new(n, SystemClock));
        let mut robot = robot(&place, n).unwrap();
        wait(&mut robot, |_| true);
        let mut robot = Patient(robot);
        assert_eq!(check_device(&mut robot), Ok(()), "{n} axes");
        assert_eq!(robot.0.received().rejected, 0);
        drop(robot);
        driver.end();
    }
}

/// Off after a trip, so that only commands move it.
fn guard<B: Backend>(device: B, n: usize) -> Watchdog<Limiter<B>, SystemClock> {
    // Long periods: threads of a busy machine wait for each other.
    let limits = WatchdogLimits::of_period(100 * PERIOD_NS);
    let action = SafeAction { effort: [1.0; MAX_AXES], ..SafeAction::new(SafeKind::Damp) };
    let device = Limiter::try_new(device, &vec![AxisLimits::of_effort(10.0); n]).unwrap();
    Watchdog::try_new(device, SystemClock, limits, action).unwrap()
}

#[test]
fn a_hal_over_a_device_in_another_process_keeps_strangers_out() {
    let (_dir, place) = place();
    let driver = Driver::start(&place, || Loopback::new(3, SystemClock));
    let mut robot = robot(&place, 3).unwrap();
    wait(&mut robot, |_| true);
    let mut hal = guard(robot, 3);
    let mut pass = |hal: &mut Watchdog<Limiter<SharedRobot>, SystemClock>, ns: u64| {
        let end = SystemClock.now_ns() + ns;
        while SystemClock.now_ns() < end {
            let _ = hal.read();
        }
    };
    assert_eq!(check_guarded(&mut hal, &SystemClock, 500 * PERIOD_NS, &mut pass), Ok(()));
    drop(hal);
    driver.end();
}

#[test]
fn a_driver_takes_the_robot_from_a_commander_that_falls_silent_and_ignores_strangers() {
    let (_dir, place) = place();
    let driver = Driver::start(&place, || guard(Loopback::new(2, SystemClock), 2));
    let mut robot = robot(&place, 2).unwrap();
    wait(&mut robot, |_| true);
    let command = |nonce, sequence, mode, for_ms: u64| {
        let valid_until_ns = SystemClock.now_ns() + for_ms * PERIOD_NS;
        CommandFrame { nonce, sequence, valid_until_ns, ..CommandFrame::new(2, mode) }.sealed()
    };
    robot.write(&command(9, 1, Mode::Arm, 1500)).unwrap();
    wait(&mut robot, |state| state.nonce == 9);
    let mut push = command(9, 2, Mode::Effort, 400);
    push.tau[0] = 3.0;
    robot.write(&push.sealed()).unwrap();
    let moved = wait(&mut robot, |state| state.command_sequence == 2);
    assert!((moved.tau[0] - 3.0).abs() < 1e-12 && moved.status & status::SAFE == 0);
    // Another nonce, an old sequence, an endless validity: none of them is taken.
    for foreign in [command(10, 3, Mode::Effort, 400), command(9, 2, Mode::Effort, 400), command(9, 4, Mode::Effort, 1_000_000)] {
        robot.write(&foreign).unwrap();
    }
    let safe = wait(&mut robot, |state| state.status & status::SAFE != 0);
    assert_eq!((safe.nonce, safe.command_sequence), (9, 2));
    // Silence has ended the session: the same commander needs a new one.
    robot.write(&command(9, 5, Mode::Effort, 400)).unwrap();
    robot.write(&command(11, 1, Mode::Arm, 1500)).unwrap();
    wait(&mut robot, |state| state.nonce == 11);
    driver.end();
}

/// A driver that was there first finds its commander only after some turns. What it sends until then is no state to arm on: nobody would hear it.
#[test]
fn a_robot_is_there_when_its_driver_listens_and_hears_the_first_command() {
    let (_dir, place) = place();
    let mut device = Loopback::new(2, SystemClock);
    let mut driver_side = driver(&place).unwrap();
    driver_side.serve(&mut device).unwrap();
    let mut robot_side = robot(&place, 2).unwrap();
    robot_side.reconnect();
    driver_side.publish(&device.read().unwrap());
    assert_eq!(robot_side.read(), Err(HalError::Gone { code: 1 }), "states alone are no robot");
    let mut turns = 0;
    while robot_side.read().is_err() {
        turns += 1;
        assert!(turns < 200, "{driver_side:?}");
        driver_side.serve(&mut device).unwrap();
    }
    // One command, once: it is taken in the next turn.
    robot_side.write(&effort(2, 77)).unwrap();
    driver_side.serve(&mut device).unwrap();
    assert_eq!((driver_side.served().taken, robot_side.read().unwrap().command_sequence), (1, 77));
    // A driver that goes leaves nobody to command.
    drop(driver_side);
    assert_eq!(robot_side.read(), Err(HalError::Gone { code: 1 }));
}

/// The same with threads, in either order and at any time: whoever sees a state is heard.
#[test]
fn the_first_command_is_heard_whoever_came_first() {
    for trial in 0..20_u64 {
        let (_dir, place) = place();
        let pause = || std::thread::sleep(core::time::Duration::from_micros(trial * 137 % 4000));
        // It looks for its commander every tenth of a second, and sends states all the while.
        let start = || Driver::slow(&place, core::time::Duration::from_millis(2), || Loopback::new(2, SystemClock));
        let (driver, mut robot_side) = if trial % 2 == 0 {
            let driver = start();
            pause();
            (driver, robot(&place, 2).unwrap())
        } else {
            let robot_side = robot(&place, 2).unwrap();
            pause();
            (start(), robot_side)
        };
        wait(&mut robot_side, |_| true);
        robot_side.write(&effort(2, 1 + trial)).unwrap();
        let begin = SystemClock.now_ns();
        while robot_side.read().unwrap().command_sequence != 1 + trial {
            assert!(SystemClock.now_ns() - begin < 20_000_000_000, "trial {trial}: the first command was lost");
            std::thread::sleep(core::time::Duration::from_micros(200));
        }
        driver.end();
    }
}

#[test]
fn a_probe_goes_there_and_back_and_leaves_the_place_free() {
    let (_dir, place) = place();
    let mut times = Vec::new();
    ping_pong(&place, 2_000_000_000, &SystemClock, &mut |ns| times.push(ns)).unwrap();
    // Two caches that are not one: a sample takes some hundred nanoseconds each way, and no less than the fifth of that.
    assert!(times.len() > 4 && times.iter().all(|ns| *ns > 40), "{} times", times.len());
    assert!(times.iter().sum::<u64>() < 10_000_000_000);
    let held = place.lock(Role::Driver).unwrap();
    let told = ping_pong(&place, 1, &SystemClock, &mut |_| {}).unwrap_err();
    assert!(matches!(told, SharedError::Busy { role: Role::Driver, .. }), "{told}");
    drop(held);
    driver(&place).unwrap();
}

#[test]
fn either_side_may_end_and_come_back_without_the_other() {
    let (_dir, place) = place();
    let mut robot_side = robot(&place, 2).unwrap();
    assert_eq!(robot_side.read(), Err(HalError::NoState));
    for turn in 1..=3 {
        let driver = Driver::start(&place, || Loopback::new(2, SystemClock));
        // A new driver counts from one again.
        let after = SystemClock.now_ns();
        wait(&mut robot_side, |state| state.stamp_ns > after);
        robot_side.write(&effort(2, turn)).unwrap();
        let begin = SystemClock.now_ns();
        while robot_side.read().unwrap().command_sequence != turn {
            // Commands that a driver could not have seen are lost, as on any wire.
            robot_side.write(&effort(2, turn)).unwrap();
            assert!(SystemClock.now_ns() - begin < 20_000_000_000, "turn {turn}");
            std::thread::sleep(core::time::Duration::from_millis(1));
        }
        driver.end();
    }
    let driver = Driver::start(&place, || Loopback::new(2, SystemClock));
    for turn in 10..=12 {
        drop(robot_side);
        robot_side = robot(&place, 2).unwrap();
        let begin = SystemClock.now_ns();
        while robot_side.read().ok().is_none_or(|state| state.command_sequence != turn) {
            robot_side.write(&effort(2, turn)).unwrap();
            robot_side.reconnect();
            assert!(SystemClock.now_ns() - begin < 20_000_000_000, "turn {turn}");
            std::thread::sleep(core::time::Duration::from_millis(1));
        }
    }
    driver.end();
}

#[test]
fn a_second_one_is_told_at_once_who_runs_and_the_first_does_not_notice() {
    let (_dir, place) = place();
    let driver_side = driver(&place).unwrap();
    let robot_side = robot(&place, 1).unwrap();
    let begin = SystemClock.now_ns();
    let told = [driver(&place).map(|_| ()), robot(&place, 1).map(|_| ())];
    assert!(SystemClock.now_ns() - begin < 1_000_000_000);
    for (told, wanted) in told.into_iter().zip([Role::Driver, Role::Daemon]) {
        assert!(matches!(&told, Err(SharedError::Busy { role, pid, .. }) if *role == wanted && *pid == std::process::id()), "{told:?}");
    }
    drop((driver_side, robot_side));
    driver(&place).unwrap();
}

#[test]
fn a_place_that_others_can_look_into_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let open = dir.path().join("open");
    fs::create_dir(&open).unwrap();
    fs::set_permissions(&open, fs::Permissions::from_mode(0o755)).unwrap();
    let told = Place::try_new(&open).unwrap_err().to_string();
    assert!(told.contains("has mode 0755") && told.lines().count() == 1, "{told}");
    fs::set_permissions(&open, fs::Permissions::from_mode(0o700)).unwrap();
    Place::try_new(&open).unwrap();
    let link = dir.path().join("link");
    std::os::unix::fs::symlink(&open, &link).unwrap();
    assert!(matches!(Place::try_new(&link), Err(SharedError::NotPrivate { .. })));
    let file = dir.path().join("file");
    fs::write(&file, "").unwrap();
    assert!(matches!(Place::try_new(&file), Err(SharedError::NotPrivate { .. })));
    let made = dir.path().join("made");
    Place::try_new(&made).unwrap();
    assert_eq!(fs::metadata(&made).unwrap().permissions().mode() & 0o777, 0o700);
}

#[test]
fn garbage_and_another_layout_are_refused_and_said() {
    let (_dir, place) = place();
    // In this order a driver hears at once, without a turn.
    let mut robot_side = robot(&place, 1).unwrap();
    let mut driver_side = driver(&place).unwrap();
    robot_side.reconnect();
    let good = StateFrame { sequence: 1, stamp_ns: 1, valid_q: 1, ..StateFrame::new(1, 0) }.sealed();
    driver_side.publish(&good);
    assert_eq!(wait(&mut robot_side, |_| true), good);
    driver_side.publish(&StateFrame { sequence: 2, q: [7.0; MAX_AXES], ..good });
    assert_eq!((robot_side.read(), robot_side.received().rejected), (Ok(good), 1));
    driver_side.publish(&StateFrame { n_axes: 2, sequence: 3, ..good }.sealed());
    assert_eq!(robot_side.read(), Err(HalError::Axes { found: 2, expected: 1 }));
    driver_side.publish(&StateFrame { layout: 42, sequence: 4, ..good }.sealed());
    let other = HalError::Layout { found: 42, expected: StateFrame::LAYOUT };
    assert_eq!(robot_side.read(), Err(other));
    assert!(other.to_string().contains("0x000000000000002a") && other.to_string().contains(&format!("{:#018x}", StateFrame::LAYOUT)));
    // A driver of another build says so before it sends anything.
    fs::write(place.dir().join("driver.service"), "1 00000000000000ff\n").unwrap();
    robot_side.reconnect();
    assert!(matches!(robot_side.read(), Err(HalError::Layout { found: 0xFF, .. })));
}

fn files_in_shared_memory(place: &Place, ending: &str) -> Vec<std::path::PathBuf> {
    let all = fs::read_dir("/dev/shm").unwrap().flatten().map(|entry| entry.path());
    let is_ours = |path: &std::path::PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        name.starts_with(&place.prefix()) && name.ends_with(ending)
    };
    all.filter(is_ours).collect()
}

fn below(dir: &Path) -> Vec<std::path::PathBuf> {
    let (mut out, mut open) = (Vec::new(), vec![dir.to_path_buf()]);
    while let Some(at) = open.pop() {
        for entry in fs::read_dir(&at).into_iter().flatten().flatten() {
            if entry.path().is_dir() { open.push(entry.path()) } else { out.push(entry.path()) }
        }
    }
    out
}

/// What a process leaves that was killed while it made its service: the static file is there, what it speaks of is not.
fn half_made(place: &Place) {
    let driver_side = driver(place).unwrap();
    let statics: Vec<_> = below(&place.root()).into_iter().filter(|p| p.extension().is_some_and(|e| e == "service")).collect();
    let kept: Vec<_> =
        statics.iter().map(|path| (path.clone(), fs::read(path).unwrap(), fs::metadata(path).unwrap().permissions())).collect();
    assert!(!kept.is_empty(), "the library keeps static files: {:?}", below(&place.root()));
    drop(driver_side);
    for (path, bytes, permissions) in kept {
        fs::write(&path, bytes).unwrap();
        fs::set_permissions(&path, permissions).unwrap();
    }
    assert!(files_in_shared_memory(place, ".dynamic").is_empty());
}

#[test]
fn a_service_left_half_made_is_mended_and_the_other_side_finds_it() {
    // Alone: removed by force.
    let (_dir, place) = place();
    half_made(&place);
    let driver_side = driver(&place).unwrap();
    assert!(matches!(driver_side.mended(), Mended::Removed | Mended::Swept), "{:?}", driver_side.mended());
    drop(driver_side);
    // Beside a living commander nothing is removed: the service gets another number, and is found there.
    half_made(&place);
    let mut robot_side = robot(&place, 1).unwrap();
    let begin = SystemClock.now_ns();
    let mut driver_side = driver(&place).unwrap();
    assert!(SystemClock.now_ns() - begin < 3_000_000_000, "a start takes no longer than 3 s");
    assert_eq!(driver_side.mended(), Mended::Renumbered);
    let state = StateFrame { sequence: 1, stamp_ns: 1, valid_q: 1, ..StateFrame::new(1, 0) }.sealed();
    robot_side.reconnect();
    driver_side.publish(&state);
    assert_eq!(wait(&mut robot_side, |_| true), state);
}

#[test]
fn garbage_in_the_places_files_is_no_reason_to_fail() {
    let (_dir, place) = place();
    drop((driver(&place).unwrap(), robot(&place, 1).unwrap()));
    fs::write(place.dir().join("driver.service"), [0xFF; 5000]).unwrap();
    fs::write(place.dir().join("daemon.service"), "").unwrap();
    for path in below(&place.root()).into_iter().chain(files_in_shared_memory(&place, "")) {
        fs::write(&path, b"truncated").unwrap();
    }
    let mut robot_side = robot(&place, 1).unwrap();
    let mut driver_side = driver(&place).unwrap();
    robot_side.reconnect();
    driver_side.publish(&StateFrame { sequence: 1, stamp_ns: 1, valid_q: 1, ..StateFrame::new(1, 0) }.sealed());
    wait(&mut robot_side, |_| true);
}
