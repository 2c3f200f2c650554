//! What stands beside the loop and fails: memory that holds a controller's gains, a disk that takes its time, the time of day. Each row of the
//! second table of docs/FAULTS.md is made here.
//!
//! With `PKM_WRITE_FAULTS=1` the table is written anew. Otherwise what stands there must be what happens.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails, outside #[test] functions too")]

extern crate alloc;

#[allow(dead_code, reason = "shared: no test uses all of it")]
#[path = "daemon/rig.rs"]
mod rig;

use alloc::sync::Arc;
use core::cell::Cell;
use core::sync::atomic::{AtomicU64, Ordering};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use pkm_ctrl::{About, Health, Numbers, Running, Signals};
use pkm_daemon::black_box::BlackBox;
use pkm_daemon::config::Settings;
use pkm_daemon::machine::{Machine, Parts, Tick};
use pkm_daemon::status::{Status, Told};
use pkm_daemon::supervisor::{LoopEnds, Reporter, Supervisor, Workshop, lines};
use pkm_daemon::weigher::Weigher;
use pkm_daemon::{Grid, Motion, OrderKind};
use pkm_hal::cycle::ring::{RingSink, RingSource, ring};
use pkm_hal::{Cause, Clock, CycleRecord, CycleSource, ManualClock, Phase};
use pkm_record::cycles::{Folder, Layout, Options, Recorder};
use rig::{Guarded, Wave, controller, guarded, robot, settings};

const PERIOD_NS: u64 = 5_000_000;

/// Periods for which the ring of a recording has room at this rate: eight seconds, as in the program.
const ROOM: usize = 1600;

/// The example's controller, and a gain of it in memory that can be changed from outside, as a particle does.
struct Soft {
    inner: Box<dyn Running>,
    gain: Arc<AtomicU64>,
}

impl Running for Soft {
    fn about(&self) -> &About {
        self.inner.about()
    }

    fn step(&mut self, signals: &Signals<'_>, tau: &mut [f64]) -> Health {
        self.inner.step(signals, tau)
    }

    fn health(&self) -> Health {
        self.inner.health()
    }

    fn reset(&mut self) {
        self.inner.reset();
    }

    fn numbers(&self) -> Option<Numbers> {
        let gain = Arc::clone(&self.gain);
        Some(Numbers::new(gain))
    }
}

/// Makes controllers with a gain of their own each.
struct Maker {
    /// Of the controller that was made last.
    gain: Arc<AtomicU64>,
    nonce: u64,
}

impl Workshop for Maker {
    fn hold(&mut self) -> Option<Box<dyn Running>> {
        self.gain = Arc::new(AtomicU64::new(123.456_f64.to_bits()));
        Some(Box::new(Soft { inner: controller(&robot("prs3")), gain: Arc::clone(&self.gain) }))
    }

    fn run(&mut self) -> Option<Box<dyn Running>> {
        None
    }

    fn motion(&mut self) -> Option<Box<dyn Motion>> {
        let mut centre = [0.0; pkm_hal::MAX_AXES];
        centre[..3].fill(0.15);
        Some(Box::new(Wave { centre, height: 0.05, length: None }))
    }

    fn phase(&self) -> Phase {
        Phase::Position
    }

    fn length_s(&self) -> Option<f64> {
        None
    }

    fn nonce(&mut self) -> u64 {
        self.nonce += 1;
        self.nonce
    }
}

/// Keeps what is told.
#[derive(Clone, Default)]
struct Heard {
    transitions: Arc<Mutex<Vec<Told>>>,
    lines: Arc<Mutex<Vec<String>>>,
    /// Records in each black box.
    boxes: Arc<Mutex<Vec<usize>>>,
}

impl Reporter for Heard {
    fn transition(&mut self, told: &Told) {
        self.transitions.lock().unwrap().push(told.clone());
    }

    fn line(&mut self, text: &str) {
        self.lines.lock().unwrap().push(text.to_string());
    }

    fn black_box(&mut self, event: &Told, records: &mut dyn ExactSizeIterator<Item = &CycleRecord>) -> Result<String, String> {
        self.boxes.lock().unwrap().push(records.len());
        Ok(event.cause.clone())
    }
}

/// A loop, who supervises it, and the way to a recording, by a clock that moves only when told to.
struct Site<'c> {
    machine: Machine<Guarded<'c>, (RingSink, RingSink)>,
    keeper: Supervisor<RingSource, Maker, Heard>,
    heard: Heard,
    recorded: RingSource,
    clock: &'c ManualClock,
    grid: Grid,
    /// The gain of the controller that runs.
    gain: Arc<AtomicU64>,
    settings: Settings,
}

impl<'c> Site<'c> {
    /// Playing a motion that does not end.
    fn playing(clock: &'c ManualClock) -> Self {
        let robot = robot("prs3");
        let settings = settings(&robot);
        let hal = guarded(&robot, &settings, &[0.14, 0.15, 0.16], clock);
        let ((sink, source), (record_sink, recorded)) = (ring(ROOM), ring(ROOM));
        let (ends, LoopEnds { orders, answers, transitions, heartbeat }) = lines(source);
        let weigher = Weigher::new(robot.model.clone());
        let (limits, wrench) = (Arc::clone(&settings.limits), settings.wrench);
        let sink = (sink, record_sink);
        let machine = Machine::new(Parts { hal, sink, weigher, wrench, limits, orders, answers, transitions, heartbeat });
        let heard = Heard::default();
        let maker = Maker { gain: Arc::default(), nonce: 1 };
        let black_box = BlackBox::new(5.0, PERIOD_NS);
        let mut keeper = Supervisor::new(ends, maker, heard.clone(), black_box, Status::default(), clock.now_ns());
        keeper.watch(settings.numbers());
        let grid = Grid::new(clock.now_ns() + PERIOD_NS, PERIOD_NS);
        let mut site = Self { machine, keeper, heard, recorded, clock, grid, gain: Arc::default(), settings };
        site.periods(3, true);
        site.bring_back();
        site.keeper.order(OrderKind::Start, Cause::Order).unwrap();
        site.periods(300, true);
        assert_eq!(site.machine.phase(), Phase::Position);
        site
    }

    /// From ready to holding.
    fn bring_back(&mut self) {
        self.keeper.order(OrderKind::Arm, Cause::Order).unwrap();
        self.gain = Arc::clone(&self.keeper_gain());
        for _ in 0..2000 {
            self.periods(1, true);
            if self.machine.phase() == Phase::Holding {
                return;
            }
        }
        panic!("{:?}", self.heard.transitions.lock().unwrap().last());
    }

    /// That of the controller the workshop has made last.
    fn keeper_gain(&mut self) -> Arc<AtomicU64> {
        Arc::clone(&self.keeper.workshop_mut().gain)
    }

    /// So many periods, a turn of the supervisor in each; what is recorded is taken where the disk does.
    fn periods(&mut self, n: u64, is_taken: bool) {
        for _ in 0..n {
            self.clock.advance(self.grid.beat().planned_ns.saturating_sub(self.clock.now_ns()));
            let now_ns = self.clock.now_ns();
            let tick = Tick { beat: self.grid.woken(now_ns), woken_ns: now_ns, is_overrun: false };
            self.machine.step(&tick, self.clock);
            self.grid.done(self.clock.now_ns());
            self.keeper.turn(self.clock.now_ns(), false);
            while is_taken && self.recorded.take().is_some() {}
        }
    }
}

/// A row: the fault, what the loop does, why, when that is noticed `[ms]`, what is lost, whether all comes back.
fn row(fault: &str, site: &Site<'_>, noticed_ms: Option<u64>, lost: &str, is_recovered: bool) -> String {
    let heard = site.heard.transitions.lock().unwrap();
    let cause = noticed_ms.and_then(|_| heard.iter().rev().find(|told| told.to == "fault")).map_or("-", |told| told.cause.as_str());
    let noticed = noticed_ms.map_or_else(|| "-".to_string(), |ms| format!("{ms} ms"));
    let end = if noticed_ms.is_some() { "fault" } else { site.machine.phase().name() };
    format!("| {fault} | {end} | {cause} | {noticed} | {lost} | {} |\n", if is_recovered { "yes" } else { "no" })
}

/// When a flipped bit is noticed `[ms]`, if it is, by a supervisor that says so in these words.
fn noticed(site: &mut Site<'_>, bit: usize, says: &str) -> Option<u64> {
    let began = site.clock.now_ns();
    let mut noticed = None;
    for _ in 0..600 {
        site.periods(1, true);
        if noticed.is_none() && site.machine.phase() == Phase::Fault {
            noticed = Some((site.clock.now_ns() - began) / 1_000_000);
        }
    }
    assert!(noticed.is_some_and(|ms| ms <= 1010), "bit {bit}: {noticed:?}");
    assert!(site.heard.lines.lock().unwrap().iter().any(|line| line.starts_with(says)));
    noticed
}

/// A bit of a gain flips: the robot is taken from the loop within a second, and comes back with the numbers of the file.
fn flipped(bit: u32) -> String {
    let clock = ManualClock::new(1_000_000_000);
    let mut site = Site::playing(&clock);
    site.gain.fetch_xor(1 << bit, Ordering::Relaxed);
    let noticed = noticed(&mut site, bit as usize, "numbers of a controller have changed");
    assert_eq!(site.heard.boxes.lock().unwrap().len(), 1, "one black box");
    // The robot's own safe action is on: the loop sends nothing any more.
    assert!(site.machine.hal_mut().trip().is_some());
    site.keeper.order(OrderKind::ClearFault, Cause::Order).unwrap();
    site.periods(10, true);
    site.bring_back();
    site.periods(400, true);
    let is_recovered = site.machine.phase() == Phase::Holding;
    row("a bit of a gain flips in memory", &site, noticed, "-", is_recovered)
}

/// Flips a bit of a number where it lies in this process's memory, as a particle does.
fn strike(number: &f64, bit: usize) {
    let memory = File::options().read(true).write(true).open("/proc/self/mem").unwrap();
    let at = (core::ptr::from_ref(number).addr() + bit / 8) as u64;
    let mut byte = [0];
    memory.read_exact_at(&mut byte, at).unwrap();
    memory.write_all_at(&[byte[0] ^ 1 << (bit % 8)], at).unwrap();
}

/// A bit of a limit flips: the robot is taken from the loop within a second, again and again, until the file is read anew.
fn struck(number: fn(&Settings) -> &f64, bit: usize) -> String {
    let clock = ManualClock::new(1_000_000_000);
    let mut site = Site::playing(&clock);
    site.periods(600, true);
    assert_eq!(site.machine.phase(), Phase::Position, "limits that are what they were stop nothing");
    let before = number(&site.settings).to_bits();
    strike(number(&site.settings), bit);
    assert_eq!(number(&site.settings).to_bits(), before ^ 1 << bit, "the memory of the limits is struck");
    let noticed = noticed(&mut site, bit, "limits have changed in memory (end this daemon");
    assert!(site.machine.hal_mut().trip().is_some());
    site.keeper.order(OrderKind::ClearFault, Cause::Order).unwrap();
    site.periods(10, true);
    site.keeper.order(OrderKind::Arm, Cause::Order).unwrap();
    site.periods(400, true);
    let told = site.heard.transitions.lock().unwrap().last().cloned().expect("a transition");
    assert_eq!((site.machine.phase(), told.cause.as_str()), (Phase::Fault, "numbers-changed"), "armed, and taken away again: {told:?}");
    row("a bit of a limit flips in memory", &site, noticed, "-", false)
}

/// Whoever writes gets no further for so many periods; how many records found no room.
fn stuck(periods: u64) -> (u64, String) {
    let clock = ManualClock::new(1_000_000_000);
    let mut site = Site::playing(&clock);
    let before = site.machine.counts().skipped;
    site.periods(periods, false);
    let waiting = core::iter::from_fn(|| site.recorded.take()).count() as u64;
    site.periods(100, true);
    let lost = site.recorded.lost();
    assert_eq!((waiting + lost, site.machine.counts().skipped - before), (periods, 0), "every period is there or counted");
    let name = format!("a disk takes {} s to keep what it was given", periods / 200);
    let is_recovered = site.machine.phase() == Phase::Position;
    (lost, row(&name, &site, None, &format!("{lost} periods of {periods}"), is_recovered))
}

/// Times of day as a recording states them, of a loop whose machine is set an hour back on the way: in order, a period apart. That nothing else
/// asks for the time of day is a test of its own (`tests/architecture.rs`).
fn set_back() -> String {
    let clock = ManualClock::new(1_000_000_000);
    let mut site = Site::playing(&clock);
    // What is asked for the time of day: the machine's clock, which somebody sets. It is asked once, at the start.
    let (asked, offset) = (Cell::new(0), Cell::new(1_700_000_000_000_000_000_u64));
    let wall = || {
        asked.set(asked.get() + 1);
        clock.now_ns() + offset.get()
    };
    let layout = || Layout {
        joints: ["q1", "q6", "q8"].map(str::to_string).to_vec(),
        epoch_ns: pkm_hal::epoch_offset_of(&clock, &wall),
        ..Layout::default()
    };
    let folder = tempfile::tempdir().unwrap();
    // A new file every second: each of them begins after a look at whatever says the time.
    let options = Options { stem: "loop".to_string(), rotate_ns: 1_000_000_000, keep_cycles: 0, after_cycles: 0, ..Options::default() };
    let mut recorder = Recorder::begin(Box::new(Folder::new(folder.path())), layout(), options, clock.now_ns()).unwrap();
    let before = site.machine.counts().skipped;
    for period in 0..1000 {
        if period == 500 {
            offset.set(offset.get() - 3_600_000_000_000);
        }
        site.periods(1, false);
        while let Some(record) = site.recorded.take() {
            recorder.push(&record, clock.now_ns());
        }
        recorder.tick(clock.now_ns());
    }
    let (tally, outcome) = recorder.finish(clock.now_ns());
    outcome.unwrap();
    assert_eq!((tally.written, tally.lost, site.machine.counts().skipped - before), (1000, 0, 0));
    assert!(tally.files >= 4, "{} files", tally.files);
    let times = times(folder.path());
    assert!(times.len() == 1000 && times.windows(2).all(|pair| pair[1] - pair[0] == PERIOD_NS), "in order, a period apart");
    assert_eq!(asked.get(), 1, "the time of day is asked for once");
    let is_recovered = site.machine.phase() == Phase::Position;
    row("time of day set an hour back", &site, None, "0 periods of 1000", is_recovered)
}

/// Times at which periods are logged in every file of a folder, in order of their names, as another library reads them `[ns]`.
fn times(folder: &Path) -> Vec<u64> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let mut out = Vec::new();
    for file in files {
        let bytes = std::fs::read(&file).unwrap();
        let messages = mcap::MessageStream::new(&bytes).unwrap().map(|message| message.unwrap());
        out.extend(messages.filter(|message| message.channel.topic == "/pkm/cycle").map(|message| message.log_time));
    }
    out
}

const BEGIN: &str = "<!-- table: tests/daemon_beside.rs -->\n";

const END: &str = "<!-- end of table -->";

const HEAD: &str = "\
| fault | the loop ends in | cause | noticed within | recording lost | recovered |
|---|---|---|---|---|---|
";

#[test]
fn what_fails_beside_the_loop_ends_as_the_table_says() {
    let mut table = String::from(HEAD);
    // The sign, the exponent and the last bit of the fraction.
    let rows = [63, 54, 0].map(flipped);
    assert!(rows.iter().all(|row| *row == rows[0]), "{rows:?}");
    table += &rows[0];
    // None of these is looked at while this motion plays: nothing but their sum can tell.
    let axis: fn(&Settings) -> &f64 = |s| &s.axes[0].effort;
    let rows = [struck(|s| &s.limits.speed[0], 63), struck(|s| &s.limits.gate.jump[2], 54), struck(axis, 0)];
    assert!(rows.iter().all(|row| *row == rows[0]), "{rows:?}");
    table += &rows[0];
    let [(none, short), (some, long)] = [1000, 2400].map(stuck);
    assert_eq!((none, some), (0, 2400 - ROOM as u64));
    table += &(short + &long + &set_back());
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs/FAULTS.md");
    let text = std::fs::read_to_string(&path).expect("docs/FAULTS.md");
    let (head, rest) = text.split_once(BEGIN).expect("the table has its mark");
    let (committed, tail) = rest.split_once(END).expect("the table has its end");
    if std::env::var_os("PKM_WRITE_FAULTS").is_some() {
        std::fs::write(&path, format!("{head}{BEGIN}{table}{END}{tail}")).expect("docs/FAULTS.md");
        return;
    }
    assert_eq!(table, committed, "docs/FAULTS.md says otherwise");
}
