//! `pkm driver-sim`: a simulated robot in a process of its own, where a driver of real hardware would be.

mod heard;

use alloc::sync::Arc;
use core::sync::atomic::{AtomicBool, Ordering};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use pkm_daemon::Grid;
use pkm_daemon::histogram::Summary;
use pkm_daemon::runner::Pace;
use pkm_hal::backends::iceoryx2::{Place, Role, SharedDriver};
use pkm_hal::{Clock, SystemClock};

use crate::daemon::setup::Setup;
use crate::daemon::{CONFIGURATION, INTERNAL, Stopped, refuse, robot};
use crate::out;
use heard::Heard;

/// Turns of the driver in one period of the loop: a command waits for no more than such a part of it.
const TURNS: u64 = 4;

/// Arguments of `pkm driver-sim`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Reads the same file as the daemon: robot, limits, safe action and directory are the same on both sides. Either side may end and come back \
without the other; a commander that falls silent loses the robot, which then applies the safe action.

Exit codes: 0 ended as told, 70 internal error, 74 I/O, 75 another driver runs, 78 the configuration is wrong.

Examples:
  pkm driver-sim daemon.toml
  pkm driver-sim daemon.toml --seconds 10")]
pub(crate) struct Args {
    /// A daemon.toml with hal.kind = "iceoryx2".
    config: PathBuf,
    /// End after so long.
    #[arg(long, value_name = "S", value_parser = crate::diagnosis::positive)]
    seconds: Option<f64>,
    /// Print nothing but errors.
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
    let place = Place::try_new(&setup.directory())?;
    let lock = place.lock(Role::Driver)?;
    let mut driver = SharedDriver::try_new(&place, lock)?;
    let hal = robot::simulated(&setup).map_err(|e| Stopped::new(CONFIGURATION, format!("{e:#}")))?;
    let mut hal = Heard::new(hal, SystemClock);
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(|e| Stopped::new(INTERNAL, e))?;
    }
    let say = |text: &str| if args.quiet { Ok(()) } else { out::say(text) }.map_err(|e| Stopped::new(INTERNAL, e));
    say(&format!("driver of process {}, mended at the start: {:?}", std::process::id(), driver.mended()))?;
    let begin_ns = SystemClock.now_ns();
    let turn_ns = setup.settings.limits.period_ns / TURNS;
    let mut grid = Grid::new(begin_ns, turn_ns);
    let mut trips = 0;
    let (mut told, mut told_ns, mut opened) = (0, 0, 0);
    while !stop.load(Ordering::Relaxed) {
        SystemClock.sleep_until(grid.beat().planned_ns);
        let now_ns = SystemClock.now_ns();
        grid.woken(now_ns);
        if args.seconds.is_some_and(|s| now_ns.saturating_sub(begin_ns) as f64 * 1e-9 >= s) {
            break;
        }
        // A state that is stale to the watchdog is still the robot's newest: the loop judges by its age as well.
        let served = driver.serve(&mut hal);
        if hal.inner.counts().trips > trips {
            trips = hal.inner.counts().trips;
            say(&format!("{:.6} s: the commander lost the robot: safe action", now_ns as f64 * 1e-9))?;
        }
        if driver.served().opened > opened {
            opened = driver.served().opened;
            say(&format!("{:.6} s: listens to a daemon", now_ns as f64 * 1e-9))?;
        }
        let refused = driver.served().refused;
        if refused > told && now_ns.saturating_sub(told_ns) > SILENT_NS {
            let last = driver.served().last.map_or(String::new(), |error| error.to_string());
            say(&format!("{:.6} s: {refused} commands refused so far, the last because {last}", now_ns as f64 * 1e-9))?;
            (told, told_ns) = (refused, now_ns);
        }
        if let Err(pkm_hal::HalError::Gone { code }) = served {
            return Err(Stopped::new(INTERNAL, format!("the simulation cannot go on (code {code})")));
        }
        grid.done(SystemClock.now_ns());
    }
    let served = driver.served();
    let last = served.last.map_or(String::new(), |error| format!(", the last because {error}"));
    let Summary { count, p50_us, p99_us, p999_us, max_us } = hal.round_trips();
    if count > 0 {
        say(&format!("from a state to its answer, us: {count} times, p50 {p50_us} p99 {p99_us} p99.9 {p999_us} max {max_us}"))?;
    }
    say(&format!("{} states sent, {} commands taken, {} refused{last}", served.sent, served.taken, served.refused))
}
