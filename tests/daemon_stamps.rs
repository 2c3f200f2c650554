//! Speed is way over the time that stamps say: a driver that was kept waiting trips nothing when it goes on, and no stamp hides a jump.

#[allow(dead_code, reason = "shared: no test uses all of it")]
#[path = "daemon/rig.rs"]
mod rig;

use pkm_daemon::config::DaemonConfig;
use pkm_daemon::{Motion, Order, OrderKind};
use pkm_hal::cycle::flags;
use pkm_hal::{Backend, Cause, CommandFrame, CycleRecord, Fault, FaultyHal, HalError, Injection, MAX_AXES, ManualClock, Phase, StateFrame};
use rig::{CONFIG, Guarded, Rig, Wave, guarded, robot, settings};

const PERIOD_S: f64 = 0.005;

/// What a driver makes of a state, and of the one it showed last.
type Spoil = fn(&mut StateFrame, &StateFrame);

/// A robot whose driver's process gets no time for some reads: nothing of it runs, and what it showed last stays.
struct Held<B> {
    inner: B,
    /// Reads for which it is still held.
    left: u64,
    is_held: bool,
    shown: Option<StateFrame>,
    /// The newest command, which it takes when it runs again.
    waiting: Option<CommandFrame>,
    spoil: Option<Spoil>,
}

impl<B: Backend> Backend for Held<B> {
    fn n_axes(&self) -> usize {
        self.inner.n_axes()
    }

    fn n_sensors(&self) -> usize {
        self.inner.n_sensors()
    }

    fn read(&mut self) -> Result<StateFrame, HalError> {
        self.left = self.left.saturating_sub(1);
        self.is_held = self.left > 0;
        if self.is_held {
            return self.shown.ok_or(HalError::NoState);
        }
        let mut state = self.inner.read()?;
        if let (Some(spoil), Some(shown)) = (self.spoil, &self.shown) {
            spoil(&mut state, shown);
            state = state.sealed();
        }
        self.shown = Some(state);
        if let Some(command) = self.waiting.take() {
            self.inner.write(&command)?;
        }
        Ok(state)
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        if self.is_held {
            self.waiting = Some(*command);
            return Ok(());
        }
        self.inner.write(command)
    }

    fn sent(&self) -> Option<&[f64; MAX_AXES]> {
        self.inner.sent()
    }
}

type Hal<'c> = Held<Guarded<'c>>;

/// At 0.23 m/s, of 0.35 m/s that the daemon allows, where a wave is at its fastest.
fn at_speed(clock: &ManualClock) -> Rig<'_, Hal<'_>> {
    let robot = robot("prs3");
    let settings = settings(&robot);
    let hal = guarded(&robot, &settings, &[0.14, 0.15, 0.16], clock);
    let hal = Held { inner: hal, left: 0, is_held: false, shown: None, waiting: None, spoil: None };
    let mut rig = Rig::new(hal, robot, settings, clock);
    rig.periods(3);
    rig.arm().expect("it is ready");
    rig.until(Phase::Holding, 2000);
    rig.periods(150);
    let mut centre = [0.0; MAX_AXES];
    centre[..3].fill(0.1);
    let motion: Option<Box<dyn Motion>> = Some(Box::new(Wave { centre, height: 0.15, length: None }));
    rig.order(Order { motion, ..Order::plain(OrderKind::Start, 0) }).expect("it holds");
    while rig.records.last().is_none_or(|record| record.motion_time[0] < 0.5) {
        rig.periods(1);
    }
    assert_eq!(rig.machine.phase(), Phase::Position);
    assert!(rig.last().v_ref[0] > 0.23, "{:?}", rig.last().v_ref);
    rig
}

/// The driver gets no time for so many periods, and then shows what `spoil` makes of its states; the records from there on.
fn held(rig: &mut Rig<'_, Hal<'_>>, periods: u64, spoil: Option<Spoil>, then: usize) -> Vec<CycleRecord> {
    let begin = rig.records.len();
    let hal = rig.machine.hal_mut();
    (hal.left, hal.spoil) = (periods + 1, spoil);
    rig.periods(usize::try_from(periods).expect("a count") + then);
    rig.records[begin..].to_vec()
}

#[test]
fn a_driver_that_was_kept_waiting_goes_on_as_if_nothing_had_been() {
    for periods in 1..=9 {
        let clock = ManualClock::new(1_000_000_000);
        let mut rig = at_speed(&clock);
        let lost = rig.machine.gate_counts().lost;
        let records = held(&mut rig, periods, None, 200);
        let what = format!("held for {periods}: {:?}", rig.transitions.last());
        assert_eq!(rig.machine.phase(), Phase::Position, "{what}");
        let n = usize::try_from(periods).expect("a count");
        for (k, record) in records.iter().enumerate() {
            let is_new = record.flags & flags::NEW_STATE != 0;
            let told = (record.flags, record.state.stamp_ns, record.state.q[0], record.q_given[0], rig.machine.gate_counts());
            assert_eq!((is_new, record.q_dt[0] > 0.0), (k >= n, k >= n), "{what}: period {k}, {told:?}");
            assert!(record.flags & flags::CONTROLLER_FAULT == 0, "{what}: period {k}");
        }
        assert!((records[n].q_dt[0] - (periods + 1) as f64 * PERIOD_S).abs() < 1e-12, "{what}: {}", records[n].q_dt[0]);
        // The drives went on with the last command meanwhile, a step a period, of which nobody saw any.
        assert_eq!(rig.machine.gate_counts().lost - lost, periods, "{what}");
        // What the stamps of all states say together is what the loop was told.
        let stamps = [&rig.records[0], rig.last()].map(|record| record.state.stamp_ns);
        let told: f64 = rig.records[1..].iter().map(|record| record.q_dt[0]).sum();
        assert!((told - (stamps[1] - stamps[0]) as f64 * 1e-9).abs() < 1e-9, "{what}: {told} s");
    }
}

#[test]
fn a_jump_is_one_after_a_wait_as_well() {
    // Where it is known too late that it stays there, the last state that is believed has grown stale meanwhile.
    let (jump, stale) = ((Phase::Fault, Cause::Jump), (Phase::SafeStop, Cause::Stale));
    for (periods, wanted) in [(0, jump), (4, jump), (8, stale)] {
        let clock = ManualClock::new(1_000_000_000);
        let mut rig = at_speed(&clock);
        // More than the fastest drive goes in the longest of these waits.
        let spoil: Spoil = |state, _| state.q[1] += 0.05;
        held(&mut rig, periods, Some(spoil), 5);
        let told = *rig.transitions.last().expect("a transition");
        assert_eq!((rig.machine.phase(), told.cause), wanted, "after {periods}: {told:?}");
        assert!(told.cause != Cause::Jump || told.place == 1, "after {periods}: {told:?}");
    }
}

#[test]
fn a_clock_that_stands_hides_no_jump() {
    let clock = ManualClock::new(1_000_000_000);
    let mut rig = at_speed(&clock);
    let stands: Spoil = |state, shown| {
        state.stamp_ns = shown.stamp_ns;
        state.q[2] += 0.02;
    };
    held(&mut rig, 0, Some(stands), 5);
    let told = *rig.transitions.last().expect("a transition");
    assert_eq!((rig.machine.phase(), told.cause, told.place), (Phase::Fault, Cause::Jump, 2), "{told:?}");
    // Where nothing jumps, nobody acts on positions that are of no known time for long.
    let clock = ManualClock::new(1_000_000_000);
    let mut rig = at_speed(&clock);
    let records = held(&mut rig, 0, Some(|state, shown| (state.stamp_ns, state.q) = (shown.stamp_ns, shown.q)), 12);
    let told = *rig.transitions.last().expect("a transition");
    assert_eq!((rig.machine.phase(), told.cause), (Phase::SafeStop, Cause::Stale), "{told:?}");
    assert!(records[..10].iter().all(|record| record.q_dt[0] <= 0.0), "none of them is new");
}

/// Periods until states begin to be missing, while the motion is at its fastest.
const LOST_AT: usize = 800;

/// Records from then on of a loop that may act on states for a second, so many of which are missing; the drives hear every command.
fn lost(missing: u64) -> Vec<CycleRecord> {
    let clock = ManualClock::new(1_000_000_000);
    let robot = robot("prs3");
    let patient = CONFIG.replace("valid_for_s = 0.05", "valid_for_s = 1.0").replace("stale_s     = 0.05", "stale_s = 1.0");
    let settings = DaemonConfig::parse(&patient, "daemon.toml").expect("it is one").settings(&robot.model, 200.0).expect("it fits");
    assert_eq!(settings.limits.gate.stale_ns, 1_000_000_000);
    let script = [Injection { from: LOST_AT as u64, to: LOST_AT as u64 + missing, fault: Fault::Drop }];
    let hal = FaultyHal::new(guarded(&robot, &settings, &[0.14, 0.15, 0.16], &clock), &script);
    let mut rig = Rig::new(hal, robot, settings, &clock);
    rig.playing();
    rig.periods(LOST_AT + 400 - rig.records.len());
    assert_eq!(rig.machine.phase(), Phase::Position, "{:?}", rig.transitions.last());
    rig.records.split_off(LOST_AT)
}

#[test]
fn after_states_were_missing_for_a_while_no_command_leaps() {
    let none = lost(0);
    let apart = |a: &[f64; MAX_AXES], b: &[f64; MAX_AXES]| (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f64::max);
    for missing in [3, 5, 50] {
        let some = lost(missing);
        assert_eq!(some.iter().filter(|record| record.flags & flags::NEW_STATE == 0).count() as u64, missing);
        // The wave accelerates by 0.05/2·π² m/s² at most: so far off is a position that is carried on, so far the velocity.
        let (a, time) = (0.025 * core::f64::consts::PI * core::f64::consts::PI, (missing + 1) as f64 * PERIOD_S);
        let (q_off, v_off) = (0.5 * a * time * time, a * time);
        let q = some.iter().zip(&none).map(|(a, b)| apart(&a.q_given, &b.q_given)).fold(0.0, f64::max);
        assert!(q < q_off + 3e-5, "{missing} missing: {q} m off, {q_off} to be expected");
        // What the example's controller, at 20 1/s, makes of that, for some 40 kg at each drive.
        let most = 40.0 * (400.0 * q_off + 40.0 * v_off);
        let tau = some.iter().zip(&none).map(|(a, b)| apart(&a.command.tau, &b.command.tau)).fold(0.0, f64::max);
        assert!(tau < most, "{missing} missing: {tau} N off, {most} to be expected");
    }
}
