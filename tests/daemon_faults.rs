//! Every fault that can be injected between loop and robot, with what the loop makes of it; the table is docs/FAULTS.md.
//!
//! With `PKM_WRITE_FAULTS=1` the table is written anew. Otherwise what stands there must be what happens.

#[allow(dead_code, reason = "shared: no test uses all of it")]
#[path = "daemon/rig.rs"]
mod rig;

use core::fmt::Write as _;
use std::path::PathBuf;

use pkm_ctrl::{About, Health, Running, Signals};
use pkm_daemon::{Motion, Order, OrderKind, Wanted};
use pkm_hal::cycle::flags;
use pkm_hal::frame::status;
use pkm_hal::{
    Backend, Cause, Clock, CommandFrame, Fault, FaultyHal, HalError, Injection, MAX_AXES, ManualClock, Phase, Signal, StateFrame,
};
use pkm_sim::Plant;
use rig::{Guarded, Rig, controller, guarded, robot, settings};

/// Reads until a fault begins: the robot is armed, has been home, and plays, at its fastest just then.
const FAULT_AT: u64 = 800;

const PERIOD_NS: u64 = 5_000_000;

/// A robot whose status word says more than it should, or that is gone, from a read on.
struct Status<B> {
    inner: B,
    reads: u64,
    bits: Option<(u64, u64, u32, u32)>,
    /// Reads between which it is gone, for states and commands.
    gone: core::ops::Range<u64>,
}

impl<B> Status<B> {
    fn must_be_there(&self) -> Result<(), HalError> {
        if self.gone.contains(&(self.reads.saturating_sub(1))) { Err(HalError::Gone { code: 0 }) } else { Ok(()) }
    }
}

impl<B: Backend> Backend for Status<B> {
    fn n_axes(&self) -> usize {
        self.inner.n_axes()
    }

    fn n_sensors(&self) -> usize {
        self.inner.n_sensors()
    }

    fn read(&mut self) -> Result<StateFrame, HalError> {
        self.reads += 1;
        self.must_be_there()?;
        let mut state = self.inner.read()?;
        if let Some((.., bits, drives)) = self.bits.filter(|(from, to, ..)| (*from..*to).contains(&(self.reads - 1))) {
            state.status |= bits;
            state.drive_fault |= drives;
            state = state.sealed();
        }
        Ok(state)
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        self.must_be_there()?;
        self.inner.write(command)
    }

    fn sent(&self) -> Option<&[f64; MAX_AXES]> {
        self.inner.sent()
    }
}

type Hal<'c, 's> = Status<FaultyHal<'s, Guarded<'c>>>;

/// What goes wrong beside sensors and drives.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Own {
    /// Nothing.
    Nothing,
    /// The status word has these bits; the second are drives at fault.
    Bits(u32, u32),
    /// Neither states nor commands pass.
    Gone,
    /// Every period takes so long `[ns]`.
    Slow(u64),
    /// One in so many periods takes a period and a half.
    Now(u64),
    /// The loop stands still once, for so long `[ns]`.
    Stall(u64),
    /// The supervisor says nothing.
    Silence,
    /// The controller answers with an effort that is no number.
    Controller,
    /// The motion leaps by so much `[m]`.
    Leap(f64),
}

/// A row: a fault, how many periods it lasts, and what must come of it.
struct Case {
    name: &'static str,
    faults: Vec<Fault>,
    own: Own,
    periods: u64,
    end: Phase,
    cause: Option<Cause>,
    /// Most periods until it is noticed.
    within: u64,
}

const LASTING: u64 = 150;

const HOUR_NS: i64 = 3_600_000_000_000;

fn case(name: &'static str, fault: Fault, periods: u64, end: Phase, cause: Option<Cause>, within: u64) -> Case {
    Case { name, faults: vec![fault], own: Own::Nothing, periods, end, cause, within }
}

fn own(name: &'static str, own: Own, end: Phase, cause: Option<Cause>, within: u64) -> Case {
    Case { name, faults: Vec::new(), own, periods: LASTING, end, cause, within }
}

const Q: Signal = Signal::Position;

fn sensor_cases() -> Vec<Case> {
    let (play, stop, fault) = (Phase::Position, Phase::SafeStop, Phase::Fault);
    let stale = Some(Cause::Stale);
    vec![
        case("position not a number, one frame", Fault::NotANumber { signal: Q, axis: 1 }, 1, play, None, 0),
        case("position not a number, 3 frames", Fault::NotANumber { signal: Q, axis: 1 }, 3, play, None, 0),
        case("position not a number, lasting", Fault::NotANumber { signal: Q, axis: 1 }, LASTING, stop, Some(Cause::BrokenState), 3),
        case(
            "velocity infinite, lasting",
            Fault::Infinite { signal: Signal::Velocity, axis: 0 },
            LASTING,
            stop,
            Some(Cause::BrokenState),
            3,
        ),
        case(
            "effort not a number, lasting",
            Fault::NotANumber { signal: Signal::Effort, axis: 2 },
            LASTING,
            stop,
            Some(Cause::BrokenState),
            3,
        ),
        case("states frozen (no new frame), lasting", Fault::Drop, LASTING, stop, stale, 11),
        case("one frame dropped", Fault::Drop, 1, play, None, 0),
        case("2 frames dropped", Fault::Drop, 2, play, None, 0),
        case("5 frames dropped", Fault::Drop, 5, play, None, 0),
        case("20 frames dropped", Fault::Drop, 20, stop, stale, 11),
        case("one frame twice", Fault::Duplicate, 1, play, None, 0),
        case("frames out of order", Fault::Older { by: 2 }, 1, play, None, 0),
        case("frames 2 periods late, lasting", Fault::Older { by: 2 }, LASTING, play, None, 0),
        case("encoder stuck", Fault::Stuck { signal: Q, axis: 0 }, LASTING, fault, Some(Cause::Stuck), 20),
        case("encoder unplugged, one frame", Fault::Unplugged { signal: Q, axis: 2 }, 1, play, None, 0),
        case("encoder unplugged, lasting", Fault::Unplugged { signal: Q, axis: 2 }, LASTING, stop, Some(Cause::NotMeasured), 3),
        case("encoder jumps for one frame", Fault::Offset { signal: Q, axis: 0, by: 0.02 }, 1, play, None, 0),
        case("encoder jumps and stays", Fault::Offset { signal: Q, axis: 0, by: 0.02 }, LASTING, fault, Some(Cause::Jump), 3),
        case("encoder jumps a tick of 0.1 mm", Fault::Offset { signal: Q, axis: 0, by: 1e-4 }, LASTING, play, None, 0),
        case("encoder sign wrong", Fault::Flip { signal: Q, axis: 1 }, LASTING, fault, Some(Cause::Jump), 3),
    ]
}

fn drive_cases() -> Vec<Case> {
    let (play, stop, fault) = (Phase::Position, Phase::SafeStop, Phase::Fault);
    let following = Some(Cause::Following);
    let mut glitch = own("emergency-stop line open for one frame", Own::Bits(status::STOPPED, 0), fault, Some(Cause::EmergencyStop), 0);
    glitch.periods = 1;
    vec![
        case("drive dead", Fault::DeadDrive { axis: 1 }, LASTING, stop, following, 40),
        case("drive gives no more than 20 N", Fault::WeakDrive { axis: 1, most: 20.0 }, LASTING, stop, following, 60),
        case("drive reversed", Fault::ReversedDrive { axis: 2 }, LASTING, stop, following, 40),
        case("one command lost", Fault::LostCommand, 1, play, None, 0),
        // Counted in commands: after the eleventh nobody sends any.
        case("commands lost, lasting", Fault::LostCommand, 11, fault, Some(Cause::Tripped), 12),
        own("a drive reports a fault", Own::Bits(0, 0b100), fault, Some(Cause::Drive), 0),
        own("emergency-stop line open", Own::Bits(status::STOPPED, 0), fault, Some(Cause::EmergencyStop), 0),
        glitch,
    ]
}

fn link_cases() -> Vec<Case> {
    let (play, stop, fault) = (Phase::Position, Phase::SafeStop, Phase::Fault);
    vec![
        case("one bit of a frame flipped, once", Fault::Corrupt { bit: 2000 }, 1, play, None, 0),
        case("garbage in shared memory, lasting", Fault::Corrupt { bit: 2000 }, LASTING, stop, Some(Cause::BrokenState), 3),
        case("driver of another layout", Fault::OtherLayout, LASTING, fault, Some(Cause::Layout), 0),
        case("a stranger's command accepted", Fault::OtherNonce { nonce: 77 }, LASTING, fault, Some(Cause::Foreign), 0),
        case("driver began anew", Fault::OtherNonce { nonce: 0 }, LASTING, fault, Some(Cause::Gone), 0),
        own("driver gone", Own::Gone, fault, Some(Cause::Gone), 0),
        case("driver's clock set an hour ahead", Fault::ClockStep { by_ns: HOUR_NS }, LASTING, stop, Some(Cause::BrokenState), 3),
        case("driver's clock stands", Fault::ClockStands, LASTING, stop, Some(Cause::Stale), 11),
        Case {
            faults: vec![Fault::ClockStands, Fault::Offset { signal: Q, axis: 0, by: 0.02 }],
            ..case("driver's clock stands and an encoder jumps", Fault::ClockStands, LASTING, fault, Some(Cause::Jump), 3)
        },
        case("8 frames late, then all at once", Fault::Drop, 8, play, None, 0),
        case("driver's clock set an hour back", Fault::ClockStep { by_ns: -HOUR_NS }, LASTING, stop, Some(Cause::Stale), 11),
    ]
}

fn loop_cases() -> Vec<Case> {
    let (play, stop) = (Phase::Position, Phase::SafeStop);
    let mut one_stall = own("loop stands still for 30 ms, once", Own::Stall(30_000_000), play, None, 0);
    let mut long_stall = own("loop stands still for 100 ms, once", Own::Stall(100_000_000), stop, Some(Cause::Stalled), 1);
    // By a clock that goes on meanwhile.
    let mut suspend = own("machine suspended for an hour", Own::Stall(HOUR_NS.unsigned_abs()), stop, Some(Cause::Stalled), 1);
    (one_stall.periods, long_stall.periods, suspend.periods) = (1, 1, 1);
    let mut silence = own("supervisor silent", Own::Silence, stop, Some(Cause::Supervisor), 201);
    silence.periods = 230;
    vec![
        own("every period takes 1.4 of its time", Own::Slow(7_000_000), stop, Some(Cause::Overruns), 12),
        own("one period in five takes 1.5 of its time", Own::Now(5), stop, Some(Cause::OverrunShare), 110),
        one_stall,
        long_stall,
        suspend,
        silence,
        own("controller answers with no number", Own::Controller, stop, Some(Cause::NotFinite), 0),
        own("reference leaps by 0.1 m", Own::Leap(0.1), stop, Some(Cause::Following), 1),
    ]
}

/// A controller that is none from a step on.
struct Sick {
    well: Box<dyn Running>,
    steps: u64,
}

impl Running for Sick {
    fn about(&self) -> &About {
        self.well.about()
    }

    fn step(&mut self, signals: &Signals<'_>, tau: &mut [f64]) -> Health {
        let health = self.well.step(signals, tau);
        self.steps = self.steps.saturating_sub(1);
        if self.steps == 0 {
            tau[1] = f64::NAN;
        }
        health
    }

    fn health(&self) -> Health {
        self.well.health()
    }

    fn reset(&mut self) {
        self.well.reset();
    }
}

/// A wave that leaps once.
struct Leaping {
    wave: rig::Wave,
    at: f64,
    by: f64,
}

impl Motion for Leaping {
    fn duration_s(&self) -> Option<f64> {
        None
    }

    fn at(&mut self, t: f64, wanted: &mut Wanted) {
        self.wave.at(t, wanted);
        if t > self.at {
            wanted.q[0] += self.by;
        }
    }
}

/// What came of a case.
struct Outcome {
    end: Phase,
    cause: Option<Cause>,
    /// Periods from the fault to the change of phase, and to the safe action at the robot; then both in time `[ns]`.
    noticed: Option<u64>,
    safe: Option<u64>,
    noticed_ns: u64,
    safe_ns: u64,
    /// How far a drive got from where it was wanted, and how fast, from the fault on `[m]`, `[m/s]`.
    excursion: f64,
    speed: f64,
    is_recovered: bool,
}

/// The whole HAL, without its faults.
fn inner<'a, 'c>(rig: &'a mut Rig<'c, Hal<'c, '_>>) -> &'a mut Guarded<'c> {
    rig.machine.hal_mut().inner.inner_mut()
}

fn begin<'c, 's>(case: &Case, script: &'s [Injection], clock: &'c ManualClock) -> Rig<'c, Hal<'c, 's>> {
    let robot = robot("prs3");
    let settings = settings(&robot);
    let hal = guarded(&robot, &settings, &[0.14, 0.15, 0.16], clock);
    let bits = if let Own::Bits(bits, drives) = case.own { Some((FAULT_AT, FAULT_AT + case.periods, bits, drives)) } else { None };
    let gone = if case.own == Own::Gone { FAULT_AT..FAULT_AT + LASTING } else { 0..0 };
    let hal = Status { inner: FaultyHal::new(hal, script), reads: 0, bits, gone };
    let mut rig = Rig::new(hal, robot, settings, clock);
    rig.periods(3);
    rig.arm().expect("it is ready");
    rig.until(Phase::Holding, 500);
    rig.periods(150);
    let mut centre = [0.0; MAX_AXES];
    centre[..3].fill(0.15);
    let wave = rig::Wave { centre, height: 0.05, length: None };
    let begun = rig.machine.counts().periods;
    // The fault comes so many periods later, and the motion's own time begins with it.
    let until = (FAULT_AT - begun) as f64 * 0.005;
    let by = if let Own::Leap(by) = case.own { by } else { 0.0 };
    let motion: Option<Box<dyn Motion>> = Some(Box::new(Leaping { wave, at: until, by }));
    let is_sick = case.own == Own::Controller;
    let sick = || -> Box<dyn Running> { Box::new(Sick { well: controller(&rig.robot), steps: FAULT_AT - begun + 1 }) };
    let run = is_sick.then(sick);
    let hold = is_sick.then(|| controller(&rig.robot));
    rig.order(Order { motion, controller: run, hold, ..Order::plain(OrderKind::Start, 0) }).expect("it holds");
    let left = FAULT_AT - rig.machine.counts().periods;
    rig.periods(usize::try_from(left).expect("a count"));
    assert_eq!((rig.machine.phase(), rig.machine.counts().periods), (Phase::Position, FAULT_AT), "{}", case.name);
    rig
}

fn outcome(case: &Case) -> Outcome {
    let clock = ManualClock::new(1_000_000_000);
    let script: Vec<Injection> =
        case.faults.iter().map(|&fault| Injection { from: FAULT_AT, to: FAULT_AT + case.periods, fault }).collect();
    // Drives count commands, not reads: the first three periods send none, opening the session takes one.
    let commands = |injection: &Injection| {
        matches!(injection.fault, Fault::DeadDrive { .. } | Fault::WeakDrive { .. } | Fault::ReversedDrive { .. } | Fault::LostCommand)
    };
    let script: Vec<Injection> =
        script.into_iter().map(|i| if commands(&i) { Injection { from: i.from - 3, to: i.to - 3, ..i } } else { i }).collect();
    let mut rig = begin(case, &script, &clock);
    let (before, start_ns) = (rig.transitions.len(), rig.grid.beat().planned_ns);
    let mut out = Outcome {
        end: Phase::Off,
        cause: None,
        noticed: None,
        safe: None,
        noticed_ns: 0,
        safe_ns: 0,
        excursion: 0.0,
        speed: 0.0,
        is_recovered: false,
    };
    let total = case.periods.max(LASTING) + 100;
    for period in 0..total {
        let is_on = period < case.periods;
        rig.is_supervised = !(is_on && case.own == Own::Silence);
        let (late, busy) = match case.own {
            Own::Slow(busy) if is_on => (0, busy),
            Own::Now(every) if is_on && period % every == 0 => (0, 7_500_000),
            Own::Stall(late) if is_on => (late, 0),
            _ => (0, 0),
        };
        rig.period_of(late, busy);
        rig.collect();
        // The robot's side lives on by itself.
        let _ = inner(&mut rig).read();
        let has_changed = rig.transitions.len() > before;
        if out.noticed.is_none() && has_changed {
            (out.noticed, out.noticed_ns) = (Some(period), rig.last().done_ns - start_ns + PERIOD_NS);
        }
        let is_safe = rig.last().flags & (flags::SAFE | flags::COMMANDED) == flags::SAFE | flags::COMMANDED;
        let has_tripped = inner(&mut rig).trip().is_some();
        if out.safe.is_none() && has_changed && (is_safe || has_tripped) {
            (out.safe, out.safe_ns) = (Some(period), rig.last().done_ns - start_ns + PERIOD_NS);
        }
        let wanted = rig.last().q_ref;
        let plant = inner(&mut rig).inner_mut().inner_mut().inner_mut().plant();
        let off = plant.position().iter().zip(&wanted).map(|(q, want)| (q - want).abs());
        let speed = plant.velocity().iter().map(|v| v.abs()).fold(0.0, f64::max);
        // A leap is the reference's own.
        out.excursion = off.filter(|_| !matches!(case.own, Own::Leap(_))).fold(out.excursion, f64::max);
        out.speed = out.speed.max(speed);
    }
    out.end = rig.machine.phase();
    out.cause = rig.transitions.get(before).map(|t| t.cause);
    out.is_recovered = recovers(&mut rig);
    assert!(rig.records.iter().all(|r| r.command.tau.iter().all(|x| x.is_finite())), "{}", case.name);
    out
}

/// Whether orders bring the robot back, once the fault is over; what was never stopped has nothing to come back from.
fn recovers<'c>(rig: &mut Rig<'c, Hal<'c, '_>>) -> bool {
    rig.is_supervised = true;
    // What a fault has moved comes to rest.
    rig.periods(300);
    if rig.machine.phase() == Phase::Position {
        return true;
    }
    let before = inner(rig).inner_mut().inner_mut().inner_mut().plant().position().to_vec();
    if rig.plain(OrderKind::ClearFault).is_err() {
        return false;
    }
    rig.periods(20);
    // Clearing moves nothing by itself.
    let after = inner(rig).inner_mut().inner_mut().inner_mut().plant().position().to_vec();
    assert!(before.iter().zip(&after).all(|(a, b)| (a - b).abs() < 0.02), "cleared, not let go: {before:?} {after:?}");
    if rig.arm().is_err() {
        return false;
    }
    for _ in 0..1500 {
        rig.periods(1);
        if rig.machine.phase() == Phase::Holding {
            return true;
        }
    }
    false
}

fn row(case: &Case, out: &Outcome) -> String {
    let after = |n: Option<u64>, ns: u64| n.map_or_else(|| "-".to_string(), |_| format!("{} ms", ns / 1_000_000));
    let cause = out.cause.map_or("-", |cause| cause.name());
    let excursion = if matches!(case.own, Own::Leap(_)) { "-".to_string() } else { format!("{:.1} mm", 1e3 * out.excursion) };
    let is_recovered = if out.is_recovered { "yes" } else { "no" };
    format!(
        "| {} | {} | {cause} | {} | {} | {excursion} | {:.2} m/s | {is_recovered} |",
        case.name,
        out.end.name(),
        after(out.noticed, out.noticed_ns),
        after(out.safe, out.safe_ns),
        out.speed
    )
}

/// The parts of a row that must be what they were: all but excursion and speed, which follow from the robot's numbers.
fn states(row: &str) -> String {
    let cells: Vec<&str> = row.split('|').map(str::trim).collect();
    [1, 2, 3, 4, 5, 8].iter().filter_map(|&i| cells.get(i).copied()).collect::<Vec<_>>().join(" | ")
}

const BEGIN: &str = "<!-- table: tests/daemon_faults.rs -->\n";

const HEAD: &str = "\
| fault | ends in | cause | noticed within | safe output within | farthest from the reference | fastest | recovered |
|---|---|---|---|---|---|---|---|
";

#[test]
fn every_fault_ends_as_the_table_says() {
    let mut table = String::from(HEAD);
    let mut wrong = Vec::new();
    let cases = [sensor_cases(), drive_cases(), link_cases(), loop_cases()];
    for case in cases.iter().flatten() {
        let out = outcome(case);
        let is_within = out.noticed.is_none_or(|noticed| noticed <= case.within);
        if (out.end, out.cause) != (case.end, case.cause) || !is_within || !out.is_recovered {
            wrong.push(format!("{}: {:?} {:?} after {:?}", case.name, out.end, out.cause, out.noticed));
        }
        // The loop's safe action is sent in the period in which something is noticed; the robot's own follows when the last command has
        // expired, which the loop makes soon unless nothing passes any more.
        let most = match out.end {
            Phase::SafeStop => 1,
            _ if case.own == Own::Gone => 11,
            _ => 2,
        };
        if out.noticed.is_some() && out.safe.is_none_or(|safe| safe > out.noticed.unwrap_or(0) + most) {
            wrong.push(format!("{}: safe after {:?}, noticed after {:?}", case.name, out.safe, out.noticed));
        }
        writeln!(table, "{}", row(case, &out)).unwrap();
    }
    assert!(wrong.is_empty(), "{}\n{table}", wrong.join("\n"));
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs/FAULTS.md");
    let text = std::fs::read_to_string(&path).expect("docs/FAULTS.md");
    let (head, committed) = text.split_once(BEGIN).expect("the table has its mark");
    if std::env::var_os("PKM_WRITE_FAULTS").is_some() {
        std::fs::write(&path, format!("{head}{BEGIN}{table}")).expect("docs/FAULTS.md");
        return;
    }
    let [want, got] = [committed, table.as_str()].map(|t| t.lines().map(states).collect::<Vec<_>>());
    assert_eq!(got, want, "docs/FAULTS.md says otherwise");
}

#[test]
fn a_loop_that_panics_sends_the_safe_action_and_says_so() {
    struct Bomb(Box<dyn Running>, u32);
    impl Running for Bomb {
        fn about(&self) -> &About {
            self.0.about()
        }
        fn step(&mut self, signals: &Signals<'_>, tau: &mut [f64]) -> Health {
            self.1 -= 1;
            assert!(self.1 > 0, "on purpose");
            self.0.step(signals, tau)
        }
        fn health(&self) -> Health {
            self.0.health()
        }
        fn reset(&mut self) {}
    }
    struct Paced<'c>(&'c ManualClock);
    impl Clock for Paced<'_> {
        fn now_ns(&self) -> u64 {
            self.0.now_ns()
        }
    }
    impl pkm_daemon::runner::Pace for Paced<'_> {
        fn sleep_until(&self, at_ns: u64) {
            self.0.advance(at_ns.saturating_sub(self.0.now_ns()));
        }
    }
    let clock = ManualClock::new(0);
    let mut rig = rig::rig(&[], &clock);
    rig.periods(3);
    let bomb: Box<dyn Running> = Box::new(Bomb(controller(&rig.robot), 100));
    rig.order(Order { nonce: 9, controller: Some(bomb), ..Order::plain(OrderKind::Arm, 0) }).expect("it is ready");
    let stop = core::sync::atomic::AtomicBool::new(false);
    // The supervisor's time does not pass here; a tenth of a second is less than it may be silent.
    let outcome = pkm_daemon::runner::run(&mut rig.machine, &Paced(&clock), PERIOD_NS, &stop, &mut |_| {});
    assert_eq!(outcome, Err(pkm_daemon::runner::Failed));
    assert_eq!(rig.machine.phase(), Phase::Fault);
    rig.collect();
    let last = rig.transitions.last().copied().expect("it was told");
    assert_eq!((last.to, last.cause), (Phase::Fault, Cause::Internal));
    let hal = rig.machine.hal_mut().inner_mut();
    let before = hal.read().expect("a state").command_sequence;
    assert!(before > 90, "the safe command came after the last one: {before}");
    clock.advance(60_000_000);
    let _ = hal.read();
    assert!(hal.trip().is_some(), "and expires");
}

/// A controller that pushes outwards from beyond an end: the limits lead back without throwing efforts to and fro.
#[test]
fn outside_an_end_the_limits_lead_back_and_efforts_do_not_flip() {
    for (start, push) in [([0.31; 3], 700.0), ([-0.01; 3], -300.0)] {
        let clock = ManualClock::new(1_000_000_000);
        let robot = robot("prs3");
        let settings = settings(&robot);
        let mut hal = guarded(&robot, &settings, &start, &clock);
        let (mut flips, mut peak, mut before) = ([0; 3], 0.0_f64, [0.0; 3]);
        for sequence in 1..=400 {
            clock.advance(PERIOD_NS);
            let state = hal.read().expect("the robot is there");
            let mode = if sequence == 1 { pkm_hal::Mode::Arm } else { pkm_hal::Mode::Effort };
            let now_ns = clock.now_ns();
            let mut command =
                CommandFrame { nonce: 7, sequence, stamp_ns: now_ns, valid_until_ns: now_ns + 50_000_000, ..CommandFrame::new(3, mode) };
            if sequence > 1 {
                command.tau[..3].fill(push);
            }
            command.state_sequence = state.sequence;
            hal.write(&command.sealed()).expect("it is admitted");
            let sent = *hal.sent().expect("it knows");
            for k in 0..3 {
                // Less than a tenth of the weight is no throw.
                flips[k] += u32::from(sent[k] * before[k] < 0.0 && (sent[k] - before[k]).abs() > 20.0);
                before[k] = sent[k];
                peak = peak.max(sent[k].abs());
            }
        }
        let q = hal.read().expect("the robot is there").q;
        // Back to within a centimetre of the end it began beyond, and standing there.
        let end = if push > 0.0 { 0.3 } else { 0.0 };
        assert!(flips.iter().all(|n| *n <= 3), "from {start:?}: {flips:?} flips in 400 periods, up to {peak} N");
        assert!((0..3).all(|k| (q[k] - end) * push.signum() < 0.02), "from {start:?}: {q:?}");
        assert!(hal.trip().is_none());
    }
}
