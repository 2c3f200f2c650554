//! Who may command a robot over shared memory: the user whose directory it is. A process of another user finds every file shut, the library's own
//! way in as well; where these tests may not change their user, what the kernel would judge by is looked at.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails, outside #[test] functions too")]
#![cfg(target_os = "linux")]

use std::fs::{self, OpenOptions};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use iceoryx2::prelude::{Config, FileName, NodeBuilder, Path as NodePath, SemanticString, ipc};
use pkm_daemon::control::{Door, SOCKET};
use pkm_hal::backends::Loopback;
use pkm_hal::backends::iceoryx2::{Place, Role, SharedDriver, SharedError, SharedRobot};
use pkm_hal::{Backend, Clock, CommandFrame, Mode, SystemClock};

/// Makes this program the stranger: the directory of the robot, and what files in shared memory begin with.
const PLACE: &str = "PKM_TEST_PLACE";
const PREFIX: &str = "PKM_TEST_PREFIX";

/// User and group that own nothing.
const NOBODY: u32 = 65_534;

fn uid() -> u32 {
    fs::metadata("/proc/self").unwrap().uid()
}

/// A robot whose both sides are connected.
struct Pair {
    driver: SharedDriver,
    robot: SharedRobot,
    hal: Loopback<SystemClock>,
    place: Place,
    _door: Door,
    _dir: tempfile::TempDir,
}

impl Pair {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        // Only the place itself keeps strangers out.
        fs::set_permissions(dir.path(), fs::Permissions::from_mode(0o755)).unwrap();
        let place = Place::try_new(&dir.path().join("meet")).unwrap();
        let door = Door::open(place.dir()).unwrap();
        let mut driver = SharedDriver::try_new(&place, place.lock(Role::Driver).unwrap()).unwrap();
        let mut robot = SharedRobot::try_new(&place, place.lock(Role::Daemon).unwrap(), 2, 0).unwrap();
        let mut hal = Loopback::new(2, SystemClock);
        let begin_ns = SystemClock.now_ns();
        while robot.read().is_err() {
            robot.reconnect();
            let _ = driver.serve(&mut hal);
            assert!(SystemClock.now_ns() - begin_ns < 60_000_000_000, "both sides do not meet");
        }
        Self { driver, robot, hal, place, _door: door, _dir: dir }
    }

    /// Whether a command of the robot's own loop still arrives.
    fn is_heard(&mut self, sequence: u64) -> bool {
        let command = CommandFrame { nonce: 5, sequence, valid_until_ns: u64::MAX, ..CommandFrame::new(2, Mode::Effort) }.sealed();
        self.robot.write(&command).unwrap();
        let begin_ns = SystemClock.now_ns();
        while SystemClock.now_ns() - begin_ns < 60_000_000_000 {
            let _ = self.driver.serve(&mut self.hal);
            if self.robot.read().is_ok_and(|state| state.command_sequence == sequence) {
                return true;
            }
        }
        false
    }
}

/// The ways in that `place` has for this process, by name.
fn ways_in(dir: &Path, prefix: &str) -> Vec<String> {
    let mut open = Vec::new();
    let segments = fs::read_dir("/dev/shm").unwrap().flatten().map(|entry| entry.path());
    for path in segments.filter(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(prefix))) {
        for (way, options) in [("read", OpenOptions::new().read(true)), ("written", OpenOptions::new().write(true))] {
            if options.open(&path).is_ok() {
                open.push(format!("{} can be {way}", path.display()));
            }
        }
    }
    let door = UnixStream::connect(dir.join(SOCKET));
    let ways = [
        ("the directory is listed", fs::read_dir(dir).is_ok()),
        ("the place is taken for one's own", Place::try_new(dir).is_ok()),
        ("the door opens", door.is_ok()),
        ("the library lets one in", node(dir, prefix)),
    ];
    open.extend(ways.iter().filter(|(_, is_open)| *is_open).map(|(way, _)| (*way).to_string()));
    open
}

/// Whether the library makes a node among those of the place, from which commands could be published.
fn node(dir: &Path, prefix: &str) -> bool {
    iceoryx2::prelude::set_log_level(iceoryx2::prelude::LogLevel::Fatal);
    let mut config = Config::default();
    config.global.prefix = FileName::new(prefix.as_bytes()).unwrap();
    config.global.set_root_path(&NodePath::new(dir.join("iox2").display().to_string().as_bytes()).unwrap());
    NodeBuilder::new().config(&config).create::<ipc::Service>().is_ok()
}

/// Tells the ways in that it finds, where it is told to be the stranger.
#[test]
fn stranger() {
    let Some(dir) = std::env::var_os(PLACE) else { return };
    let ways = ways_in(&PathBuf::from(dir), &std::env::var(PREFIX).unwrap());
    assert!(ways.is_empty(), "uid {}: {}", uid(), ways.join("; "));
}

/// This program as another process, of another user where one is named: whether it found no way in, and what it said.
fn sent(place: &Place, user: Option<u32>) -> (bool, String) {
    let dir = tempfile::tempdir().unwrap();
    fs::set_permissions(dir.path(), fs::Permissions::from_mode(0o755)).unwrap();
    // Where others can run it: the folder of build products may be private.
    let program = dir.path().join("stranger");
    fs::copy(std::env::current_exe().unwrap(), &program).unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    let mut command = Command::new(program);
    command.args(["--exact", "stranger", "--nocapture"]).env(PLACE, place.dir()).env(PREFIX, place.prefix()).current_dir("/");
    if let Some(user) = user {
        command.uid(user).gid(user);
    }
    let output = command.output().unwrap();
    let told = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(told.contains("running 1 test"), "{told}");
    (output.status.success(), told)
}

#[test]
fn a_process_of_another_user_finds_no_way_in_and_disturbs_nobody() {
    let mut pair = Pair::new();
    assert!(pair.is_heard(1));
    // The probe probes: for a process of the same user everything is open.
    let (is_shut, told) = sent(&pair.place, None);
    assert!(!is_shut, "{told}");
    for way in ["can be read", "can be written", "the directory is listed", "the door opens", "the library lets one in"] {
        assert!(told.contains(way), "{way}: {told}");
    }
    if uid() == 0 {
        let (is_shut, told) = sent(&pair.place, Some(NOBODY));
        assert!(is_shut, "{told}");
    }
    assert!(pair.is_heard(2));
}

#[test]
fn every_file_of_both_sides_is_its_users_alone() {
    let mut pair = Pair::new();
    assert!(pair.is_heard(1));
    let segments = pair.place.in_shared_memory();
    // Both services' management, samples and connections.
    assert!(segments.len() >= 6, "{segments:?}");
    for path in &segments {
        let about = fs::metadata(path).unwrap();
        assert_eq!((about.uid(), about.mode() & 0o077), (uid(), 0), "{}: mode {:04o}", path.display(), about.mode() & 0o7777);
    }
    let about = fs::metadata(pair.place.dir()).unwrap();
    assert_eq!((about.uid(), about.mode() & 0o777), (uid(), 0o700));
}

#[test]
fn a_file_that_a_stranger_has_put_there_first_is_told_and_not_used() {
    if uid() != 0 {
        // Only root can make a file of somebody else; the rule is the one of the directory's owner, which is looked at everywhere.
        let about = fs::metadata("/").unwrap();
        assert_eq!(about.uid(), 0);
        assert!(matches!(Place::try_new(Path::new("/")), Err(SharedError::NotPrivate { .. })));
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let place = Place::try_new(&dir.path().join("meet")).unwrap();
    let squatted = PathBuf::from(format!("/dev/shm/{}squatted.global_mgmt", place.prefix()));
    fs::write(&squatted, [0; 16]).unwrap();
    std::os::unix::fs::chown(&squatted, Some(NOBODY), Some(NOBODY)).unwrap();
    // With a side there nothing may be swept away.
    let held = place.lock(Role::Driver).unwrap();
    let told = SharedRobot::try_new(&place, place.lock(Role::Daemon).unwrap(), 2, 0).map(|_| ()).unwrap_err();
    assert!(matches!(&told, SharedError::Foreign { found: NOBODY, uid: 0, .. }), "{told}");
    assert_eq!(told.to_string().lines().count(), 1);
    // Alone, root removes it; any other user is told whose it is.
    drop(held);
    SharedRobot::try_new(&place, place.lock(Role::Daemon).unwrap(), 2, 0).unwrap();
    assert!(!squatted.exists());
}
