//! Places that are full: shared memory at the start and while the robot moves, a file that may grow no larger while it is written.

use std::fs;
use std::process::{Command, Stdio};

use crate::site::{CONFIG, PATIENCE_S, Side, Site, within};

/// Program and flags with which a process gets a shared memory of its own; none where the system lets nobody have one, which is said.
#[expect(clippy::print_stderr, reason = "a test that cannot be done must not pass for one that was")]
fn own_mounts() -> Option<Vec<&'static str>> {
    let tries = [vec!["unshare", "-m"], vec!["unshare", "-r", "-m"]];
    let found = tries.into_iter().find(|words| {
        let mut command = Command::new(words[0]);
        command.args(&words[1..]).args(["sh", "-c", "mount -t tmpfs -o size=4k tmpfs /dev/shm"]).stderr(Stdio::null());
        command.status().is_ok_and(|status| status.success())
    });
    if found.is_none() {
        eprintln!("not run: nobody may mount a small file system here (`unshare -r -m`)");
    }
    found
}

/// A shell with a shared memory of `size`, for this line; `$0` is the program, `$1` and so on what follows.
fn with_shared_memory(mounts: &[&str], size: &str, line: &str, site: &Site) -> Command {
    let mut command = Command::new(mounts[0]);
    let line = format!("mount -t tmpfs -o size={size} tmpfs /dev/shm || exit 99; {line}");
    command.args(&mounts[1..]).args(["sh", "-c", &line, env!("CARGO_BIN_EXE_pkm")]);
    command.current_dir(site.dir.path()).stdin(Stdio::null());
    command
}

#[test]
fn shared_memory_that_is_full_at_the_start_is_told_in_one_line() {
    let Some(mounts) = own_mounts() else { return };
    let site = Site::new();
    for verb in ["driver-sim", "daemon"] {
        let mut command = with_shared_memory(&mounts, "4k", "exec \"$0\" \"$@\"", &site);
        let out = command.arg(verb).arg(site.config()).args(["--seconds", "0.5"]).output().unwrap();
        let told = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(74), "{verb}: {:?} {told}", out.status);
        let is_one_line = told.lines().count() == 1 && told.starts_with("error: /dev/shm: 4096 bytes are free (524288 are needed): ");
        assert!(is_one_line, "{verb}: {told}");
    }
    // Nothing is left that keeps the next ones out.
    let (_driver, _daemon) = (site.start("driver-sim"), site.start("daemon"));
    site.until(&["ready"]);
}

/// Both sides meet, then somebody fills what is left. A reader who is away has more states wait for it than ever before: pages that nobody has
/// touched yet. The robot is armed and moves all the same. Exit codes say how far it came.
const FILLED: &str = r#"
until_phase() {
    i=0
    until "$0" status --config "$1" --json 2>/dev/null | grep -q "\"phase\":\"$2\""; do
        i=$((i + 1)); [ $i -gt 600 ] && exit 98; sleep 0.1
    done
}
trap 'kill $driver $daemon 2>/dev/null' EXIT
"$0" driver-sim "$1" & driver=$!
"$0" daemon "$1" & daemon=$!
until_phase "$1" ready
cat /dev/zero > /dev/shm/fill
kill -STOP $daemon; sleep 0.5; kill -CONT $daemon
"$0" order arm --config "$1" || exit 97
until_phase "$1" holding
"$0" order start --config "$1" || exit 96
until_phase "$1" running-position
sleep 1
kill -TERM $daemon; wait $daemon || exit 95
kill -TERM $driver; wait $driver || exit 94
"#;

#[test]
fn shared_memory_that_fills_up_later_takes_no_page_from_those_who_run() {
    let Some(mounts) = own_mounts() else { return };
    let site = Site::new();
    let out = with_shared_memory(&mounts, "1m", FILLED, &site).arg(site.config()).output().unwrap();
    let told = String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(0), "{:?} {told}", out.status);
    assert!(told.contains("No space left on device"), "somebody has filled it: {told}");
}

#[test]
fn a_file_that_may_grow_no_larger_pauses_the_recording_and_not_the_robot() {
    let site = Site::new();
    fs::write(site.config(), CONFIG.replace("\"iceoryx2\"", "\"simulated\"")).unwrap();
    let log = site.dir.path().join("daemon.log");
    let out = fs::File::create(&log).unwrap();
    let mut command = Command::new("sh");
    // In blocks of half a kilobyte, or of one: some seconds of a loop.
    command.args(["-c", "ulimit -f 300 && exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_pkm"), "daemon"]).arg(site.config());
    command.args(["--record", "runs"]).current_dir(site.dir.path()).stdin(Stdio::null());
    let child = command.stdout(out.try_clone().unwrap()).stderr(out).spawn().unwrap();
    let mut daemon = Side { child, log };
    site.play();
    let is_told = |words: &[&str]| daemon.told().lines().any(|line| words.iter().all(|word| line.contains(word)));
    let is_paused = || is_told(&["recording paused: ", " lost; ", "too large"]).then_some(());
    within(PATIENCE_S, is_paused).unwrap_or_else(|| panic!("{}", daemon.told()));
    // It is tried again, in another file, which grows as large.
    let goes_on = || is_told(&["recording: ", " in 2 files, "]).then_some(());
    within(PATIENCE_S, goes_on).unwrap_or_else(|| panic!("{}", daemon.told()));
    let status = site.status().expect("it answers");
    assert_eq!(status["phase"], "running-position", "{status}");
    assert!(status["recording"]["files"].as_u64() >= Some(2), "{status}");
    site.order("quit");
    assert_eq!(daemon.end(PATIENCE_S), 0, "{}", daemon.told());
    assert!(daemon.told().lines().any(|line| line.starts_with("recorded ") && line.contains(" lost")), "{}", daemon.told());
}
