//! `pkm-ethercat INTERFACE DIRECTORY`: three drives on a network card, offered to the daemon that meets them in the directory.
#![expect(clippy::print_stderr, reason = "a driver's log")]

use core::time::Duration;
use std::path::Path;
use std::process::ExitCode;

use async_io::block_on;
use ethercrab::std::tx_rx_task;
use pkm_daemon::Grid;
use pkm_daemon::realtime::{Policy, claim};
use pkm_daemon::runner::Pace;
use pkm_ethercat::bus::Bus;
use pkm_ethercat::master::EtherCat;
use pkm_hal::backends::cia402::{Cia402, DriveScale};
use pkm_hal::backends::iceoryx2::{Place, Role, SharedDriver};
use pkm_hal::units::EncoderScale;
use pkm_hal::{AxisLimits, Clock, HalError, Limiter, MAX_AXES, SafeAction, SafeKind, SystemClock, Watchdog, WatchdogLimits};

/// Drives on the bus, in the order of the axes.
const DRIVES: usize = 3;

/// One cycle of the bus `[ns]`: twice as fast as the daemon, at least.
const CYCLE_NS: u64 = 500_000;

/// A frame that is not back by then is lost.
const PATIENCE: Duration = Duration::from_micros(400);

/// A bus that says nothing for so long is begun anew, by whoever watches this process `[ns]`.
const GIVEN_UP_NS: u64 = 1_000_000_000;

/// What counts and per mille are at the joints: measure width, zero and sign of every drive by hand, without power.
fn scales() -> Result<[DriveScale; DRIVES], HalError> {
    // m per count, m at zero, N at rated torque.
    let scale = DriveScale { encoder: EncoderScale::try_new(1e-6, 0.15)?, rated_effort: 800.0 };
    Ok([scale; DRIVES])
}

/// The last line, which holds whatever the daemon asks for.
fn limits() -> [AxisLimits; DRIVES] {
    let limits = AxisLimits {
        lower: 0.0,
        upper: 0.3,
        velocity: 0.5,
        effort: 1400.0,
        effort_rate: f64::INFINITY,
        position_gain: 20.0,
        velocity_gain: 20_000.0,
    };
    [limits; DRIVES]
}

/// What the robot does when its commander is gone.
fn safe_action() -> SafeAction {
    let (stiffness, damping, effort) = ([20_000.0; MAX_AXES], [2000.0; MAX_AXES], [1400.0; MAX_AXES]);
    SafeAction { stiffness, damping, effort, ..SafeAction::new(SafeKind::Hold) }
}

// ANCHOR: serve
fn serve(interface: &str, directory: &Path) -> Result<(), Box<dyn core::error::Error>> {
    let place = Place::try_new(directory)?; // mode 0700, own user, or it is refused
    let lock = place.lock(Role::Driver)?; // a second driver is told who runs
    // Before there are other threads: those that carry frames get the same.
    let (grants, _awake) = claim(Policy::Prefer, None, 85).map_err(|grants| grants.missing.join("; "))?;
    grants.missing.iter().for_each(|missing| eprintln!("not granted: {missing}"));
    let card = interface.to_string();
    let carry = move |tx, rx| match tx_rx_task(&card, tx, rx) {
        // A card that fails is seen as frames that do not come back.
        Ok(task) => drop(block_on(task)),
        Err(e) => eprintln!("{card}: {e}"),
    };
    let master = EtherCat::try_new(carry, DRIVES, PATIENCE)?;
    let device = Cia402::try_new(Bus::<_, _, DRIVES>::new(master, SystemClock), scales()?)?;
    let limited = Limiter::try_new(device, &limits())?;
    let mut robot = Watchdog::try_new(limited, SystemClock, WatchdogLimits::of_period(2 * CYCLE_NS), safe_action())?;
    let mut driver = SharedDriver::try_new(&place, lock)?;
    let mut grid = Grid::new(SystemClock.now_ns(), CYCLE_NS);
    let (mut heard_ns, mut told) = (SystemClock.now_ns(), None);
    loop {
        SystemClock.sleep_until(grid.beat().planned_ns); // absolute times: no drift
        grid.woken(SystemClock.now_ns());
        let served = driver.serve(&mut robot); // commands in, one cycle, its state out
        let now_ns = SystemClock.now_ns();
        match served {
            Ok(_) => (heard_ns, told) = (now_ns, None),
            Err(error) if now_ns.saturating_sub(heard_ns) > GIVEN_UP_NS => return Err(error.into()),
            // The daemon sees an old state and stops; here the watchdog does.
            Err(error) if told != Some(error) => {
                eprintln!("{:.6} s: {error}", now_ns as f64 * 1e-9);
                told = Some(error);
            }
            Err(_) => {}
        }
        grid.done(now_ns);
    }
}
// ANCHOR_END

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [interface, directory] = arguments.as_slice() else {
        eprintln!("usage: pkm-ethercat INTERFACE DIRECTORY\nexample: pkm-ethercat eth0 /run/user/1000/pkm");
        return ExitCode::from(64);
    };
    match serve(interface, Path::new(directory)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("pkm-ethercat: {problem}");
            ExitCode::from(74)
        }
    }
}
