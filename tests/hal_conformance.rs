//! The contract of hardware, on every backend there is, and on some that break it; what a HAL does when wires and programs fail.

use pkm_dyn::urdf::parse;
use pkm_hal::backends::recorded::OVER;
use pkm_hal::backends::{Loopback, Recorded};
use pkm_hal::conformance::{check_device, check_guarded};
use pkm_hal::frame::status;
use pkm_hal::{
    AxisLimits, Backend, Clock, CommandFrame, Fault, FaultyHal, HalError, Injection, Limiter, MAX_AXES, ManualClock, Mode, SafeAction,
    SafeKind, Signal, StateFrame, Watchdog, WatchdogLimits,
};
use pkm_sim::sensors::{ForceCellConfig, SamplingConfig, VelocitySensing};
use pkm_sim::{ReducedPlant, SimBackend, SimClock, SimOptions};

const PERIOD_NS: u64 = 1_000_000;

/// A shipped robot at its assembly, as hardware.
fn simulated(name: &str, options: &SimOptions) -> SimBackend<ReducedPlant> {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    let robot = parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("shipped robots load").robot;
    let start: Vec<f64> = robot.model.actuators.iter().map(|&j| robot.model.assembly[j]).collect();
    let plant = ReducedPlant::try_new(robot.clone(), &start).expect("it closes");
    SimBackend::of_robot(plant, &robot, options).expect("it has at most 16 drives")
}

/// Sensors as they are.
fn real() -> SimOptions {
    SimOptions {
        encoder_resolution: 1e-6,
        encoder_noise: 1e-6,
        velocity: VelocitySensing::PulseCounting,
        effort: ForceCellConfig { lag: 1e-3, noise: 0.1, step: 0.01, ..ForceCellConfig::default() },
        sampling: SamplingConfig { jitter: 1e-4, ..SamplingConfig::default() },
        ..SimOptions::default()
    }
}

#[test]
fn loopback_and_every_decorator_keep_the_contract() {
    let clock = ManualClock::new(0);
    for n in [1, 7, 16] {
        check_device(&mut Loopback::new(n, &clock)).unwrap();
        let limits = vec![AxisLimits::of_effort(10.0); n];
        check_device(&mut Limiter::try_new(Loopback::new(n, &clock), &limits).unwrap()).unwrap();
        check_device(&mut FaultyHal::new(Loopback::new(n, &clock), &[])).unwrap();
    }
}

#[test]
fn every_shipped_robot_simulated_keeps_the_contract() {
    // ups4 has more drives than freedoms, which the reduced plant does not simulate.
    for robot in pkm_robots::ALL.iter().filter(|robot| robot.name != "ups4") {
        for options in [SimOptions::default(), real()] {
            let outcome = check_device(&mut simulated(robot.name, &options));
            assert_eq!(outcome, Ok(()), "{}", robot.name);
        }
    }
}

/// A clock that goes on by a tenth of a period whenever somebody looks at it.
struct Ticking(ManualClock);

impl Clock for Ticking {
    fn now_ns(&self) -> u64 {
        self.0.advance(PERIOD_NS / 10);
        self.0.now_ns()
    }
}

/// What a simulated robot said, period by period.
fn recording(periods: usize) -> Vec<StateFrame> {
    let mut robot = simulated("five_bar", &real());
    let state = |_| {
        robot.elapse().expect("a period");
        robot.read().expect("a state")
    };
    (0..periods).map(state).collect()
}

#[test]
fn a_recording_in_place_of_a_robot_keeps_the_contract() {
    let frames = recording(100);
    assert_eq!(check_device(&mut Recorded::try_new(&frames, Ticking(ManualClock::new(7))).unwrap()), Ok(()));
    let clock = Ticking(ManualClock::new(7));
    let device = Recorded::try_new(&frames, &clock).unwrap();
    let mut hal = Watchdog::try_new(device, &clock, WatchdogLimits::of_period(PERIOD_NS), bounded(SafeKind::Damp)).unwrap();
    check_guarded(&mut hal, &&clock, 5 * PERIOD_NS, &mut |_, ns| clock.0.advance(ns)).unwrap();
}

#[test]
fn what_was_recorded_comes_again_in_its_time_and_then_no_more() {
    let frames = recording(20);
    let clock = ManualClock::new(1_000_000_000);
    let mut played = Recorded::try_new(&frames, &clock).unwrap();
    let first = played.read().unwrap();
    assert_eq!((first.sequence, first.stamp_ns), (1, 1_000_000_000));
    for recorded in &frames[1..10] {
        // Not a moment too early.
        let wait_ns = recorded.stamp_ns - frames[0].stamp_ns - (clock.now_ns() - 1_000_000_000);
        clock.advance(wait_ns - 1);
        let before = played.read().unwrap();
        clock.advance(1);
        let now = played.read().unwrap();
        assert_eq!((now.sequence, now.stamp_ns), (before.sequence + 1, clock.now_ns()));
        assert_eq!((now.q.map(f64::to_bits), now.tau.map(f64::to_bits)), (recorded.q.map(f64::to_bits), recorded.tau.map(f64::to_bits)));
    }
    // Who does not look misses some, and can count them.
    clock.advance(frames[14].stamp_ns - frames[9].stamp_ns);
    assert_eq!(played.read().unwrap().sequence, 15);
    clock.advance(frames[19].stamp_ns - frames[14].stamp_ns);
    assert_eq!(played.read().unwrap().sequence, 20);
    clock.advance(1);
    assert_eq!(played.read(), Err(HalError::Gone { code: OVER }));
    // What is no recording of one robot.
    let broken = StateFrame { q: [f64::NAN; MAX_AXES], ..frames[1] }.sealed();
    let other = StateFrame { stamp_ns: frames[0].stamp_ns + 1, ..StateFrame::new(3, 0) }.sealed();
    for bad in [&[][..], &[frames[1], frames[0]], &[frames[0], broken], &[frames[0], other]] {
        assert!(Recorded::try_new(bad, &clock).is_err());
    }
}

/// An action whose efforts are bounded.
fn bounded(kind: SafeKind) -> SafeAction {
    SafeAction { effort: [100.0; MAX_AXES], ..SafeAction::new(kind) }
}

#[test]
fn a_hal_keeps_robots_from_strangers_on_every_device() {
    let clock = ManualClock::new(0);
    let limits = WatchdogLimits::of_period(PERIOD_NS);
    for kind in [SafeKind::Off, SafeKind::Ramp, SafeKind::Damp, SafeKind::Hold, SafeKind::Brake] {
        let device = Limiter::try_new(Loopback::new(3, &clock), &[AxisLimits::of_effort(10.0); 3]).unwrap();
        let mut hal = Watchdog::try_new(device, &clock, limits, bounded(kind)).unwrap();
        check_guarded(&mut hal, &clock, 5 * PERIOD_NS, &mut |_, ns| clock.advance(ns)).unwrap();

        let device = simulated("five_bar", &real());
        let time = device.clock();
        let mut hal = Watchdog::try_new(device, time.clone(), limits, bounded(kind)).unwrap();
        let mut pass = |hal: &mut Watchdog<SimBackend<ReducedPlant>, SimClock>, ns: u64| {
            for _ in 0..ns.div_ceil(PERIOD_NS) {
                hal.inner_mut().elapse().unwrap();
            }
        };
        check_guarded(&mut hal, &time, 5 * PERIOD_NS, &mut pass).unwrap();
    }
}

/// A device that breaks one rule.
struct Liar<'c> {
    inner: Loopback<&'c ManualClock>,
    lie: Lie,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Lie {
    TakesAnything,
    Unsealed,
    GoesBack,
    ForgetsTheNonce,
    AcknowledgesWhatItRefused,
    MeasuresNothing,
    Frozen,
}

impl Backend for Liar<'_> {
    fn n_axes(&self) -> usize {
        self.inner.n_axes()
    }

    fn n_sensors(&self) -> usize {
        0
    }

    fn read(&mut self) -> Result<StateFrame, HalError> {
        let mut state = self.inner.read()?;
        match self.lie {
            Lie::Unsealed => state.checksum ^= 1,
            Lie::GoesBack => state.sequence = 1000 - state.sequence.min(1000),
            Lie::ForgetsTheNonce => state.nonce = 0,
            Lie::MeasuresNothing => (state.valid_q, state.valid_v, state.valid_tau) = (0, 0, 0),
            Lie::Frozen => state.sequence = 1,
            Lie::TakesAnything | Lie::AcknowledgesWhatItRefused => {}
        }
        Ok(if self.lie == Lie::Unsealed { state } else { state.sealed() })
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        let outcome = self.inner.write(command);
        match self.lie {
            Lie::TakesAnything => Ok(()),
            Lie::AcknowledgesWhatItRefused if outcome.is_err() => {
                let taken = CommandFrame { sequence: command.sequence, ..CommandFrame::new(self.n_axes(), Mode::Off) };
                self.inner.write(&taken.sealed())?;
                outcome
            }
            _ => outcome,
        }
    }
}

#[test]
fn a_device_that_breaks_a_rule_is_told_which() {
    let clock = ManualClock::new(0);
    let broken = |lie| check_device(&mut Liar { inner: Loopback::new(2, &clock), lie }).expect_err("a liar").rule;
    assert_eq!(broken(Lie::TakesAnything), "an effort that is not a number is refused");
    assert_eq!(broken(Lie::Unsealed), "a state passes its own check");
    assert_eq!(broken(Lie::GoesBack), "sequences of states never fall");
    assert_eq!(broken(Lie::ForgetsTheNonce), "the nonce of an accepted command is acknowledged");
    assert_eq!(broken(Lie::AcknowledgesWhatItRefused), "a refused command changes nothing");
    assert_eq!(broken(Lie::MeasuresNothing), "something is measured");
    assert_eq!(broken(Lie::Frozen), "a state of the same sequence is the same");
    // A device alone is no HAL: it has no session.
    let rule = check_guarded(&mut Loopback::new(2, &clock), &clock, PERIOD_NS, &mut |_, ns| clock.advance(ns)).expect_err("no HAL").rule;
    assert_eq!(rule, "nothing moves before it is armed");
}

/// What became of a five-bar held in place when a fault began at period 100 and lasted.
#[derive(Debug)]
struct Aftermath {
    /// Periods from the fault to the safe action.
    until_safe: Option<u64>,
    /// Largest distance of a true position from the one held, from the fault on `[rad]`.
    excursion: f64,
    /// The first error that a reader saw.
    error: Option<HalError>,
    /// Whether the drives had power at the end.
    is_powered: bool,
}

fn aftermath(fault: Fault) -> Aftermath {
    let free = AxisLimits::of_effort(100.0);
    aftermath_within(fault, [free; 2])
}

fn aftermath_within(fault: Fault, bounds: [AxisLimits; 2]) -> Aftermath {
    const FAULT_AT: u64 = 100;
    let script = [Injection { from: FAULT_AT, to: u64::MAX, fault }];
    let mut action = bounded(SafeKind::Hold);
    (action.stiffness[0], action.stiffness[1], action.damping[0], action.damping[1]) = (20.0, 20.0, 0.5, 0.5);
    let device = simulated("five_bar", &SimOptions::default());
    let clock = device.clock();
    let start: Vec<f64> = pkm_sim::Plant::position(device.plant()).to_vec();
    let limits = WatchdogLimits::of_period(PERIOD_NS);
    let device = Limiter::try_new(FaultyHal::new(device, &script), &bounds).expect("sensible limits");
    let mut hal = Watchdog::try_new(device, clock.clone(), limits, action).expect("it goes on");
    let mut out = Aftermath { until_safe: None, excursion: 0.0, error: None, is_powered: true };
    let mut sequence = 0;
    for k in 0..FAULT_AT + 50 {
        let before = clock.now_ns();
        let read = hal.read();
        let is_safe = hal.trip().is_some();
        if k >= FAULT_AT {
            if is_safe && out.until_safe.is_none() {
                out.until_safe = Some(k - FAULT_AT);
            }
            out.error = out.error.or(read.err());
            let position = pkm_sim::Plant::position(hal.inner_mut().inner_mut().inner_mut().plant());
            out.excursion = position.iter().zip(&start).map(|(q, q0)| (q - q0).abs()).fold(out.excursion, f64::max);
        }
        // A commander who is not told what he needs falls silent.
        let told =
            |state: &StateFrame| [Signal::Position, Signal::Velocity].iter().all(|&s| (0..2).all(|i| state.measured(s, i).is_some()));
        if let Ok(state) = read
            && !is_safe
            && told(&state)
        {
            sequence += 1;
            let mode = if sequence == 1 { Mode::Arm } else { Mode::Effort };
            let mut command = CommandFrame { nonce: 5, sequence, stamp_ns: before, ..CommandFrame::new(2, mode) };
            command.valid_until_ns = before + 4 * PERIOD_NS;
            for (i, start) in start.iter().enumerate() {
                command.tau[i] = 20.0 * (start - state.q[i]) - 0.5 * state.v[i];
            }
            // A commander whose command is refused has nothing better to do than to go on.
            let _ = hal.write(&command.sealed());
        }
        out.is_powered = read.is_ok_and(|state| state.status & status::POWERED != 0);
        if clock.now_ns() == before {
            hal.inner_mut().inner_mut().inner_mut().elapse().expect("it goes on");
        }
    }
    out
}

#[test]
fn what_is_not_measured_any_more_is_not_fed_back_and_without_it_no_bound_of_motion_is_kept() {
    let moving = AxisLimits { velocity: 50.0, velocity_gain: 10.0, ..AxisLimits::of_effort(100.0) };
    for signal in [Signal::Position, Signal::Velocity] {
        let fault = Fault::Unplugged { signal, axis: 0 };
        let held = aftermath(fault);
        assert!(held.until_safe.is_some_and(|periods| periods <= 6) && held.excursion < 0.2 && held.is_powered, "{fault:?}: {held:?}");
        // A limiter that cannot keep its bounds lets nothing through: the drives go off.
        let off = aftermath_within(fault, [moving; 2]);
        assert!(off.until_safe.is_some_and(|periods| periods <= 6) && !off.is_powered, "{fault:?}: {off:?}");
    }
}

#[test]
fn faults_of_wires_and_devices_end_in_the_safe_action_within_six_periods() {
    let (signal, axis) = (Signal::Position, 0);
    let faults = [
        Fault::NotANumber { signal, axis },
        Fault::Infinite { signal, axis },
        Fault::Drop,
        Fault::Duplicate,
        Fault::Corrupt { bit: 1000 },
        Fault::OtherLayout,
        Fault::Vanish,
    ];
    for fault in faults {
        let after = aftermath(fault);
        assert!(after.until_safe.is_some_and(|periods| periods <= 6), "{fault:?}: {after:?}");
        // A device that is gone gets no safe command: what it does then is its own business, and said so.
        if fault != Fault::Vanish {
            assert!(after.excursion < 0.2, "{fault:?}: {after:?}");
        }
        assert!(after.error.is_some(), "{fault:?}: a reader is told");
    }
    let clean = aftermath(Fault::Offset { signal: Signal::Sensor, axis: 9, by: 1.0 });
    assert!(clean.until_safe.is_none() && clean.error.is_none() && clean.excursion < 0.2, "{clean:?}");
    let state = simulated("five_bar", &SimOptions::default()).read().unwrap();
    assert_eq!(state.status & status::SAFE, 0);
}
