//! A simulated robot behind the contract of hardware: what comes out of it is what a plant, stepped by hand, does.

use pkm_dyn::effects::Robot;
use pkm_dyn::math;
use pkm_dyn::urdf::parse;
use pkm_hal::conformance::{check_device, check_guarded};
use pkm_hal::frame::status;
use pkm_hal::{Backend, Clock, CommandFrame, HalError, MAX_AXES, Mode, SafeAction, SafeKind, Signal, StateFrame, Watchdog, WatchdogLimits};
use pkm_sim::actuators::{ActuatorChain, OutputStage, ThreeMass, ThreeMassParameters};
use pkm_sim::sensors::{Encoder, ForceCell, ForceCellConfig, SamplingConfig, VelocitySensing, VelocitySensor};
use pkm_sim::{Plant, ReducedPlant, SimBackend, SimDrive, SimError, SimOptions};

/// A mass under a constant force: its motion is a parabola, exactly.
#[derive(Debug, Clone)]
struct Block {
    mass: f64,
    weight: f64,
    q: [f64; 1],
    v: [f64; 1],
}

impl Block {
    fn new(mass: f64, weight: f64, v: f64) -> Self {
        Self { mass, weight, q: [0.0], v: [v] }
    }
}

impl Plant for Block {
    fn position(&self) -> &[f64] {
        &self.q
    }

    fn velocity(&self) -> &[f64] {
        &self.v
    }

    fn step(&mut self, tau: &[f64], h: f64) -> Result<(), SimError> {
        let a = (tau[0] - self.weight) / self.mass;
        self.q[0] += h * (self.v[0] + 0.5 * h * a);
        self.v[0] += h * a;
        if self.q[0].abs() < 1e3 { Ok(()) } else { Err(SimError::Diverged { time: 0.0 }) }
    }
}

fn ideal() -> SimDrive {
    SimDrive {
        output: OutputStage::ideal(),
        chain: ActuatorChain::ideal(1e-3),
        transmission: None,
        encoder: Encoder::without_errors(0.0, 0.0),
        velocity: VelocitySensor::new(VelocitySensing::Exact, 0.0),
        effort: ForceCell::ideal(),
    }
}

fn hardware(block: Block, options: &SimOptions) -> SimBackend<Block> {
    let drive = SimDrive {
        encoder: Encoder::without_errors(options.encoder_resolution, options.encoder_noise),
        velocity: VelocitySensor::new(options.velocity, options.encoder_resolution),
        effort: ForceCell::new(options.effort, options.seed, 0),
        ..ideal()
    };
    SimBackend::try_new(block, vec![drive], options).expect("it goes on")
}

fn effort(sequence: u64, tau: f64) -> CommandFrame {
    let mut command = CommandFrame { sequence, ..CommandFrame::new(1, Mode::Effort) };
    command.tau[0] = tau;
    command.sealed()
}

/// States after each of `n` commands of `tau`, from the first on.
fn states(hal: &mut SimBackend<Block>, n: u64, tau: f64) -> Vec<StateFrame> {
    (1..=n)
        .map(|k| {
            hal.write(&effort(k, tau)).expect("it goes on");
            hal.read().expect("it goes on")
        })
        .collect()
}

#[test]
fn it_keeps_the_contract_of_a_device_and_behind_a_watchdog_that_of_a_hal() {
    check_device(&mut hardware(Block::new(2.0, 0.0, 0.0), &SimOptions::default())).unwrap();
    let options = SimOptions { encoder_resolution: 1e-5, encoder_noise: 1e-5, ..SimOptions::default() };
    check_device(&mut hardware(Block::new(2.0, 0.0, 0.0), &options)).unwrap();
    let device = hardware(Block::new(2.0, 0.0, 0.0), &options);
    let clock = device.clock();
    let limits = WatchdogLimits::of_period(options.period_ns);
    let mut hal = Watchdog::try_new(device, clock.clone(), limits, SafeAction::new(SafeKind::Ramp)).unwrap();
    let mut pass = |hal: &mut Watchdog<SimBackend<Block>, _>, ns: u64| {
        for _ in 0..ns.div_ceil(options.period_ns) {
            hal.inner_mut().elapse().unwrap();
        }
    };
    check_guarded(&mut hal, &clock, 5 * options.period_ns, &mut pass).unwrap();
}

#[test]
fn with_perfect_drives_and_sensors_it_is_the_plant_bit_by_bit() {
    let five_bar = pkm_robots::find("five_bar").expect("a shipped robot");
    let model = parse(five_bar.toml, five_bar.urdf, [five_bar.toml_name, five_bar.urdf_name]).expect("shipped robots load").bare;
    let start: Vec<f64> = model.actuators.iter().map(|&j| model.assembly[j]).collect();
    let robot = Robot::new(model, Vec::new());
    let plant = ReducedPlant::try_new(robot.clone(), &start).unwrap();
    let (mut by_hand, options) = (plant.clone(), SimOptions::default());
    let mut hal = SimBackend::of_robot(plant, &robot, &options).unwrap();
    let clock = hal.clock();
    for k in 0..200 {
        let state = hal.read().unwrap();
        assert_eq!((state.stamp_ns, clock.now_ns(), state.sequence), (k * 1_000_000, k * 1_000_000, k + 1));
        let mut command = CommandFrame { sequence: k + 1, ..CommandFrame::new(2, Mode::Effort) };
        for (i, start) in start.iter().enumerate() {
            assert_eq!(state.q[i].to_bits(), by_hand.position()[i].to_bits(), "period {k}, drive {i}");
            assert_eq!(state.v[i].to_bits(), by_hand.velocity()[i].to_bits());
            command.tau[i] = 2.0 * (start - state.q[i]) - 0.1 * state.v[i] + 0.05;
        }
        hal.write(&command.sealed()).unwrap();
        for part in 0..2 {
            // The offsets are rounded as the device rounds them.
            let [from, to] = [part, part + 1].map(|part| 1_000_000.0 * 1e-9 * f64::from(part) / 2.0);
            by_hand.step(&command.tau[..2], to - from).unwrap();
        }
    }
    assert!((by_hand.position()[0] - start[0]).abs() > 1e-6, "it moved");
}

#[test]
fn a_sample_that_jitters_is_that_of_an_earlier_moment_and_its_stamp_does_not_say_so() {
    let sampling = SamplingConfig { jitter: 4e-4, ..SamplingConfig::default() };
    let mut hal = hardware(Block::new(1.0, 0.0, 2.0), &SimOptions { sampling, ..SimOptions::default() });
    let (mut sum, mut squares, n) = (0.0, 0.0, 20_000_u32);
    for (k, state) in (1_u32..).zip(states(&mut hal, 400, 0.0).into_iter().cycle().take(400)) {
        assert_eq!(state.stamp_ns, u64::from(k) * 1_000_000);
        let early = 1e-3 * f64::from(k) - state.q[0] / 2.0;
        assert!((-1e-12..4e-4).contains(&early), "{early}");
    }
    let mut hal = hardware(Block::new(1.0, 0.0, 0.0), &SimOptions { sampling, seed: 9, ..SimOptions::default() });
    // Falling from rest, the exact parabola of each moment.
    for k in 1..=n.min(400) {
        hal.write(&effort(u64::from(k), 1.0)).unwrap();
        let early = 1e-3 * f64::from(k) - math::sqrt(2.0 * hal.read().unwrap().q[0]);
        (sum, squares) = (sum + early, squares + early * early);
    }
    let mean = sum / 400.0;
    let variance = squares / 400.0 - mean * mean;
    // Evenly spread over 0.4 ms; five standard errors.
    assert!((mean / 4e-4 - 0.5).abs() < 5.0 * 0.2887 / 20.0 && (variance / 1.6e-7 - 1.0 / 12.0).abs() < 5.0 * 0.0746 / 20.0);
}

#[test]
fn lost_frames_leave_gaps_that_a_watchdog_counts() {
    let sampling = SamplingConfig { jitter: 0.0, loss_begins: 0.2, loss_goes_on: 0.5 };
    let device = hardware(Block::new(1.0, 0.0, 0.0), &SimOptions { sampling, ..SimOptions::default() });
    let clock = device.clock();
    let limits = WatchdogLimits { stale_ns: 1_000_000_000, ..WatchdogLimits::of_period(1_000_000) };
    let mut hal = Watchdog::try_new(device, clock, limits, SafeAction::new(SafeKind::Off)).unwrap();
    let (mut last, mut gaps) = (hal.read().unwrap().sequence, 0);
    for _ in 0..1000 {
        hal.inner_mut().elapse().unwrap();
        let sequence = hal.read().unwrap().sequence;
        gaps += (sequence - last).saturating_sub(1);
        last = sequence;
    }
    assert_eq!(hal.counts().lost, gaps);
    assert!((200..370).contains(&gaps), "share 0.2/0.7 of 1000: {gaps}");
}

#[test]
fn commands_act_after_delay_lag_and_steps_of_the_drive() {
    let mut drive = ideal();
    drive.output = OutputStage::try_new(10.0, 0.5, 0.0).unwrap();
    drive.effort = ForceCell::new(ForceCellConfig { gain: 2.0, ..ForceCellConfig::default() }, 1, 0);
    let mut hal = SimBackend::try_new(Block::new(1.0, 0.0, 0.0), vec![drive], &SimOptions::default()).unwrap();
    let last = states(&mut hal, 1000, 3.3)[999];
    // 3.3 N are 3.5 N in half newtons; one second of 3.5 m/s².
    assert!((last.q[0] - 1.75).abs() < 1e-9 && (last.v[0] - 3.5).abs() < 1e-9 && (last.tau[0] - 7.0).abs() < 1e-12, "{last:?}");
    assert_eq!(last.status, status::POWERED);
    hal.write(&CommandFrame { sequence: 2000, ..CommandFrame::new(1, Mode::Off) }.sealed()).unwrap();
    assert_eq!(hal.read().unwrap().status, 0);
    hal.elapse().unwrap();
    assert!(hal.read().unwrap().tau[0].abs() <= 0.0);
}

#[test]
fn velocity_by_timing_is_finer_than_by_counting() {
    let spread = |velocity| {
        let options = SimOptions { encoder_resolution: 1e-4, velocity, ..SimOptions::default() };
        let states = states(&mut hardware(Block::new(1.0, 0.0, 0.0723), &options), 1000, 0.0);
        states[100..].iter().map(|state| (state.v[0] - 0.0723).abs()).fold(0.0, f64::max)
    };
    let (counting, timing) = (spread(VelocitySensing::PulseCounting), spread(VelocitySensing::PulseTiming { timer: 1e-7 }));
    // 0.723 ticks a period: counted are 0 or 1, that is 0 or 0.1 m/s.
    assert!((counting - 0.0723).abs() < 1e-9 && timing < 2e-4 * 0.0723, "{counting} {timing}");
    assert!(spread(VelocitySensing::Exact) < 1e-15);
    let none = SimOptions { velocity: VelocitySensing::None, ..SimOptions::default() };
    assert_eq!(hardware(Block::new(1.0, 0.0, 1.0), &none).read().unwrap().measured(Signal::Velocity, 0), None);
}

#[test]
fn an_elastic_drive_pushes_a_free_block_and_its_force_is_seen() {
    let drive = SimDrive { transmission: Some(ThreeMass::try_new(ThreeMassParameters::ANKLE, 0.0).unwrap()), ..ideal() };
    let mut hal = SimBackend::try_new(Block::new(30.0, 0.0, 0.0), vec![drive], &SimOptions::default()).unwrap();
    hal.add_sensor(|block: &Block| block.v[0], ForceCell::ideal()).unwrap();
    let last = states(&mut hal, 4000, 100.0)[3999];
    // In the end motor, rod and block go at one velocity, at which friction takes all: b_m + b_r = K_a²·b_motor + G_s²·b_s + b_rod.
    let p = ThreeMassParameters::ANKLE;
    let (ka, gs) = (p.motor_ratio(), p.screw_ratio);
    let end = 100.0 / (p.motor_viscous * ka * ka + p.screw_viscous * gs * gs + p.rod_viscous);
    assert!((last.v[0] / end - 1.0).abs() < 1e-3 && last.tau[0].abs() < 1.0, "{} m/s, not {end}; {} N", last.v[0], last.tau[0]);
    assert_eq!((last.n_sensors, last.valid_sensor), (1, 1));
    assert_eq!(last.measured(Signal::Sensor, 0), Some(last.v[0]));
}

/// A weight held up by a commander who dies after 100 periods; where it is two seconds later, and whether the HAL says so.
fn abandoned(kind: SafeKind) -> (f64, StateFrame) {
    let mut action = SafeAction { effort: [1e3; MAX_AXES], ..SafeAction::new(kind) };
    (action.stiffness[0], action.damping[0]) = (2000.0, 120.0);
    let device = hardware(Block::new(2.0, 2.0 * 9.81, 0.0), &SimOptions::default());
    let clock = device.clock();
    let mut hal = Watchdog::try_new(device, clock.clone(), WatchdogLimits::of_period(1_000_000), action).expect("it goes on");
    for k in 0..2100 {
        let before = clock.now_ns();
        let state = hal.read().expect("it goes on");
        if k < 100 {
            let mode = if k == 0 { Mode::Arm } else { Mode::Effort };
            let mut command = CommandFrame { nonce: 77, sequence: k + 1, ..CommandFrame::new(1, mode) };
            (command.stamp_ns, command.valid_until_ns) = (before, before + 5_000_000);
            command.tau[0] = 2.0 * 9.81 + 200.0 * (0.0 - state.q[0]) - 40.0 * state.v[0];
            hal.write(&command.sealed()).expect("it goes on");
        }
        if clock.now_ns() == before {
            hal.inner_mut().elapse().expect("it goes on");
        }
    }
    let state = hal.read().expect("it goes on");
    (hal.inner_mut().plant().position()[0], state)
}

#[test]
fn a_weight_whose_commander_dies_is_held_or_sinks_or_falls_as_configured() {
    let (held, state) = abandoned(SafeKind::Hold);
    assert!(held.abs() < 5e-4 && state.status & status::SAFE != 0 && state.v[0].abs() < 1e-6, "{held} m");
    let (sunk, state) = abandoned(SafeKind::Damp);
    // At its final speed m·g/d for nearly two seconds.
    assert!((state.v[0] + 2.0 * 9.81 / 120.0).abs() < 1e-3 && (-0.34..-0.30).contains(&sunk), "{sunk} m");
    let (fallen, _) = abandoned(SafeKind::Off);
    assert!(fallen < -15.0, "{fallen} m");
}

#[test]
fn one_seed_gives_the_same_frames_and_another_does_not() {
    let bytes = |seed| {
        let options = SimOptions {
            seed,
            encoder_resolution: 1e-6,
            encoder_noise: 2e-6,
            velocity: VelocitySensing::PulseCounting,
            effort: ForceCellConfig { noise: 0.1, drift: [0.0, 0.1, 0.05], step: 0.01, ..ForceCellConfig::default() },
            sampling: SamplingConfig { jitter: 1e-4, loss_begins: 0.1, loss_goes_on: 0.3 },
            ..SimOptions::default()
        };
        let frames = states(&mut hardware(Block::new(1.0, 0.5, 0.1), &options), 300, 0.6);
        frames.iter().flat_map(StateFrame::to_bytes).collect::<Vec<u8>>()
    };
    assert!(bytes(1) == bytes(1) && bytes(1) != bytes(2));
    // The same on every machine, in every build: a change of it is a change of all simulated recordings.
    assert_eq!(pkm_hal::checksum::crc32(&bytes(1)), 2_568_113_331);
}

#[test]
fn a_plant_that_cannot_go_on_is_a_device_that_is_gone() {
    let mut hal = hardware(Block::new(1.0, 0.0, 0.0), &SimOptions::default());
    let refused = (1..5000).find_map(|k| hal.write(&effort(k, 1e6)).err());
    assert_eq!(refused, Some(HalError::Gone { code: 1 }));
    assert_eq!((hal.read(), hal.write(&effort(9999, 0.0))), (Err(HalError::Gone { code: 1 }), Err(HalError::Gone { code: 1 })));
    assert!(matches!(hal.fault(), Some(SimError::Diverged { .. })));
    for options in [SimOptions { period_ns: 0, ..SimOptions::default() }, SimOptions { substeps: 0, ..SimOptions::default() }] {
        assert!(SimBackend::try_new(Block::new(1.0, 0.0, 0.0), vec![ideal()], &options).is_err());
    }
    assert!(SimBackend::try_new(Block::new(1.0, 0.0, 0.0), vec![ideal(), ideal()], &SimOptions::default()).is_err());
}
