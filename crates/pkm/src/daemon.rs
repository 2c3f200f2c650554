//! `pkm daemon`: a controller on a robot in real time, until it is told to end.

mod brakes;
mod notify;
mod recording;
pub(crate) mod report;
pub(crate) mod robot;
pub(crate) mod setup;
mod thread;
mod workshop;

use alloc::sync::Arc;
use core::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use core::time::Duration;
use std::path::PathBuf;
use std::process::ExitCode;

use pkm_daemon::OrderKind;
use pkm_daemon::black_box::BlackBox;
use pkm_daemon::control::{Door, Request};
use pkm_daemon::realtime::{Grants, Policy};
use pkm_daemon::status::Status;
use pkm_daemon::supervisor::{Reporter, Supervisor, lines};
use pkm_hal::backends::iceoryx2::{Place, Role, SharedError};
use pkm_hal::cycle::ring::{RingSource, ring};
use pkm_hal::{Cause, Clock, Phase, SystemClock};
use serde_json::json;

use crate::out;
use notify::Notify;
use recording::Recorded;
use report::OnTerminal;
use setup::Setup;
use workshop::FromFiles;

/// Exit codes of a daemon (docs/FORMATS.md).
pub(crate) const INTERNAL: u8 = 70;
const NOT_REALTIME: u8 = 71;
pub(crate) const IO: u8 = 74;
pub(crate) const BUSY: u8 = 75;
pub(crate) const CONFIGURATION: u8 = 78;

/// Seconds of records that wait for a supervisor that is late `[s]`.
const RING_S: u64 = 8;

/// Time between two turns of the supervisor.
const TURN: Duration = Duration::from_millis(5);

/// How long the loop may not be heard of before the daemon gives up `[ns]`.
const SILENCE_NS: u64 = 2_000_000_000;

/// How long a stop may take before the robot is left to its own safe action all the same `[ns]`.
const LEAVE_NS: u64 = 12_000_000_000;

/// Arguments of `pkm daemon`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Nothing moves until `pkm order arm` and `pkm order start` say so; `pkm status` shows what is being done, `pkm order stop` ends it. Without \
a CONFIG the shipped example runs: the 3-PRS, simulated, at 200 Hz. SIGTERM or SIGINT stop the robot along its path and end the daemon; the \
robot then applies its own safe action (`pkm order off` before it switches off). A second one applies the safe action at once. A safe \
stop or fault leaves a black box in the private directory.

Exit codes: 0 ended as told, 70 internal error, 71 real-time rights are required and not given, 74 I/O, 75 another daemon runs, 78 the \
configuration is wrong.

Examples:
  pkm daemon
  pkm daemon --check daemon.toml
  pkm daemon daemon.toml
  pkm daemon --seconds 10 --start
  pkm daemon daemon.toml --record runs
  pkm daemon daemon.toml --record runs --live 8765     # and look at ws://localhost:8765
  pkm daemon --seconds 10 --start --json | jq .status.latency")]
pub(crate) struct Args {
    /// A daemon.toml [default: the shipped example].
    config: Option<PathBuf>,
    /// Read and check everything, then end.
    #[arg(long)]
    check: bool,
    /// Arm and start at once; simulated robots only.
    #[arg(long)]
    start: bool,
    /// End after so long.
    #[arg(long, value_name = "S", value_parser = crate::diagnosis::positive)]
    seconds: Option<f64>,
    #[command(flatten)]
    recording: recording::RecordArgs,
    /// Print one JSON object when it has ended, and everything else on standard error.
    #[arg(long)]
    json: bool,
    /// Print nothing but errors, and what --json asks for.
    #[arg(long, short)]
    quiet: bool,
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let setup = match Setup::read(args.config.as_deref()) {
        Ok(setup) => Arc::new(setup),
        Err(e) => return Ok(refuse(CONFIGURATION, &format!("{e:#}"))),
    };
    if args.start && !setup.is_simulated() {
        return Ok(refuse(CONFIGURATION, "--start: only a simulated robot moves by itself (`pkm order arm`, `pkm order start`)"));
    }
    if args.check {
        return tell(&setup, args.json);
    }
    match serve(args, &setup) {
        Ok(code) => Ok(code),
        Err(Stopped { code, problem }) => Ok(refuse(code, &problem)),
    }
}

/// Why a daemon ends before it was told to.
pub(crate) struct Stopped {
    pub(crate) code: u8,
    pub(crate) problem: String,
}

impl Stopped {
    pub(crate) fn new(code: u8, problem: impl core::fmt::Display) -> Self {
        Self { code, problem: problem.to_string() }
    }

    /// Real time is required, and something of it is missing.
    pub(crate) fn not_realtime(grants: &Grants) -> Self {
        Self::new(NOT_REALTIME, format!("real time is required: {}", grants.missing.join("; ")))
    }
}

impl From<SharedError> for Stopped {
    fn from(error: SharedError) -> Self {
        let code = match error {
            SharedError::Busy { .. } | SharedError::Service { .. } => BUSY,
            SharedError::NotPrivate { .. } | SharedError::Foreign { .. } => CONFIGURATION,
            _ => IO,
        };
        Self::new(code, error)
    }
}

/// Says why on standard error.
pub(crate) fn refuse(code: u8, problem: &str) -> ExitCode {
    out::error(problem);
    ExitCode::from(code)
}

/// What a configuration that is in order comes to.
fn tell(setup: &Setup, is_json: bool) -> anyhow::Result<ExitCode> {
    let model = &setup.robot.robot.model;
    if is_json {
        let run = setup.run.as_ref().map(|run| &run.law);
        let (drives, rate_hz, is_simulated) = (model.n_act(), setup.hold.rate_hz, setup.is_simulated());
        out::say(
            &json!({"schema": "pkm.daemon_check/1", "robot": model.name, "drives": drives, "law": setup.hold.law, "runs": run,
                "rate_hz": rate_hz, "is_simulated": is_simulated})
            .to_string(),
        )?;
        return Ok(ExitCode::SUCCESS);
    }
    let run = setup.run.as_ref().map_or(String::new(), |run| format!(", runs {}", run.law));
    let rate = setup.hold.rate_hz;
    out::say(&format!("{}: {} drives, {} at {} Hz{run}; {:?}", model.name, model.n_act(), setup.hold.law, rate, setup.config.hal()))?;
    Ok(ExitCode::SUCCESS)
}

/// What signals ask for: one to leave, two to leave at once.
struct Signals {
    count: Arc<AtomicUsize>,
}

impl Signals {
    fn listen() -> std::io::Result<Self> {
        let count = Arc::new(AtomicUsize::new(0));
        for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
            let count = Arc::clone(&count);
            // SAFETY: the handler adds to an atomic, which is allowed in a signal handler.
            #[expect(unsafe_code, reason = "counting needs the general form; a flag alone cannot tell the second signal from the first")]
            unsafe {
                signal_hook::low_level::register(signal, move || {
                    count.fetch_add(1, Ordering::Relaxed);
                })?;
            }
        }
        // A terminal that is closed, or a log that is rotated, is no reason to let go of a robot.
        signal_hook::flag::register(signal_hook::consts::SIGHUP, Arc::new(AtomicBool::new(false)))?;
        // A recording beyond the largest file that is allowed is refused like one on a full disk.
        signal_hook::flag::register(rustix::process::Signal::XFSZ.as_raw(), Arc::new(AtomicBool::new(false)))?;
        Ok(Self { count })
    }

    fn count(&self) -> usize {
        self.count.load(Ordering::Relaxed)
    }
}

type Keeper = Supervisor<RingSource, FromFiles, OnTerminal>;

/// From the lock to the last black box.
fn serve(args: &Args, setup: &Arc<Setup>) -> Result<ExitCode, Stopped> {
    setup.admit()?;
    let directory = setup.directory();
    let place = Place::try_new(&directory)?;
    // The first thing: a second daemon is told in no time, and touches nothing.
    let lock = place.lock(Role::Daemon)?;
    let io = |e: std::io::Error| Stopped::new(IO, format!("{}: {e}", directory.display()));
    let door = Door::open(place.dir()).map_err(io)?;
    let signals = Signals::listen().map_err(io)?;
    let rate = 1_000_000_000 / setup.settings.limits.period_ns.max(1);
    let room = usize::try_from(rate.max(1) * RING_S).unwrap_or(8000);
    let (sink, source) = ring(room);
    let (ends, loop_ends) = lines(source);
    let (record_sink, mut recording) = args.recording.begin(setup, room)?;
    let worker = thread::start(Arc::clone(setup), place.clone(), lock, (sink, record_sink), loop_ends)?;
    let (worker, grants) = worker.begun()?;
    let (directory, is_quiet, is_json) = (place.dir().to_path_buf(), args.quiet, args.json);
    let reporter = OnTerminal { setup: Arc::clone(setup), directory, is_quiet, is_json };
    let (limits, status) = (&setup.settings.limits, status(setup, grants));
    let black_box = BlackBox::new(setup.settings.black_box_s, limits.period_ns);
    let workshop = FromFiles(Arc::clone(setup));
    let mut keeper = Supervisor::new(ends, workshop, reporter, black_box, status, SystemClock.now_ns());
    keeper.watch(setup.settings.numbers());
    warn(setup.settings.realtime, &mut keeper);
    if let Some(place) = recording.as_ref().and_then(recording::Recording::seen_at) {
        keeper.reporter_mut().line(&place);
    }
    let mut notify = Notify::from_environment();
    notify.ready("nothing moves until `pkm order arm`");
    let code = watch(args, &mut keeper, Beside { door: &door, notify: &mut notify, recording: recording.as_mut() }, &signals, &worker);
    notify.stopping();
    if code.is_err() && !worker.has_ended() {
        // A loop that stands still may never end: its thread goes down with the process.
        keeper.give_up(SystemClock.now_ns(), SILENCE_NS);
        return close(args, &keeper, None, code);
    }
    let outcome = worker.join();
    keeper.turn(SystemClock.now_ns(), true);
    let recorded = recording.map(recording::Recording::finish);
    if let Some(recorded) = &recorded {
        keeper.reporter_mut().line(&recorded.to_string());
    }
    close(args, &keeper, recorded.as_ref(), outcome.and(code))
}

/// What a status says that does not change.
fn status(setup: &Setup, realtime: Grants) -> Status {
    Status {
        pid: std::process::id(),
        robot: setup.robot.robot.model.name.clone(),
        law: setup.run.as_ref().unwrap_or(&setup.hold).law.clone(),
        period_s: setup.settings.limits.period_ns as f64 * 1e-9,
        realtime,
        ..Status::default()
    }
}

/// The last word of a daemon that has begun, for programs.
fn close(args: &Args, keeper: &Keeper, recorded: Option<&Recorded>, outcome: Result<ExitCode, Stopped>) -> Result<ExitCode, Stopped> {
    if args.json {
        let error = outcome.as_ref().err().map(|stopped| &stopped.problem);
        let told =
            json!({"schema": "pkm.daemon/1", "pkm": crate::VERSION, "error": error, "status": keeper.status(), "recording": recorded});
        // Nobody is left to be told where even that fails, and the robot is left already.
        let _ = out::say(&told.to_string());
    }
    outcome
}

/// Says what the operating system did not give.
fn warn(policy: Policy, keeper: &mut Keeper) {
    let missing = keeper.status().realtime.missing.clone();
    if policy != Policy::Off {
        for line in &missing {
            out::line_on_stderr(&format!("warning: not real time: {line}"));
        }
    }
    let pid = keeper.status().pid;
    keeper.reporter_mut().line(&format!("daemon of process {pid}; nothing moves until `pkm order arm`"));
}

/// What is looked after beside the loop.
struct Beside<'a> {
    door: &'a Door,
    notify: &'a mut Notify,
    recording: Option<&'a mut recording::Recording>,
}

/// Turns until it is time to leave, then until the robot stands.
fn watch(
    args: &Args,
    keeper: &mut Keeper,
    Beside { door, notify, mut recording }: Beside<'_>,
    signals: &Signals,
    worker: &thread::Worker,
) -> Result<ExitCode, Stopped> {
    let begin_ns = SystemClock.now_ns();
    let mut desk = Desk::default();
    let mut wishes = if args.start { vec![(Phase::Ready, OrderKind::Arm), (Phase::Holding, OrderKind::Start)] } else { Vec::new() };
    let mut leaving_ns: Option<u64> = None;
    loop {
        let now_ns = SystemClock.now_ns();
        keeper.turn(now_ns, false);
        desk.answer(keeper);
        if let Some(recording) = &mut recording {
            let (status, line) = recording.look(now_ns);
            keeper.status_mut().recording = Some(status);
            line.iter().for_each(|line| keeper.reporter_mut().line(line));
        }
        // One a turn: who asks without end keeps nobody from the robot.
        if let Some(request) = door.request() {
            desk.take(request, keeper);
        }
        if let Some((phase, kind)) = wishes.first().copied()
            && keeper.phase() == phase
        {
            wishes.remove(0);
            keeper.order(kind, Cause::Order);
        }
        if worker.has_ended() {
            return Ok(ExitCode::SUCCESS);
        }
        if now_ns.saturating_sub(keeper.seen_ns()) > SILENCE_NS {
            return Err(Stopped::new(INTERNAL, "the loop has stood still for 2 s; the robot's side applies its safe action"));
        }
        // The loop was heard of: that is what a service manager waits for.
        notify.alive(keeper.seen_ns());
        let is_over = args.seconds.is_some_and(|s| now_ns.saturating_sub(begin_ns) as f64 * 1e-9 >= s);
        if leaving_ns.is_none() && (is_over || desk.is_told_to_leave || signals.count() > 0) {
            leaving_ns = Some(now_ns);
            wishes.clear();
            keeper.order(OrderKind::Stop, Cause::Order);
        }
        if let Some(since_ns) = leaving_ns
            && leave(keeper, signals, now_ns.saturating_sub(since_ns))
        {
            worker.end();
            return Ok(ExitCode::SUCCESS);
        }
        std::thread::sleep(TURN);
    }
}

/// Whether the robot can be left.
fn leave(keeper: &mut Keeper, signals: &Signals, passed_ns: u64) -> bool {
    let phase = keeper.phase();
    if signals.count() > 1 && phase.is_moving() {
        keeper.order(OrderKind::SafeStop, Cause::Order);
        return false;
    }
    match phase {
        // Without commands the robot's side goes on with its own safe action, which holds a limb; switching off would let it fall.
        Phase::Off | Phase::Fault | Phase::SafeStop | Phase::Ready | Phase::Holding => true,
        _ => passed_ns > LEAVE_NS,
    }
}

/// Requests that wait for the loop's answer.
#[derive(Default)]
struct Desk {
    waiting: Vec<(u64, Request)>,
    is_told_to_leave: bool,
}

impl Desk {
    fn take(&mut self, request: Request, keeper: &mut Keeper) {
        let refuse = |request: Request, problem: &str| request.answer(&json!({"ok": false, "error": problem}).to_string());
        match request.text.as_str() {
            "status" => {
                let answer = serde_json::to_string(keeper.status());
                request.answer(&answer.unwrap_or_else(|e| json!({"ok": false, "error": e.to_string()}).to_string()));
            }
            "quit" => {
                self.is_told_to_leave = true;
                request.answer(&json!({"ok": true}).to_string());
            }
            other => match OrderKind::of(other) {
                None => refuse(request, "no such request"),
                Some(kind) => match keeper.order(kind, Cause::Order) {
                    Some(id) => self.waiting.push((id, request)),
                    None => refuse(request, "the loop takes no orders now"),
                },
            },
        }
    }

    /// Tells who waits what became of it.
    fn answer(&mut self, keeper: &mut Keeper) {
        while let Some((id, outcome)) = keeper.outcome() {
            let Some(at) = self.waiting.iter().position(|(waiting, _)| *waiting == id) else { continue };
            let (_, request) = self.waiting.remove(at);
            let answer = match outcome {
                Ok(()) => json!({"ok": true}),
                Err(refusal) => json!({"ok": false, "error": refusal.to_string()}),
            };
            request.answer(&answer.to_string());
        }
    }
}
