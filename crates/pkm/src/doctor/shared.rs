//! How long shared memory takes: the library alone, and beside it what goes over it between a loop and its robot.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;

use pkm_daemon::histogram::{Summary, Times};
use pkm_hal::backends::Loopback;
use pkm_hal::backends::iceoryx2::{Place, Role, SharedDriver, SharedRobot, ping_pong};
use pkm_hal::{Backend, Clock, CommandFrame, Mode, SystemClock};

/// Axes of the robot that answers.
const AXES: usize = 3;

/// Longest wait for the other side `[ns]`.
const PATIENCE_NS: u64 = 2_000_000_000;

/// There and back.
pub(super) struct Shared {
    /// Samples of iceoryx2, as large as a command.
    pub(super) bare: Summary,
    /// A sealed command that is checked and taken, and the sealed state that says so.
    pub(super) own: Summary,
}

/// Both, each for `length`, in a place of their own.
pub(super) fn measure(length: Duration) -> anyhow::Result<Shared> {
    let folder = tempfile::tempdir()?;
    let for_ns = u64::try_from(length.as_nanos()).unwrap_or(u64::MAX);
    let mut times = Times::default();
    ping_pong(&Place::try_new(&folder.path().join("bare"))?, for_ns, &SystemClock, &mut |ns| times.note(ns))?;
    Ok(Shared { bare: times.summary(), own: frames(&Place::try_new(&folder.path().join("own"))?, for_ns)? })
}

fn frames(place: &Place, for_ns: u64) -> anyhow::Result<Summary> {
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let driver = scope.spawn(|| -> anyhow::Result<()> {
            let mut driver = SharedDriver::try_new(place, place.lock(Role::Driver)?)?;
            let mut robot = Loopback::new(AXES, SystemClock);
            while !is_over.load(Ordering::Relaxed) {
                driver.serve(&mut robot)?;
            }
            Ok(())
        });
        let times = there_and_back(place, for_ns);
        is_over.store(true, Ordering::Relaxed);
        driver.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
        Ok(times?.summary())
    })
}

fn there_and_back(place: &Place, for_ns: u64) -> anyhow::Result<Times> {
    let mut robot = SharedRobot::try_new(place, place.lock(Role::Daemon)?, AXES, 0)?;
    let mut times = Times::default();
    let mut since_ns = SystemClock.now_ns();
    while robot.read().is_err() {
        anyhow::ensure!(SystemClock.now_ns().saturating_sub(since_ns) < PATIENCE_NS, "shared memory: the other thread is not heard");
        robot.reconnect();
        std::thread::yield_now();
    }
    since_ns = SystemClock.now_ns();
    for sequence in 1.. {
        let begin_ns = SystemClock.now_ns();
        if begin_ns.saturating_sub(since_ns) >= for_ns {
            break;
        }
        let command = CommandFrame { nonce: 1, sequence, valid_until_ns: u64::MAX, ..CommandFrame::new(AXES, Mode::Effort) };
        robot.write(&command.sealed())?;
        while robot.read()?.command_sequence != sequence {
            anyhow::ensure!(
                SystemClock.now_ns().saturating_sub(begin_ns) < PATIENCE_NS,
                "shared memory: command {sequence} is not answered"
            );
        }
        times.note(SystemClock.now_ns().saturating_sub(begin_ns));
    }
    Ok(times)
}
