//! Signals, terminals that are closed, rights and resources that are not given: what a daemon does about each.

use std::fs;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use rustix::process::Signal;

use crate::site::{CONFIG, PATIENCE_S, Site, end_of};

/// A simulated robot: one process; and these changes of its file.
fn site(changes: &[(&str, &str)]) -> Site {
    let site = Site::new();
    let text = changes.iter().fold(CONFIG.replace("\"iceoryx2\"", "\"simulated\""), |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    });
    fs::write(site.config(), text).unwrap();
    site
}

#[test]
fn a_second_signal_is_the_safe_action_and_a_closed_terminal_is_no_signal() {
    // So slow a stop that nobody sends the second signal too late.
    let site = site(&[("stop_s = 0.2", "stop_s = 10.0")]);
    let mut daemon = site.start("daemon");
    site.play();
    daemon.signal(Signal::HUP);
    std::thread::sleep(core::time::Duration::from_millis(300));
    assert_eq!(site.phase(), "running-position", "{}", daemon.told());
    daemon.signal(Signal::INT);
    std::thread::sleep(core::time::Duration::from_millis(300));
    assert_eq!(site.phase(), "running-position", "it slows down: {}", daemon.told());
    daemon.signal(Signal::INT);
    assert_eq!(daemon.end(PATIENCE_S), 0);
    assert!(daemon.told().contains(": running-position -> safe-stop, order"), "{}", daemon.told());
}

#[test]
fn one_signal_stops_along_the_path() {
    let site = site(&[]);
    let mut daemon = site.start("daemon");
    site.play();
    daemon.signal(Signal::INT);
    assert_eq!(daemon.end(PATIENCE_S), 0);
    let told = daemon.told();
    assert!(told.contains(": running-position -> holding, order") && !told.contains("safe-stop"), "{told}");
}

#[test]
fn a_reader_of_its_words_that_goes_away_is_no_reason_to_let_go_of_the_robot() {
    let site = site(&[]);
    let mut command = Command::new(env!("CARGO_BIN_EXE_pkm"));
    command.arg("daemon").arg(site.config()).current_dir(site.dir.path()).stdin(Stdio::null()).stdout(Stdio::piped());
    let mut daemon = command.stderr(Stdio::null()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(daemon.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert!(line.starts_with("daemon of process "), "{line}");
    // Every change of phase is a line that nobody reads.
    site.play();
    site.order("stop");
    site.until(&["holding"]);
    site.order("quit");
    assert_eq!(end_of(&mut daemon), Some(0));
}

#[test]
fn rights_that_are_required_and_not_given_end_it_and_preferred_ones_are_told() {
    // No machine that runs this has so many cores.
    let far = ("[loop]\n", "[loop]\ncpu = 1023\n");
    let site = site(&[("realtime = \"off\"", "realtime = \"require\""), far]);
    let mut daemon = site.start("daemon");
    assert_eq!(daemon.end(PATIENCE_S), 71, "{}", daemon.told());
    let told = daemon.told();
    assert!(told.lines().count() == 1 && told.starts_with("error: real time is required: core 1023: "), "{told}");
    fs::write(site.config(), fs::read_to_string(site.config()).unwrap().replace("\"require\"", "\"prefer\"")).unwrap();
    let mut daemon = site.start("daemon");
    let status = site.until(&["ready"]);
    let missing: Vec<&str> = status["realtime"]["missing"].as_array().unwrap().iter().map(|m| m.as_str().unwrap()).collect();
    assert!(missing.iter().any(|line| line.starts_with("core 1023: ")), "{missing:?}");
    for line in missing {
        assert!(daemon.told().contains(&format!("warning: not real time: {line}")), "{line}: {}", daemon.told());
    }
    daemon.signal(Signal::TERM);
    assert_eq!(daemon.end(PATIENCE_S), 0);
}

#[test]
fn without_files_to_open_it_says_so_at_the_start_and_leaves_nothing_that_keeps_the_next_out() {
    let site = Site::new();
    for (verb, most) in [("daemon", 8), ("driver-sim", 8), ("daemon", 12), ("driver-sim", 12)] {
        let mut command = Command::new("sh");
        let line = format!("ulimit -n {most} && exec \"$0\" \"$@\"");
        command.args(["-c", &line, env!("CARGO_BIN_EXE_pkm"), verb]).arg(site.config()).args(["--seconds", "0.5"]).stdin(Stdio::null());
        let out = command.output().unwrap();
        let told = String::from_utf8_lossy(&out.stderr).into_owned();
        // Where so many were enough after all, it ran and ended.
        if out.status.code() == Some(0) {
            continue;
        }
        assert!([Some(74), Some(75)].contains(&out.status.code()), "{verb} with {most}: {:?} {told}", out.status);
        assert_eq!((told.lines().count(), told.starts_with("error: ")), (1, true), "{verb} with {most}: {told}");
    }
    let (_driver, _daemon) = (site.start("driver-sim"), site.start("daemon"));
    site.until(&["ready"]);
}
