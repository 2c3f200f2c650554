//! Sides that start: in any order, over what killed ones have left, a second time, with a wrong configuration.

use core::time::Duration;
use std::fs;
use std::process::Command;

use pkm_hal::{Clock, SystemClock};

use crate::site::{CONFIG, PATIENCE_S, Site, is_long, publish, trials};

/// Random pauses and choices, the same in every run: xorshift (Marsaglia), whose period is longer than any test.
struct Dice(u64);

impl Dice {
    fn below(&mut self, end: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % end
    }

    fn pause(&mut self, most_ms: u64) {
        std::thread::sleep(Duration::from_micros(self.below(1000 * most_ms)));
    }
}

const SIDES: [&str; 2] = ["driver-sim", "daemon"];

/// Arms at the first moment at which that may be ordered.
fn is_armed_at_once(site: &Site) {
    site.until(&["ready"]);
    site.order("arm");
    let armed = site.until(&["homing", "holding", "safe-stop", "fault"]);
    let phase = armed["phase"].as_str().unwrap_or_default();
    assert!(["homing", "holding"].contains(&phase), "{armed}\n{}", site.logs());
}

#[test]
fn arming_is_heard_whichever_side_was_there_first() {
    let mut dice = Dice(0x2545_F491_4F6C_DD1D);
    let mut took_s = Vec::new();
    for trial in 0..trials(6, 100) {
        let site = Site::new();
        // In turn: the driver first, the daemon first; every third time both at once.
        let first = site.start(SIDES[usize::from(trial % 2 == 1)]);
        if trial % 3 != 2 {
            dice.pause(1000);
        }
        let second = site.start(SIDES[usize::from(trial % 2 == 0)]);
        let begin_ns = SystemClock.now_ns();
        is_armed_at_once(&site);
        took_s.push((SystemClock.now_ns() - begin_ns) as f64 * 1e-9);
        first.kill();
        second.kill();
    }
    if is_long() {
        publish(
            "daemon_starts",
            "Driver and daemon started in any order, armed at the first moment at which that may be ordered.",
            &spread(took_s),
        );
    }
}

/// How long it took from the second start to an armed robot.
fn spread(mut took_s: Vec<f64>) -> [(&'static str, String); 3] {
    took_s.sort_by(f64::total_cmp);
    let (median, longest) = (took_s[took_s.len() / 2], took_s[took_s.len() - 1]);
    [
        ("starts that ended in an armed robot", format!("{} of {}", took_s.len(), took_s.len())),
        ("from the second start to armed, median", format!("{median:.2} s")),
        ("from the second start to armed, longest", format!("{longest:.2} s")),
    ]
}

#[test]
fn both_sides_killed_while_they_start_leave_nothing_that_keeps_the_next_from_moving_the_robot() {
    let site = Site::new();
    let mut dice = Dice(0x9E37_79B9_7F4A_7C15);
    let mut took_s = Vec::new();
    for _ in 0..trials(20, 200) {
        for _ in 0..2 {
            let k = usize::from(dice.below(2) == 1);
            let first = site.start(SIDES[k]);
            dice.pause(60);
            let second = site.start(SIDES[1 - k]);
            dice.pause(60);
            first.kill();
            dice.pause(20);
            second.kill();
        }
        let k = usize::from(dice.below(2) == 1);
        let first = site.start(SIDES[k]);
        dice.pause(60);
        let second = site.start(SIDES[1 - k]);
        let begin_ns = SystemClock.now_ns();
        is_armed_at_once(&site);
        took_s.push((SystemClock.now_ns() - begin_ns) as f64 * 1e-9);
        first.kill();
        second.kill();
        site.forget();
    }
    if is_long() {
        let says = "Driver and daemon killed twice within 60 ms of their starts, then started once more in the same directory, and armed.";
        publish("daemon_double_kills", says, &spread(took_s));
    }
}

#[test]
fn a_second_daemon_is_sent_away_at_once_and_the_first_goes_on() {
    let site = Site::new();
    let (_driver, daemon) = (site.start("driver-sim"), site.start("daemon"));
    site.until(&["ready"]);
    let before = site.status().unwrap();
    // At once is what it does, not what else runs here: the best of some.
    let mut took_ns = u64::MAX;
    for _ in 0..5 {
        let begin = SystemClock.now_ns();
        let mut second = site.start("daemon");
        assert_eq!(second.end(PATIENCE_S), 75);
        took_ns = took_ns.min(SystemClock.now_ns() - begin);
        assert!(second.told().contains(&format!("a daemon runs already, process {}", daemon.child.id())), "{}", second.told());
    }
    assert!(took_ns < 1_000_000_000, "{took_ns} ns");
    let mut second = site.start("driver-sim");
    assert_eq!(second.end(PATIENCE_S), 75);
    let after = site.status().unwrap();
    assert_eq!((&after["phase"], &after["pid"]), (&before["phase"], &before["pid"]));
}

#[test]
fn what_is_wrong_with_a_configuration_is_said_before_anything_is_opened() {
    let site = Site::new();
    for (from, to, code, want) in [
        ("rate_hz = 100.0", "rate_hz = 100.0", 78, "--start: only a simulated robot moves by itself"),
        ("stale_s = 0.8", "stale_s = -1.0", 78, "daemon.toml:10: hal.stale_s = -1"),
        ("motion = \"motion.csv\"", "motion = \"missing.csv\"", 78, "missing.csv"),
        ("robot = \"prs3\"", "robot = \"nosuch\"", 78, "daemon.toml:2: robot: nosuch: no such file"),
    ] {
        fs::write(site.config(), CONFIG.replace(from, to)).unwrap();
        let out = Command::new(env!("CARGO_BIN_EXE_pkm")).arg("daemon").arg(site.config()).arg("--start").output().unwrap();
        let told = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!((out.status.code(), told.lines().count()), (Some(code), 1), "{told}");
        assert!(told.contains(want), "{told}");
        assert!(!site.dir.path().join("meet").exists());
    }
    fs::write(site.config(), CONFIG).unwrap();
    assert_eq!(site.run(&["order", "arm"]).0, 74);
    assert_eq!(site.run(&["status"]).0, 74);
}
