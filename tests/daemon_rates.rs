//! The daemon's loop at the slowest and the fastest rate it takes: against a clock that is told every period is counted and none is skipped,
//! against the machine's the grid stays where it is, however late the machine is.
#![cfg(target_os = "linux")]

#[allow(dead_code, reason = "shared: no test uses all of it")]
#[path = "daemon/rig.rs"]
mod rig;

use core::cell::{Cell, RefCell};
use core::sync::atomic::{AtomicBool, Ordering};

use pkm_daemon::config::{DaemonConfig, Settings};
use pkm_daemon::machine::{Counts, Machine, Parts};
use pkm_daemon::runner::{Pace, run};
use pkm_daemon::supervisor::{Lines, LoopEnds, lines};
use pkm_daemon::weigher::Weigher;
use pkm_daemon::{Order, OrderKind};
use pkm_dyn::effects::Robot;
use pkm_hal::cycle::flags;
use pkm_hal::{Clock, CycleRecord, CycleSink, ManualClock, Phase, SystemClock};
use rig::{CONFIG, CONTROLLER, Wave, robot};

const RATES_HZ: [u32; 2] = [100, 4000];

/// A clock that moves as far as somebody sleeps by it, and oversleeps at some moments.
struct Told<'c> {
    clock: &'c ManualClock,
    /// Which sleep is how much too long `[ns]`.
    late: &'c [(u64, u64)],
    sleeps: Cell<u64>,
}

impl Clock for Told<'_> {
    fn now_ns(&self) -> u64 {
        self.clock.now_ns()
    }
}

impl Pace for Told<'_> {
    fn sleep_until(&self, at_ns: u64) {
        let more: u64 = self.late.iter().filter(|(sleep, _)| *sleep == self.sleeps.get()).map(|(_, ns)| ns).sum();
        self.clock.advance(at_ns.saturating_sub(self.clock.now_ns()) + more);
        self.sleeps.set(self.sleeps.get() + 1);
    }
}

/// Keeps every record.
struct Kept<'r>(&'r RefCell<Vec<CycleRecord>>);

impl CycleSink for Kept<'_> {
    fn put(&mut self, record: &CycleRecord) {
        self.0.borrow_mut().push(*record);
    }
}

/// Numbers of the example at another rate; time that is lost stops nothing where `is_patient`.
fn settings(robot: &Robot, rate_hz: u32, is_patient: bool) -> Settings {
    let patience = "stall_s = 60.0\nsupervisor_s = 60.0\nconsecutive_overruns = 1e6\noverrun_share = 1.0";
    let text = if is_patient {
        CONFIG
            .replace("stall_s      = 0.05", patience)
            .replace("valid_for_s = 0.05", "valid_for_s = 1.0")
            .replace("stale_s     = 0.05", "stale_s = 0.9")
            .replace("[limits]", "[limits]\nfollowing = 1.0\njump = 1.0\nstuck = 1.0")
    } else {
        CONFIG.to_string()
    };
    let config = DaemonConfig::parse(&text, "daemon.toml").expect("the example");
    config.settings(&robot.model, f64::from(rate_hz)).expect("the example fits")
}

/// Runs a loop until `is_over` of what it has recorded, armed as soon as it may be and started when it holds.
fn looped<P: Pace>(
    pace: &P,
    hal: impl pkm_hal::Backend,
    rate_hz: u32,
    settings: &Settings,
    is_over: impl Fn(&[CycleRecord]) -> bool,
) -> Ran {
    let robot = robot("prs3");
    let controller = || {
        let text = CONTROLLER.replace("rate_hz = 200.0", &format!("rate_hz = {rate_hz}.0"));
        assert_ne!(text, CONTROLLER, "the example's rate stands there");
        Some(pkm_ctrl::config::parse(&text, "controller.toml", &robot).expect("the example's controller"))
    };
    let (Lines { mut orders, answers: _answers, transitions: _transitions, heartbeat, .. }, ends) = lines(());
    let LoopEnds { orders: taken, answers, transitions, heartbeat: seen } = ends;
    let (weigher, limits, records) = (Weigher::new(robot.model.clone()), settings.limits.clone(), RefCell::new(Vec::new()));
    let sink = Kept(&records);
    let parts = Parts { hal, sink, weigher, wrench: None, limits, orders: taken, answers, transitions, heartbeat: seen };
    let mut machine = Machine::new(parts);
    let stop = AtomicBool::new(false);
    let mut given = 0;
    heartbeat.store(pace.now_ns(), Ordering::Relaxed);
    let mut each = |_| {
        heartbeat.store(pace.now_ns(), Ordering::Relaxed);
        let records = records.borrow();
        let phase = records.last().map_or(0, |record| record.phase);
        if given == 0 && phase == Phase::Ready.code() {
            given = 1;
            orders.push(Order { nonce: 7, controller: controller(), ..Order::plain(OrderKind::Arm, 1) }).expect("room");
        } else if given == 1 && phase == Phase::Holding.code() {
            given = 2;
            let centre = [0.15; pkm_hal::MAX_AXES];
            let motion = Some(Box::new(Wave { centre, height: 0.02, length: None }) as Box<dyn pkm_daemon::Motion>);
            orders.push(Order { motion, ..Order::plain(OrderKind::Start, 2) }).expect("room");
        }
        if is_over(&records) {
            stop.store(true, Ordering::Relaxed);
        }
    };
    run(&mut machine, pace, settings.limits.period_ns, &stop, &mut each).expect("it does not fail");
    let counts = *machine.counts();
    drop(machine);
    Ran { records: records.into_inner(), counts }
}

struct Ran {
    records: Vec<CycleRecord>,
    counts: Counts,
}

/// What holds for every loop on every machine: times of a grid, none twice, none before its time, each begun within its own period.
fn is_on_the_grid(ran: &Ran, period_ns: u64) {
    let Ran { records, counts } = ran;
    for record in records {
        let late_ns = record.woken_ns.checked_sub(record.planned_ns).expect("not before its time");
        assert!(late_ns < period_ns, "period {} begins {late_ns} ns late: in another one", record.cycle);
        let periods = (1 + record.skipped).min(5);
        assert_eq!(record.dt[0].to_bits(), (period_ns as f64 * 1e-9 * periods as f64).to_bits(), "period {}", record.cycle);
    }
    for pair in records.windows(2) {
        let (step, is_overrun) = (1 + pair[1].skipped, pair[1].flags & flags::OVERRUN != 0);
        assert_eq!((pair[1].cycle - pair[0].cycle, pair[1].planned_ns - pair[0].planned_ns), (step, step * period_ns));
        // Who was done too late is told so, and begins no period that has begun already.
        assert!(is_overrun || pair[0].done_ns <= pair[0].planned_ns + period_ns, "period {}", pair[0].cycle);
        assert!(!is_overrun || pair[1].skipped > 0, "period {}", pair[1].cycle);
    }
    let sums = records.iter().fold((0, 0), |(skipped, late), r| (skipped + r.skipped, late + u64::from(r.flags & flags::OVERRUN != 0)));
    assert_eq!((counts.periods, counts.skipped, counts.overruns), (records.len() as u64, sums.0, sums.1));
}

#[test]
fn against_a_clock_that_is_told_every_period_is_counted_and_none_is_skipped() {
    for rate_hz in RATES_HZ {
        let clock = ManualClock::new(5_000_000_000);
        let robot = robot("prs3");
        let settings = settings(&robot, rate_hz, false);
        let (period_ns, periods) = (1_000_000_000 / u64::from(rate_hz), 4 * u64::from(rate_hz));
        assert_eq!(settings.limits.period_ns, period_ns);
        let hal = rig::guarded(&robot, &settings, &[0.14, 0.15, 0.16], &clock);
        let pace = Told { clock: &clock, late: &[], sleeps: Cell::new(0) };
        let ran = looped(&pace, hal, rate_hz, &settings, |records| records.len() as u64 == periods);
        is_on_the_grid(&ran, period_ns);
        assert_eq!(ran.counts, Counts { periods, skipped: 0, overruns: 0 }, "{rate_hz} Hz");
        assert_eq!(clock.now_ns(), 5_000_000_000 + 4_000_000_000, "{rate_hz} Hz");
        // It did what it was for: at home, then along the wave, closely.
        let played: Vec<_> = ran.records.iter().filter(|r| r.phase == Phase::Position.code()).collect();
        assert!(played.len() as u64 > u64::from(rate_hz), "{} periods", played.len());
        let error = |r: &CycleRecord| (0..3).map(|k| (r.q_ref[k] - r.state.q[k]).abs()).fold(0.0, f64::max);
        let worst = played.iter().skip(rate_hz as usize / 2).map(|r| error(r)).fold(0.0, f64::max);
        assert!(worst < 1e-3, "{worst} m at {rate_hz} Hz");
    }
}

#[test]
fn time_that_is_lost_at_4_khz_is_counted_to_the_period_and_never_made_up_for() {
    let clock = ManualClock::new(0);
    let robot = robot("prs3");
    let settings = settings(&robot, 4000, true);
    let hal = rig::guarded(&robot, &settings, &[0.14, 0.15, 0.16], &clock);
    // Woken 0.1 ms late: in its own period. 0.25 ms: the next one. 1.1 ms: four are gone. 60 ms: 240.
    let late = [(100, 100_000), (200, 250_000), (300, 1_100_000), (400, 60_000_000)];
    let pace = Told { clock: &clock, late: &late, sleeps: Cell::new(0) };
    let ran = looped(&pace, hal, 4000, &settings, |records| records.len() == 1000);
    is_on_the_grid(&ran, 250_000);
    assert_eq!(ran.counts, Counts { periods: 1000, skipped: 1 + 4 + 240, overruns: 0 });
    let lost: Vec<_> = ran.records.iter().enumerate().filter(|(_, r)| r.skipped > 0).map(|(i, r)| (i, r.skipped)).collect();
    assert_eq!(lost, [(200, 1), (300, 4), (400, 240)]);
    assert_eq!(clock.now_ns(), (1000 + 245) * 250_000);
}

#[test]
fn on_this_machine_at_4_khz_the_grid_is_kept_however_late_it_is() {
    const LENGTH_NS: u64 = 1_500_000_000;
    let robot = robot("prs3");
    let settings = settings(&robot, 4000, true);
    let hal = rig::guarded(&robot, &settings, &[0.14, 0.15, 0.16], SystemClock);
    let begin_ns = SystemClock.now_ns();
    let ran = looped(&SystemClock, hal, 4000, &settings, |records| records.len() > 1 && SystemClock.now_ns() - begin_ns > LENGTH_NS);
    is_on_the_grid(&ran, 250_000);
    let [first, last] = [&ran.records[0], &ran.records[ran.records.len() - 1]];
    // What was run and what was skipped are all the periods there were.
    let passed = ran.counts.periods + ran.counts.skipped - first.skipped;
    assert_eq!(last.planned_ns - first.planned_ns, (passed - 1) * 250_000);
    assert!(last.done_ns > begin_ns, "by the clock of this machine");
}
