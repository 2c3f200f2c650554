//! Faults while a law of contact runs, the robot's foot plate being held by a limb: the second table of docs/FAULTS.md.
//!
//! With `PKM_WRITE_FAULTS=1` the table is written anew. Otherwise what stands there must be what happens.

#[allow(dead_code, reason = "shared: no test uses all of it")]
#[path = "daemon/rig.rs"]
mod rig;

#[path = "daemon/limb.rs"]
mod limb;

use core::fmt::Write as _;
use std::path::PathBuf;

use limb::{LIMB, robot};
use pkm_daemon::config::Settings;
use pkm_daemon::{Order, OrderKind};
use pkm_hal::cycle::flags;
use pkm_hal::{Backend, Cause, Fault, FaultyHal, Injection, ManualClock, Phase, Signal};
use rig::{Guarded, Rig, controller};

/// Reads until a fault begins: the law of contact has run for a while.
const FAULT_AT: u64 = 700;

const PERIOD_NS: u64 = 5_000_000;

/// How long a lasting fault lasts, in periods.
const LASTING: u64 = 150;

/// Largest force of the environment `[N]`; its moment is not limited.
const LIMIT: f64 = 300.0;

/// A measured force moves the plate as it would move 40 kg on a spring.
const LAW: &str = "\
law = \"admittance\"
rate_hz = 200.0
mass = [40.0, 4.0, 4.0]
damping = [800.0, 80.0, 80.0]
stiffness = [4000.0, 400.0, 400.0]
travel = [0.04, 0.1, 0.1]
speed = [0.2, 0.5, 0.5]
[task]
kind = \"platform\"
link = \"platform\"
components = [\"z\", \"rx\", \"ry\"]
length = 0.3
[inner]
law = \"computed_torque\"
bandwidth = 20.0
[inner.observer]
kind = \"commanded_acceleration\"
bandwidth = 60.0
[limits]
dt_limit = inf
";

/// A row: a fault or a push, how many periods it lasts, and what must come of it.
struct Case {
    name: &'static str,
    fault: Option<Fault>,
    /// A push of the limb's owner, upwards `[N]`.
    push: f64,
    periods: u64,
    end: Phase,
    cause: Option<Cause>,
    /// Most periods until it is noticed.
    within: u64,
}

fn fault(name: &'static str, fault: Fault, periods: u64, end: Phase, cause: Option<Cause>, within: u64) -> Case {
    Case { name, fault: Some(fault), push: 0.0, periods, end, cause, within }
}

fn push(name: &'static str, push: f64, end: Phase, cause: Option<Cause>, within: u64) -> Case {
    Case { name, fault: None, push, periods: LASTING, end, cause, within }
}

fn cases() -> Vec<Case> {
    let (run, stop, faulty) = (Phase::Force, Phase::SafeStop, Phase::Fault);
    let cell = |axis| (Signal::Sensor, axis);
    let (signal, axis) = cell(2);
    let q = Signal::Position;
    vec![
        push("the limb pushes with 100 N", 100.0, run, None, 0),
        // The push comes within 10 ms; two periods after it is over the limit.
        push("the limb pushes with 600 N, limit 300 N", 600.0, stop, Some(Cause::Wrench), 4),
        fault("force not a number, one frame", Fault::NotANumber { signal, axis }, 1, run, None, 0),
        fault("force not a number, lasting", Fault::NotANumber { signal, axis }, LASTING, stop, Some(Cause::BrokenState), 3),
        fault("force cell unplugged, one frame", Fault::Unplugged { signal, axis }, 1, stop, Some(Cause::NotMeasured), 0),
        fault("force cell unplugged, lasting", Fault::Unplugged { signal, axis }, LASTING, stop, Some(Cause::NotMeasured), 0),
        fault("force cell stuck", Fault::Stuck { signal, axis }, LASTING, run, None, 0),
        fault("force cell off by 100 N", Fault::Offset { signal, axis, by: 100.0 }, LASTING, run, None, 0),
        fault("force cell off by 400 N", Fault::Offset { signal, axis, by: 400.0 }, LASTING, stop, Some(Cause::Wrench), 0),
        fault(
            "force cell drifts, 600 N/s",
            Fault::Drift { signal, axis, per_s: 600.0, since_ns: FAULT_AT * PERIOD_NS },
            LASTING,
            stop,
            Some(Cause::Wrench),
            // Half a second to the limit, and the weight that the limb's own force holds against it.
            115,
        ),
        fault("force cell of the wrong sign", Fault::Flip { signal, axis }, LASTING, run, None, 0),
        fault("states frozen (no new frame), lasting", Fault::Drop, LASTING, stop, Some(Cause::Stale), 11),
        fault("5 frames dropped", Fault::Drop, 5, run, None, 0),
        fault("encoder unplugged, lasting", Fault::Unplugged { signal: q, axis: 2 }, LASTING, stop, Some(Cause::NotMeasured), 3),
        fault("encoder jumps and stays", Fault::Offset { signal: q, axis: 0, by: 0.02 }, LASTING, faulty, Some(Cause::Jump), 3),
    ]
}

/// The robot with its limb, and a push `[N]` for as long as a fault lasts.
fn guarded<'c>(case: &Case, settings: &Settings, clock: &'c ManualClock) -> Guarded<'c> {
    let [from, to] = [FAULT_AT, FAULT_AT + case.periods].map(|n| n as f64 * 1e-9 * PERIOD_NS as f64);
    let push = format!(
        "\n[[effect]]\nname = \"external_force\"\nwhere = [\"platform\"]\nparameters = {{ start = {from}, end = {to}, fz = {:?} }}\n",
        case.push
    );
    limb::guarded(&robot(&format!("{LIMB}{push}")), settings, clock)
}

type Hal<'c, 's> = FaultyHal<'s, Guarded<'c>>;

/// The law of contact, at rest.
fn start<B: Backend>(rig: &mut Rig<'_, B>) {
    let run = pkm_ctrl::config::parse(LAW, "contact.toml", &rig.robot).expect("a law");
    let hold = Some(controller(&rig.robot));
    let order = Order { controller: Some(run), hold, phase: Phase::Force, ..Order::plain(OrderKind::Start, 0) };
    rig.order(order).expect("it holds");
}

/// What came of a case.
#[derive(Default)]
struct Outcome {
    end: Option<Phase>,
    cause: Option<Cause>,
    /// Periods from the fault to the change of phase, and to the safe action at the robot.
    noticed: Option<u64>,
    safe: Option<u64>,
    /// How far a drive moved `[m]`, how fast `[m/s]`, and the largest force between plate and limb `[N]`, from the fault on.
    way: f64,
    speed: f64,
    force: f64,
    is_recovered: bool,
    /// Where the way back ended, in words.
    told: String,
}

fn outcome(case: &Case) -> Outcome {
    let clock = ManualClock::new(0);
    let robot = robot("");
    let settings = limb::settings(&robot, LIMIT);
    let script: Vec<Injection> = case.fault.iter().map(|&fault| Injection { from: FAULT_AT, to: FAULT_AT + case.periods, fault }).collect();
    let hal = FaultyHal::new(guarded(case, &settings, &clock), &script);
    let mut rig: Rig<'_, Hal<'_, '_>> = Rig::new(hal, robot, settings, &clock);
    rig.periods(3);
    rig.arm().expect("it is ready");
    rig.until(Phase::Holding, 400);
    rig.periods(120);
    start(&mut rig);
    let left = FAULT_AT - rig.machine.counts().periods;
    rig.periods(usize::try_from(left).expect("a count"));
    assert_eq!((rig.machine.phase(), rig.machine.counts().periods), (Phase::Force, FAULT_AT), "{}", case.name);
    let before = rig.transitions.len();
    let here = rig.last().state.q;
    let mut out = Outcome::default();
    for period in 0..LASTING + 100 {
        rig.periods(1);
        // The robot's side lives on by itself.
        let hal = rig.machine.hal_mut().inner_mut();
        let _ = hal.read();
        let has_tripped = hal.trip().is_some();
        let plant = hal.inner_mut().inner_mut().inner_mut().plant();
        let way = plant.position().iter().zip(&here).map(|(q, here)| (q - here).abs());
        out.way = way.fold(out.way, f64::max);
        out.speed = plant.velocity().iter().map(|v| v.abs()).fold(out.speed, f64::max);
        let state = &hal.read().map_or(rig.last().state, |state| state);
        out.force = out.force.max(state.sensor[..3].iter().map(|x| x * x).sum::<f64>().sqrt());
        let has_changed = rig.transitions.len() > before;
        if has_changed {
            out.noticed.get_or_insert(period);
        }
        let is_safe = rig.last().flags & (flags::SAFE | flags::COMMANDED) == flags::SAFE | flags::COMMANDED;
        if has_changed && (is_safe || has_tripped) {
            out.safe.get_or_insert(period);
        }
    }
    out.end = Some(rig.machine.phase());
    out.cause = rig.transitions.get(before).map(|t| t.cause);
    out.is_recovered = recovers(&mut rig);
    out.told = format!("{:?}", rig.transitions.iter().rev().take(4).map(|t| (t.to, t.cause, t.value)).collect::<Vec<_>>());
    assert!(rig.records.iter().all(|r| r.command.tau.iter().all(|x| x.is_finite())), "{}", case.name);
    out
}

/// Whether orders bring the robot back to the law of contact, once the fault is over; what was never stopped has nothing to come back from.
fn recovers(rig: &mut Rig<'_, Hal<'_, '_>>) -> bool {
    rig.periods(100);
    if rig.machine.phase() == Phase::Force {
        return true;
    }
    if rig.plain(OrderKind::ClearFault).is_err() || rig.arm().is_err() {
        return false;
    }
    for _ in 0..1500 {
        rig.periods(1);
        if rig.machine.phase() == Phase::Holding {
            start(rig);
            rig.periods(50);
            return rig.machine.phase() == Phase::Force;
        }
    }
    false
}

fn row(case: &Case, out: &Outcome) -> String {
    let after = |n: Option<u64>| n.map_or_else(|| "-".to_string(), |n| format!("{} ms", (n + 1) * PERIOD_NS / 1_000_000));
    let (end, cause) = (out.end.map_or("-", Phase::name), out.cause.map_or("-", |cause| cause.name()));
    let is_recovered = if out.is_recovered { "yes" } else { "no" };
    format!(
        "| {} | {end} | {cause} | {} | {} | {:.1} mm | {:.2} m/s | {:.0} N | {is_recovered} |",
        case.name,
        after(out.noticed),
        after(out.safe),
        1e3 * out.way,
        out.speed,
        out.force
    )
}

/// The parts of a row that must be what they were: all but way, speed and force, which follow from the robot's numbers.
fn states(row: &str) -> String {
    let cells: Vec<&str> = row.split('|').map(str::trim).collect();
    [1, 2, 3, 4, 5, 9].iter().filter_map(|&i| cells.get(i).copied()).collect::<Vec<_>>().join(" | ")
}

const MARKS: [&str; 2] = ["<!-- table: tests/daemon_contact_faults.rs -->\n", "<!-- end of table -->\n"];

const HEAD: &str = "\
| fault | ends in | cause | noticed within | safe output within | farthest from where it was | fastest | largest force measured | recovered |
|---|---|---|---|---|---|---|---|---|
";

#[test]
fn every_fault_in_contact_ends_as_the_table_says() {
    let mut table = String::from(HEAD);
    let mut wrong = Vec::new();
    for case in &cases() {
        let out = outcome(case);
        let is_within = out.noticed.is_none_or(|noticed| noticed <= case.within);
        if (out.end, out.cause) != (Some(case.end), case.cause) || !is_within || !out.is_recovered {
            wrong.push(format!(
                "{}: {:?} {:?} after {:?}, back {}: {}",
                case.name, out.end, out.cause, out.noticed, out.is_recovered, out.told
            ));
        }
        // In the same period by the loop itself, or when its last command has expired by the robot's side.
        let most = if case.end == Phase::SafeStop { 1 } else { 11 };
        if out.noticed.is_some_and(|noticed| out.safe.is_none_or(|safe| safe > noticed + most)) {
            wrong.push(format!("{}: safe after {:?}, noticed after {:?}", case.name, out.safe, out.noticed));
        }
        writeln!(table, "{}", row(case, &out)).expect("a string takes all");
    }
    assert!(wrong.is_empty(), "{}\n{table}", wrong.join("\n"));
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs/FAULTS.md");
    let text = std::fs::read_to_string(&path).expect("docs/FAULTS.md");
    let (head, rest) = text.split_once(MARKS[0]).expect("the table has its mark");
    let (committed, tail) = rest.split_once(MARKS[1]).expect("and its end");
    if std::env::var_os("PKM_WRITE_FAULTS").is_some() {
        std::fs::write(&path, format!("{head}{}{table}{}{tail}", MARKS[0], MARKS[1])).expect("docs/FAULTS.md");
        return;
    }
    let [want, got] = [committed, table.as_str()].map(|t| t.lines().map(states).collect::<Vec<_>>());
    assert_eq!(got, want, "docs/FAULTS.md says otherwise");
}
