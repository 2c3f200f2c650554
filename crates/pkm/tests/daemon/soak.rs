//! A daemon that runs for long beside other work: nothing is lost, nothing grows, time does not drift, and all of it can be done again.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::fs;
use std::path::PathBuf;

use pkm_hal::{Clock, SystemClock};
use serde_json::Value;

use crate::site::{CONFIG, CONTROLLER, PATIENCE_S, Site, is_long, publish, trials, within};

/// Ends the other work when it goes.
struct Over<'a>(&'a AtomicBool);

impl Drop for Over<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Memory of a process that is in use `[KiB]`.
fn resident_kib(pid: u32) -> u64 {
    let text = fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = text.lines().find(|line| line.starts_with("VmRSS:")).expect("Linux says so");
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}

/// Periods of the loop's grid that have passed, and the time `[s]`.
fn beat(status: &Value) -> (f64, f64) {
    let count = |key: &str| status[key].as_f64().unwrap();
    (count("periods") + count("skipped"), SystemClock.now_ns() as f64 * 1e-9)
}

#[test]
fn a_long_run_loses_nothing_grows_by_nothing_and_comes_back_to_the_bit() {
    let site = Site::new();
    let seconds = trials(20, 600);
    fs::write(site.config(), CONFIG.replace("\"iceoryx2\"", "\"simulated\"")).unwrap();
    fs::write(site.dir.path().join("controller.toml"), CONTROLLER.replace("rate_hz = 100.0", "rate_hz = 1000.0")).unwrap();
    // The motion of the site lasts 300 s; this one as long as the run.
    let rows: String = (0..=10 * (seconds + 300))
        .map(|i| {
            let t = 0.1 * i as f64;
            let q = 0.15 + 0.02 * (1.0 - pkm_dyn::math::cos(0.5 * t));
            format!("{t},{q},{q},{q}\n")
        })
        .collect();
    fs::write(site.dir.path().join("motion.csv"), format!("t,q_ref.q1,q_ref.q6,q_ref.q8\n{rows}")).unwrap();
    let is_over = AtomicBool::new(false);
    let mut rows = std::thread::scope(|scope| {
        scope.spawn(|| {
            while !is_over.load(Ordering::Relaxed) {
                core::hint::spin_loop();
            }
        });
        // Also where it fails: the other thread is waited for.
        let _over = Over(&is_over);
        run(&site, seconds)
    });
    let mut files: Vec<PathBuf> = fs::read_dir(site.dir.path().join("runs")).unwrap().map(|f| f.unwrap().path()).collect();
    files.sort();
    rows.push((
        "periods recorded, every one that was not skipped, on one grid of milliseconds",
        on_the_grid(&files, 1_000_000).to_string(),
    ));
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_pkm"));
    let told = command.arg("replay").args(&files).arg("--json").output().unwrap();
    let again: Value = serde_json::from_slice(&told.stdout).unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&told.stderr)));
    assert_eq!((&again["same"], &again["differing"]), (&true.into(), &0.into()), "{again}");
    // Some periods come before it is armed, and a machine that has other work skips some.
    assert!(again["steps"].as_u64().unwrap() > 11_000, "{again}");
    rows.push(("commands done again, differing from those recorded", format!("{}, {}", again["steps"], again["differing"])));
    if is_long() {
        let says = "The loop at 1 kHz with the simulated 3-PRS, recording every period, beside a busy thread; ordinary scheduling.";
        publish("daemon_soak", says, &rows);
    }
}

/// How many periods were recorded: each planned as many whole periods `[ns]` after the one before as it says that were skipped, and one.
pub(crate) fn on_the_grid(files: &[PathBuf], period_ns: u64) -> u64 {
    // Number, planned time, skipped periods: words behind the head of a message (docs/FORMATS.md, section 2).
    let words = |data: &[u8]| [20, 28, 68].map(|at| u64::from_le_bytes(data[at..at + 8].try_into().unwrap()));
    let (mut count, mut before) = (0, None);
    for file in files {
        let bytes = fs::read(file).unwrap();
        for message in mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap).filter(|m| m.channel.topic == "/pkm/cycle") {
            let [cycle, planned_ns, skipped] = words(&message.data);
            if let Some((last, last_ns)) = before {
                let step = 1 + skipped;
                assert_eq!((cycle, planned_ns), (last + step, last_ns + period_ns * step), "after period {last} of {last_ns} ns");
            }
            (count, before) = (count + 1, Some((cycle, planned_ns)));
        }
    }
    count
}

/// What the daemon says of itself at the end.
fn run(site: &Site, seconds: u64) -> Vec<(&'static str, String)> {
    let mut daemon = site.start_with("daemon", &["--start", "--record", "runs"], &[]);
    let pid = daemon.child.id();
    let begun = site.until(&["running-position"]);
    let (first, from_s) = beat(&begun);
    // The rings hold eight thousand periods, the black box two: then every page of them has been used.
    let has_gone_round = || site.status().filter(|status| status["periods"].as_u64().unwrap() > 11_000);
    within(2 * PATIENCE_S, has_gone_round).unwrap_or_else(|| panic!("{}", daemon.told()));
    let before_kib = resident_kib(pid);
    std::thread::sleep(Duration::from_secs(seconds - 12));
    let status = site.status().unwrap_or_else(|| panic!("{}", daemon.told()));
    assert_eq!(status["phase"], "running-position", "{}", daemon.told());
    let (last, to_s) = beat(&status);
    let after_kib = resident_kib(pid);
    assert!(after_kib < before_kib + 8 * 1024, "{before_kib} KiB, then {after_kib} KiB");
    // The grid is the clock's: what passes between two answers is no more than the machine took to give them, however long the run.
    let drift_s = 1e-3 * (last - first) - (to_s - from_s);
    assert!(drift_s.abs() < 0.4, "{drift_s} s in {} s", to_s - from_s);
    assert_eq!(status["records_lost"], 0, "{status}");
    site.order("quit");
    assert_eq!(daemon.end(PATIENCE_S), 0, "{}", daemon.told());
    assert!(daemon.told().contains(" files, 0 lost"), "{}", daemon.told());
    let of = |key: &str| status[key].to_string();
    vec![
        ("length", format!("{:.1} s", to_s - from_s)),
        ("periods run, skipped, ended late", format!("{}, {}, {}", of("periods"), of("skipped"), of("overruns"))),
        ("records lost", of("records_lost")),
        ("loop's time less the clock's, first to last answer", format!("{:+.1} ms", 1e3 * drift_s)),
        ("resident memory after 11 s, at the end", format!("{before_kib} KiB, {after_kib} KiB")),
    ]
}
