//! `pkm driver-sim`: a simulated robot in a process of its own, where a driver of real hardware would be.

mod heard;

use alloc::sync::Arc;
use core::sync::atomic::{AtomicBool, Ordering};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use pkm_daemon::Grid;
use pkm_daemon::histogram::Summary;
use pkm_daemon::realtime::claim;
use pkm_daemon::runner::Pace;
use pkm_hal::backends::iceoryx2::{Place, Role, SharedDriver};
use pkm_hal::{Clock, SystemClock};
use serde_json::json;

use crate::daemon::setup::Setup;
use crate::daemon::{CONFIGURATION, INTERNAL, Stopped, refuse, robot};
use crate::out;
use heard::Heard;

/// Turns of the driver in one period of the loop: a command waits for no more than such a part of it.
const TURNS: u64 = 4;

/// Arguments of `pkm driver-sim`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Reads the same file as the daemon: robot, limits, safe action, real-time rights and directory are the same on both sides. Either side may \
end and come back without the other; a commander that falls silent loses the robot, which then applies the safe action.

Exit codes: 0 ended as told, 70 internal error, 71 real time is required and not granted, 74 I/O, 75 another driver \
runs, 78 the configuration is wrong.

Examples:
  pkm driver-sim daemon.toml
  pkm driver-sim daemon.toml --seconds 10
  pkm driver-sim daemon.toml --seconds 10 --json | jq .round_trip")]
pub(crate) struct Args {
    /// A daemon.toml with hal.kind = "iceoryx2".
    config: PathBuf,
    /// End after so long.
    #[arg(long, value_name = "S", value_parser = crate::diagnosis::positive)]
    seconds: Option<f64>,
    /// Print one JSON object when it has ended, and everything else on standard error.
    #[arg(long)]
    json: bool,
    /// Print nothing but errors, and what --json asks for.
    #[arg(long, short)]
    quiet: bool,
}

/// Refusals are told once in this time `[ns]`.
const SILENT_NS: u64 = 1_000_000_000;

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    Ok(match serve(args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(Stopped { code, problem }) => refuse(code, &problem),
    })
}

fn read(path: &Path) -> Result<Setup, Stopped> {
    let setup = Setup::read(Some(path)).map_err(|e| Stopped::new(CONFIGURATION, format!("{e:#}")))?;
    if setup.is_simulated() {
        let problem = format!("{}: hal.kind is \"simulated\" (a driver of its own needs \"iceoryx2\")", path.display());
        return Err(Stopped::new(CONFIGURATION, problem));
    }
    Ok(setup)
}

fn serve(args: &Args) -> Result<(), Stopped> {
    let setup = read(&args.config)?;
    setup.admit()?;
    let place = Place::try_new(&setup.directory())?;
    let lock = place.lock(Role::Driver)?;
    let mut driver = SharedDriver::try_new(&place, lock)?;
    let hal = robot::simulated(&setup).map_err(|e| Stopped::new(CONFIGURATION, format!("{e:#}")))?;
    let mut hal = Heard::new(hal, SystemClock);
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(|e| Stopped::new(INTERNAL, e))?;
    }
    let mut log = Log { is_quiet: args.quiet, is_json: args.json, ..Log::default() };
    log.say(&format!("driver of process {}, mended at the start: {:?}", std::process::id(), driver.mended()))?;
    // A robot does not wait for a busy machine. The loop's core is the daemon's.
    let claimed = claim(setup.settings.realtime, None, setup.settings.priority);
    let (grants, _awake) = claimed.map_err(|grants| Stopped::not_realtime(&grants))?;
    if grants.fifo_priority > 0 {
        log.say(&format!("SCHED_FIFO {}", grants.fifo_priority))?;
    }
    let begin_ns = SystemClock.now_ns();
    let mut grid = Grid::new(begin_ns, setup.settings.limits.period_ns / TURNS);
    let mut outcome = Ok(());
    while !stop.load(Ordering::Relaxed) {
        SystemClock.sleep_until(grid.beat().planned_ns);
        let now_ns = SystemClock.now_ns();
        grid.woken(now_ns);
        if args.seconds.is_some_and(|s| now_ns.saturating_sub(begin_ns) as f64 * 1e-9 >= s) {
            break;
        }
        // A state that is stale to the watchdog is still the robot's newest: the loop judges by its age as well.
        let served = driver.serve(&mut hal);
        log.look(&driver, hal.inner.counts().trips, now_ns)?;
        if let Err(pkm_hal::HalError::Gone { code }) = served {
            outcome = Err(Stopped::new(INTERNAL, format!("the simulation cannot go on (code {code})")));
            break;
        }
        grid.done(SystemClock.now_ns());
    }
    log.close(&setup, &driver, hal.round_trips(), outcome.as_ref().err())?;
    outcome
}

/// What was told so far, and how.
#[derive(Debug, Default)]
struct Log {
    is_quiet: bool,
    /// Whether standard output is for one JSON object.
    is_json: bool,
    trips: u64,
    opened: u64,
    refused: u64,
    /// When refusals were told last `[ns]`.
    refused_ns: u64,
}

impl Log {
    fn say(&self, text: &str) -> Result<(), Stopped> {
        if self.is_quiet {
            return Ok(());
        }
        out::words(text, self.is_json).map_err(|e| Stopped::new(INTERNAL, e))
    }

    /// Tells what is new in a turn at `now_ns` `[ns]`, after which the commander has lost the robot `trips` times.
    fn look(&mut self, driver: &SharedDriver, trips: u64, now_ns: u64) -> Result<(), Stopped> {
        let served = driver.served();
        if trips > self.trips {
            self.trips = trips;
            self.say(&format!("{:.6} s: the commander lost the robot: safe action", now_ns as f64 * 1e-9))?;
        }
        if served.opened > self.opened {
            self.opened = served.opened;
            self.say(&format!("{:.6} s: listens to a daemon", now_ns as f64 * 1e-9))?;
        }
        if served.refused > self.refused && now_ns.saturating_sub(self.refused_ns) > SILENT_NS {
            let last = served.last.map_or(String::new(), |error| error.to_string());
            let refused = served.refused;
            self.say(&format!("{:.6} s: {refused} commands refused so far, the last because {last}", now_ns as f64 * 1e-9))?;
            (self.refused, self.refused_ns) = (refused, now_ns);
        }
        Ok(())
    }

    /// The last word: in words, and for programs.
    fn close(&self, setup: &Setup, driver: &SharedDriver, answers: Summary, error: Option<&Stopped>) -> Result<(), Stopped> {
        let served = driver.served();
        let last = served.last.map(|error| error.to_string());
        let Summary { count, p50_us, p99_us, p999_us, max_us } = answers;
        if count > 0 {
            self.say(&format!("from a state to its answer, us: {count} times, p50 {p50_us} p99 {p99_us} p99.9 {p999_us} max {max_us}"))?;
        }
        let because = last.as_ref().map_or(String::new(), |last| format!(", the last because {last}"));
        self.say(&format!("{} states sent, {} commands taken, {} refused{because}", served.sent, served.taken, served.refused))?;
        if !self.is_json {
            return Ok(());
        }
        let told = json!({
            "schema": "pkm.driver_sim/1", "pkm": crate::VERSION, "error": error.map(|stopped| &stopped.problem),
            "robot": setup.robot.robot.model.name, "states_sent": served.sent, "commands_taken": served.taken,
            "commands_refused": served.refused, "last_refusal": last, "daemons_heard": served.opened, "times_lost": self.trips,
            "round_trip": answers,
        });
        out::say(&told.to_string()).map_err(|e| Stopped::new(INTERNAL, e))
    }
}
