//! `pkm status --watch` as a process: a block a look, plain in a pipe, until the daemon ends, Ctrl-C, or nobody reads any more.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixListener;
use std::process::{Child, Command, Stdio};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use crate::site::{CONFIG, PATIENCE_S, Site, end_of, within};

/// A simulated robot: one process.
fn site() -> Site {
    let site = Site::new();
    fs::write(site.config(), CONFIG.replace("\"iceoryx2\"", "\"simulated\"")).unwrap();
    site
}

/// Somebody who watches, and what they see.
struct Watcher<'s> {
    child: Child,
    site: &'s Site,
    name: &'static str,
}

impl<'s> Watcher<'s> {
    fn start(site: &'s Site, name: &'static str, more: &[&str]) -> Self {
        let out = fs::File::create(site.dir.path().join(name)).unwrap();
        let child = Self::command(site, more).stdout(out).spawn().unwrap();
        Self { child, site, name }
    }

    fn command(site: &Site, more: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pkm"));
        command.args(["status", "--watch", "--config"]).arg(site.config()).args(more).stdin(Stdio::null()).stderr(Stdio::null());
        command
    }

    fn seen(&self) -> String {
        fs::read_to_string(self.site.dir.path().join(self.name)).unwrap()
    }

    /// Waits until it has looked so often.
    fn looks(&self, mark: &str, times: usize) {
        within(PATIENCE_S, || (self.seen().matches(mark).count() >= times).then_some(())).unwrap_or_else(|| panic!("{}", self.seen()));
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Its exit code; -1 where a signal ended it.
    fn end(&mut self) -> i32 {
        let code = within(PATIENCE_S, || self.child.try_wait().unwrap());
        code.unwrap_or_else(|| panic!("it does not end: {}", self.seen())).code().unwrap_or(-1)
    }
}

impl Drop for Watcher<'_> {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The blocks of a text, each as every look prints it.
fn blocks(text: &str) -> Vec<&str> {
    let blocks: Vec<&str> = text.trim_end().split("\n\n").collect();
    for block in &blocks {
        let lines: Vec<&str> = block.lines().collect();
        assert!(lines[0].starts_with("prs3: ") && lines[0].contains(", process "), "{block}");
        assert!(lines[1].starts_with("law computed_torque, 100 Hz, "), "{block}");
        for word in ["wake-up", "compute", "end to end", "q ", "q_ref ", "tau "] {
            assert_eq!(lines.iter().filter(|line| line.trim_start().starts_with(word)).count(), 1, "{word} in {block}");
        }
    }
    blocks
}

#[test]
fn it_looks_again_and_again_until_it_is_told_to_stop_or_the_daemon_has() {
    let site = site();
    let mut daemon = site.start("daemon");
    site.until(&["ready"]);
    for signal in [Signal::INT, Signal::TERM] {
        let mut words = Watcher::start(&site, "words", &[]);
        words.looks(", process ", 3);
        words.signal(signal);
        assert_eq!(words.end(), 0, "{signal:?}");
        let seen = words.seen();
        assert!(!seen.contains('\u{1b}') && seen.ends_with('\n'), "{seen:?}");
        assert!(blocks(&seen).len() >= 3);
    }
    let mut json = Watcher::start(&site, "lines", &["--json"]);
    json.looks("\n", 3);
    json.signal(Signal::INT);
    assert_eq!(json.end(), 0);
    let lines: Vec<Value> = json.seen().lines().map(|line| serde_json::from_str(line).expect("an object a line")).collect();
    let periods: Vec<u64> = lines.iter().map(|line| line["periods"].as_u64().unwrap()).collect();
    assert!(lines.len() >= 3 && lines.iter().all(|line| line["phase"] == "ready"), "{lines:?}");
    assert!(periods.is_sorted() && periods[0] < periods[periods.len() - 1], "{periods:?}");
    // The daemon ends, told to or not.
    let mut words = Watcher::start(&site, "until", &[]);
    words.looks(", process ", 1);
    daemon.signal(Signal::TERM);
    assert_eq!((daemon.end(PATIENCE_S), words.end()), (0, 0));
    blocks(&words.seen());
    let daemon = site.start("daemon");
    site.until(&["ready"]);
    let mut words = Watcher::start(&site, "killed", &[]);
    words.looks(", process ", 1);
    daemon.kill();
    assert_eq!(words.end(), 0, "{}", words.seen());
    // Where there is none from the start, that is what is told.
    let mut nothing = Watcher::start(&site, "nothing", &[]);
    assert_eq!((nothing.end(), nothing.seen().as_str()), (74, ""));
}

#[test]
fn it_ends_when_nobody_reads_any_more() {
    let site = site();
    let _daemon = site.start("daemon");
    site.until(&["ready"]);
    let mut child = Watcher::command(&site, &["--json"]).stdout(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert!(line.contains("\"phase\":\"ready\""), "{line}");
    assert_eq!(end_of(&mut child), Some(0));
}

#[test]
fn a_daemon_that_takes_the_question_and_says_nothing_has_not_ended() {
    let site = site();
    let mut daemon = site.start("daemon");
    let answer = site.until(&["ready"]).to_string();
    daemon.signal(Signal::TERM);
    assert_eq!(daemon.end(PATIENCE_S), 0);
    // Somebody who says it once, and then nothing.
    let door = UnixListener::bind(site.dir.path().join("meet/control.sock")).unwrap();
    let told = std::thread::spawn(move || {
        let (mut first, _) = door.accept().unwrap();
        // Read: what is left unread when it closes would be an error at the other end.
        BufReader::new(&first).read_line(&mut String::new()).unwrap();
        writeln!(first, "{answer}").unwrap();
        drop(first);
        let (second, _) = door.accept().unwrap();
        (door, second)
    });
    let mut words = Watcher::start(&site, "silent", &[]);
    assert_eq!(words.end(), 74, "{}", words.seen());
    assert_eq!(blocks(&words.seen()).len(), 1);
    drop(told.join().unwrap());
}
