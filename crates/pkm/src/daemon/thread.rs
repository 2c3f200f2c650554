//! The loop's thread: everything that must not pass from one thread to another is made on it.

use alloc::sync::Arc;
use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;

use pkm_daemon::machine::{Machine, Parts};
use pkm_daemon::realtime::{Awake, Grants, claim};
use pkm_daemon::runner;
use pkm_daemon::supervisor::LoopEnds;
use pkm_daemon::weigher::Weigher;
use pkm_hal::backends::iceoryx2::{Lock, Place, SharedRobot};
use pkm_hal::cycle::ring::RingSink;
use pkm_hal::{Backend, Limiter, SystemClock};

use super::setup::Setup;
use super::{INTERNAL, IO, Stopped, robot};

/// Longest time until the loop runs or says why not: a service that is locked costs a second.
const BEGIN: Duration = Duration::from_secs(20);

/// The running loop.
pub(super) struct Worker {
    thread: JoinHandle<Result<(), Stopped>>,
    stop: Arc<AtomicBool>,
    begun: Receiver<Grants>,
}

impl Worker {
    /// The loop with what the operating system gave it, once it has begun.
    ///
    /// # Errors
    /// It did not begin: its own reason where it ended.
    pub(super) fn begun(self) -> Result<(Self, Grants), Stopped> {
        match self.begun.recv_timeout(BEGIN) {
            Ok(grants) => Ok((self, grants)),
            // Its end of the channel is gone, so it is ending, though it may not have finished.
            Err(RecvTimeoutError::Disconnected) => {
                let why = self.join().err();
                Err(why.unwrap_or_else(|| Stopped::new(INTERNAL, "the loop ended before it began")))
            }
            Err(RecvTimeoutError::Timeout) => Err(Stopped::new(INTERNAL, "the loop did not begin within 20 s")),
        }
    }

    pub(super) fn has_ended(&self) -> bool {
        self.thread.is_finished()
    }

    pub(super) fn end(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Waits for the thread.
    ///
    /// # Errors
    /// Why it ended before it was told to.
    pub(super) fn join(self) -> Result<(), Stopped> {
        self.end();
        self.thread.join().unwrap_or_else(|_| Err(Stopped::new(INTERNAL, "the loop failed")))
    }
}

/// Where records go: to who supervises, and to who records.
pub(super) type Sinks = (RingSink, Option<RingSink>);

/// What the thread holds besides the robot.
struct Room {
    setup: Arc<Setup>,
    sink: Sinks,
    ends: LoopEnds,
    stop: Arc<AtomicBool>,
    begun: SyncSender<Grants>,
}

/// Starts the loop.
///
/// # Errors
/// No thread can be made.
pub(super) fn start(setup: Arc<Setup>, place: Place, lock: Lock, sink: Sinks, ends: LoopEnds) -> Result<Worker, Stopped> {
    let stop = Arc::new(AtomicBool::new(false));
    let (tell, begun) = sync_channel(1);
    let room = Room { setup: Arc::clone(&setup), sink, ends, stop: Arc::clone(&stop), begun: tell };
    let body = move || {
        if setup.is_simulated() {
            let hal = robot::simulated(&setup).map_err(|e| Stopped::new(super::CONFIGURATION, format!("{e:#}")))?;
            let outcome = turn(hal, room);
            drop(lock);
            outcome
        } else {
            let n = setup.robot.robot.model.n_act();
            let shared = SharedRobot::try_new(&place, lock, n, setup.n_sensors())?;
            let hal = Limiter::sharing(shared, Arc::clone(&setup.settings.axes)).map_err(|e| Stopped::new(super::CONFIGURATION, e))?;
            turn(hal, room)
        }
    };
    let thread = std::thread::Builder::new().name("loop".to_string()).stack_size(4 << 20).spawn(body);
    thread.map(|thread| Worker { thread, stop, begun }).map_err(|e| Stopped::new(IO, e))
}

/// Claims rights, then runs until it is told to end.
fn turn<B: Backend>(hal: B, room: Room) -> Result<(), Stopped> {
    let Room { setup, sink, ends, stop, begun } = room;
    let LoopEnds { orders, answers, transitions, heartbeat } = ends;
    let settings = &setup.settings;
    let weigher = Weigher::new(setup.robot.robot.model.clone());
    let (limits, wrench) = (Arc::clone(&settings.limits), settings.wrench);
    let mut machine = Machine::new(Parts { hal, sink, weigher, wrench, limits, orders, answers, transitions, heartbeat });
    // After everything is made: memory of now is locked with it.
    let _awake: Awake = match claim(settings.realtime, settings.cpu, settings.priority) {
        Ok((grants, awake)) => {
            // Nobody listens any more when the daemon has given up.
            let _ = begun.send(grants);
            awake
        }
        Err(grants) => return Err(Stopped::not_realtime(&grants)),
    };
    let outcome = runner::run(&mut machine, &SystemClock, settings.limits.period_ns, &stop, &mut |_| {});
    outcome.map_err(|e| Stopped::new(INTERNAL, e))
}
