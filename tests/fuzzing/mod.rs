//! What is done to readers of files and frames: targets, seeds, and changes to seeds. The same targets run under libFuzzer in `fuzz/`.

mod frames;
mod mutate;
mod seeds;

use std::path::Path;
use std::sync::LazyLock;

use pkm_daemon::config::{DaemonConfig, Settings};
use pkm_daemon::machine::Limits;
use pkm_dyn::effects::Robot;
use pkm_dyn::urdf::parse;
use pkm_hal::backends::Loopback;
use pkm_hal::{Limiter, ManualClock, Watchdog, WatchdogLimits};
use pkm_record::{ReadOptions, read_bytes};

pub use frames::frames;
pub use mutate::mutated;
pub use seeds::{bag_of, of as seeds};

/// A reader of files, or of what other processes hand over.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// Its name, and the folder of its kept inputs.
    pub name: &'static str,
    /// Reads, and must end with a value or an error.
    pub run: fn(&[u8]),
}

/// Every reader of what comes from elsewhere.
pub const TARGETS: [Target; 8] = [
    Target { name: "urdf", run: urdf },
    Target { name: "robot_toml", run: robot_toml },
    Target { name: "controller_toml", run: controller_toml },
    Target { name: "daemon_toml", run: daemon_toml },
    Target { name: "frames", run: frames },
    Target { name: "csv", run: csv },
    Target { name: "mcap", run: mcap },
    Target { name: "cdr", run: cdr },
];

/// The target of a name.
#[must_use]
pub fn target(name: &str) -> Option<Target> {
    TARGETS.into_iter().find(|target| target.name == name)
}

/// An error is one line for people, whatever the file holds.
fn one_line(error: &dyn core::fmt::Display) {
    let text = error.to_string();
    assert_eq!(text.lines().count(), 1, "{text:?}");
}

/// A URDF beside the robot.toml of the five-bar.
pub fn urdf(bytes: &[u8]) {
    let toml = pkm_robots::find("five_bar").map_or("", |robot| robot.toml);
    if let Err(e) = parse(toml, &String::from_utf8_lossy(bytes), ["robot.toml", "robot.urdf"]) {
        one_line(&e);
    }
}

/// A robot.toml beside the URDF of the five-bar.
pub fn robot_toml(bytes: &[u8]) {
    let urdf = pkm_robots::find("five_bar").map_or("", |robot| robot.urdf);
    if let Err(e) = parse(&String::from_utf8_lossy(bytes), urdf, ["robot.toml", "robot.urdf"]) {
        one_line(&e);
    }
}

/// A controller.toml for the five-bar.
pub fn controller_toml(bytes: &[u8]) {
    static ROBOT: LazyLock<Option<Robot>> = LazyLock::new(|| {
        let shipped = pkm_robots::find("five_bar")?;
        parse(shipped.toml, shipped.urdf, [shipped.toml_name, shipped.urdf_name]).ok().map(|description| description.robot)
    });
    if let Some(robot) = &*ROBOT
        && let Err(e) = pkm_ctrl::config::parse(&String::from_utf8_lossy(bytes), "controller.toml", robot)
    {
        one_line(&e);
    }
}

/// A daemon.toml for the 3-PRS: what is accepted can be built, whatever its controller's rate.
///
/// # Panics
/// When a robot with the accepted numbers is refused: all of a file is to be checked before anything is opened.
pub fn daemon_toml(bytes: &[u8]) {
    static ROBOT: LazyLock<Option<Robot>> = LazyLock::new(|| {
        let shipped = pkm_robots::find("prs3")?;
        parse(shipped.toml, shipped.urdf, [shipped.toml_name, shipped.urdf_name]).ok().map(|description| description.robot)
    });
    let Some(robot) = &*ROBOT else { return };
    let config = match DaemonConfig::parse(&String::from_utf8_lossy(bytes), "daemon.toml") {
        Ok(config) => config,
        Err(e) => return one_line(&e),
    };
    for rate_hz in [200.0, 100.0, 4000.0, 1.0, 20_000.0, f64::NAN] {
        match config.settings(&robot.model, rate_hz) {
            Ok(settings) => built(&settings, robot.model.n_act()),
            Err(e) => one_line(&e),
        }
    }
}

/// Limits and watchdog of these settings.
fn built(settings: &Settings, n: usize) {
    let Limits { period_ns, safe, ref gate, .. } = *settings.limits;
    let clock = ManualClock::new(1);
    let limited = Limiter::try_new(Loopback::new(n, &clock), &settings.axes).expect("limits that were accepted");
    Watchdog::try_new(limited, &clock, WatchdogLimits::of_period(period_ns), safe).expect("a safe action that was accepted");
    assert!(period_ns > 0 && gate.stale_ns >= period_ns && settings.black_box_s > 0.0, "{settings:?}");
}

/// A recording as CSV.
pub fn csv(bytes: &[u8]) {
    if let Err(e) = read_bytes(Path::new("A.csv"), bytes, &ReadOptions::default()) {
        one_line(&e);
    }
}

/// A recording as MCAP: strictly, mended, with one topic; what it carries; its steps.
pub fn mcap(bytes: &[u8]) {
    let name = Path::new("A.mcap");
    for (topic, recover) in [(None, false), (None, true), (Some("/pkm/signals".to_string()), true)] {
        if let Err(e) = read_bytes(name, bytes, &ReadOptions { topic, recover }) {
            one_line(&e);
        }
    }
    let options = ReadOptions { topic: None, recover: true };
    if let Err(e) = pkm_record::read_attachments_bytes(name, bytes, &options) {
        one_line(&e);
    }
    let mut steps = 0_usize;
    if let Err(e) = pkm_record::read_controls_bytes(name, bytes, &options, &mut |step| steps += step.as_control().command.len()) {
        one_line(&e);
    }
}

/// One message in a whole file, as each of the kinds that are read.
pub fn cdr(bytes: &[u8]) {
    mcap(&bag_of(bytes));
}
