//! Any plant as hardware: behind [`pkm_hal::Backend`] a controller or a daemon cannot tell it from a robot.
//!
//! Time is the simulation's own. A command acts for one control period, and with it the period passes: reading, computing and writing in
//! turn is a loop in lockstep, as fast as the machine can. Who wants it paced by a real clock waits between periods himself. A period in which
//! nobody commands is let pass by [`SimBackend::elapse`]: as real drives do, these hold the last command then.

extern crate alloc;

use alloc::sync::Arc;
use core::sync::atomic::{AtomicU64, Ordering};

use pkm_dyn::effects::Robot;
use pkm_hal::frame::{first_bits, status};
use pkm_hal::{Backend, Clock, CommandFrame, HalError, MAX_AXES, MAX_SENSORS, Mode, StateFrame};

use crate::actuators::{ActuatorChain, OutputStage, ThreeMass};
use crate::error::SimError;
use crate::plant::Plant;
use crate::random::{Random, Stream};
use crate::sensors::{Encoder, ForceCell, ForceCellConfig, Sampled, Sampling, SamplingConfig, VelocitySensing, VelocitySensor};

/// The clock of a simulation: it moves when a control period has passed.
#[derive(Debug, Clone, Default)]
pub struct SimClock {
    now_ns: Arc<AtomicU64>,
}

impl Clock for SimClock {
    fn now_ns(&self) -> u64 {
        self.now_ns.load(Ordering::Acquire)
    }
}

/// How a robot is simulated as hardware.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimOptions {
    /// Control period `[ns]`.
    pub period_ns: u64,
    /// Steps of the plant in one.
    pub substeps: u32,
    /// Chooses every random number.
    pub seed: u64,
    /// Width of a tick of the encoders `[m | rad]`; 0 does not round.
    pub encoder_resolution: f64,
    /// Standard deviation of their noise `[m | rad]`.
    pub encoder_noise: f64,
    /// How velocity is measured.
    pub velocity: VelocitySensing,
    /// How the efforts of the drives are measured.
    pub effort: ForceCellConfig,
    /// When samples are taken and which arrive.
    pub sampling: SamplingConfig,
}

impl Default for SimOptions {
    fn default() -> Self {
        Self {
            period_ns: 1_000_000,
            substeps: 2,
            seed: 1,
            encoder_resolution: 0.0,
            encoder_noise: 0.0,
            velocity: VelocitySensing::Exact,
            effort: ForceCellConfig::default(),
            sampling: SamplingConfig::default(),
        }
    }
}

/// One drive with its sensors, in the order in which a command passes.
#[derive(Debug, Clone)]
pub struct SimDrive {
    /// Ceiling, steps and dead zone of its electronics.
    pub output: OutputStage,
    /// Scale, delay, lag and saturation.
    pub chain: ActuatorChain,
    /// Elastic transmission between motor and plant; without one the plant is driven directly.
    pub transmission: Option<ThreeMass>,
    /// Position sensor.
    pub encoder: Encoder,
    /// Velocity sensor.
    pub velocity: VelocitySensor,
    /// Sensor of the effort that acts on the plant.
    pub effort: ForceCell,
}

impl SimDrive {
    /// Drive `k` of `robot`, with the effects that the robot has and the faults of `options`.
    ///
    /// # Errors
    /// A delay of more than one second.
    pub fn of_robot(robot: &Robot, k: usize, options: &SimOptions) -> Result<Self, SimError> {
        let (j, period) = (robot.model.actuators[k], seconds(options.period_ns));
        Ok(Self {
            output: OutputStage::ideal(),
            chain: ActuatorChain::try_new(robot, j, period)?,
            transmission: None,
            encoder: Encoder::new(robot, j, options.encoder_resolution, options.encoder_noise),
            velocity: VelocitySensor::new(options.velocity, options.encoder_resolution),
            effort: ForceCell::new(options.effort, options.seed, k),
        })
    }
}

/// What further sensors see of the plant, written into one number per cell.
type Probe<P> = Box<dyn FnMut(&mut P, &mut [f64]) + Send>;

/// Cells that see the plant through one probe, and what it saw last.
struct Gauge<P> {
    probe: Probe<P>,
    seen: Vec<f64>,
    cells: Vec<ForceCell>,
}

/// A plant with its drives and sensors as hardware.
pub struct SimBackend<P> {
    plant: P,
    drives: Vec<SimDrive>,
    gauges: Vec<Gauge<P>>,
    sampling: Sampling,
    random: Random,
    clock: SimClock,
    period_ns: u64,
    substeps: u32,
    /// Efforts that the drives were told to give.
    command: [f64; MAX_AXES],
    tau: Vec<f64>,
    /// Newest sample, whether it arrived or not.
    sample: StateFrame,
    /// Newest sample that arrived.
    shown: StateFrame,
    fault: Option<SimError>,
}

impl<P> core::fmt::Debug for SimBackend<P> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { drives, period_ns, sample, fault, .. } = self;
        f.debug_struct("SimBackend")
            .field("drives", drives)
            .field("period_ns", period_ns)
            .field("sample", sample)
            .field("fault", fault)
            .finish_non_exhaustive()
    }
}

fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
}

impl<P: Plant> SimBackend<P> {
    /// `plant` driven and seen as the effects of `robot` and `options` say, at rest without efforts.
    ///
    /// # Errors
    /// As [`Self::try_new`] and [`SimDrive::of_robot`].
    pub fn of_robot(plant: P, robot: &Robot, options: &SimOptions) -> Result<Self, SimError> {
        let drives = (0..robot.model.n_act()).map(|k| SimDrive::of_robot(robot, k, options)).collect::<Result<_, _>>()?;
        Self::try_new(plant, drives, options)
    }

    /// `plant` with these drives, one for each of its coordinates.
    ///
    /// # Errors
    /// More drives than a frame has room for, not as many as the plant has coordinates, or times that cannot be.
    pub fn try_new(plant: P, drives: Vec<SimDrive>, options: &SimOptions) -> Result<Self, SimError> {
        let n = drives.len();
        if n == 0 || n > MAX_AXES || n != plant.position().len() {
            return Err(SimError::Scenario { what: "number of drives", value: n as f64, limit: "one for each coordinate, 1 to 16" });
        }
        for (what, value) in [("period_ns", options.period_ns as f64), ("substeps", f64::from(options.substeps))] {
            if value < 1.0 {
                return Err(SimError::Scenario { what, value, limit: "at least 1" });
            }
        }
        let mut backend = Self {
            sampling: Sampling::try_new(options.sampling, seconds(options.period_ns), options.seed)?,
            random: Random::new(options.seed, Stream::Encoders),
            clock: SimClock::default(),
            period_ns: options.period_ns,
            substeps: options.substeps,
            command: [0.0; MAX_AXES],
            tau: vec![0.0; n],
            sample: StateFrame::new(n, 0),
            shown: StateFrame::new(n, 0),
            gauges: Vec::new(),
            fault: None,
            plant,
            drives,
        };
        backend.describe();
        backend.take_sample(0.0);
        backend.publish(false);
        Ok(backend)
    }

    /// Adds a further sensor: `probe` says what there is to be seen, `cell` what it makes of it. Sensors are numbered as they are added.
    ///
    /// # Errors
    /// More sensors than a frame has room for.
    pub fn add_sensor(&mut self, mut probe: impl FnMut(&P) -> f64 + Send + 'static, cell: ForceCell) -> Result<(), SimError> {
        self.add_gauge(Box::new(move |plant, seen| seen[0] = probe(plant)), vec![cell])
    }

    /// Adds the six cells of the model's wrench sensor number `sensor`: fx, fy, fz, mx, my, mz in its frame.
    ///
    /// # Errors
    /// More sensors than a frame has room for; a plant that does not know the wrench there.
    pub fn add_wrench(&mut self, sensor: usize, cells: [ForceCell; 6]) -> Result<(), SimError> {
        if self.plant.sensor_wrench(sensor).is_none() {
            let what = "a wrench sensor".to_string();
            return Err(SimError::NotRepresentable { engine: "this plant", what, problem: "take the constrained one" });
        }
        let probe = move |plant: &mut P, seen: &mut [f64]| {
            let wrench = plant.sensor_wrench(sensor).unwrap_or_default();
            seen[..3].copy_from_slice(wrench.linear.as_slice());
            seen[3..].copy_from_slice(wrench.angular.as_slice());
        };
        self.add_gauge(Box::new(probe), cells.to_vec())
    }

    fn add_gauge(&mut self, mut probe: Probe<P>, mut cells: Vec<ForceCell>) -> Result<(), SimError> {
        let n = self.n_cells() + cells.len();
        if n > MAX_SENSORS {
            return Err(SimError::Scenario { what: "number of sensors", value: n as f64, limit: "at most 16" });
        }
        let mut seen = vec![0.0; cells.len()];
        probe(&mut self.plant, &mut seen);
        cells.iter_mut().zip(&seen).for_each(|(cell, seen)| cell.settle(*seen));
        self.gauges.push(Gauge { probe, seen, cells });
        self.describe();
        self.take_sample(seconds(self.clock.now_ns()));
        self.publish(false);
        Ok(())
    }

    fn n_cells(&self) -> usize {
        self.gauges.iter().map(|g| g.cells.len()).sum()
    }

    /// Brings the drives and the cells of their efforts to rest under commands that were held for ever, one per drive `[N | N·m]`.
    pub fn settle(&mut self, command: &[f64]) {
        for (k, (drive, command)) in self.drives.iter_mut().zip(command).enumerate() {
            self.command[k] = *command;
            let output = drive.output.output(*command);
            drive.chain.settle(output);
            let acting = drive.chain.mean_over(0.0, seconds(self.period_ns));
            if let Some(transmission) = &mut drive.transmission {
                transmission.settle(acting, self.plant.position()[k]);
            }
            drive.effort.settle(acting);
        }
        self.take_sample(seconds(self.clock.now_ns()));
        self.publish(false);
    }

    /// Its clock; clones show the same time.
    #[must_use]
    pub fn clock(&self) -> SimClock {
        self.clock.clone()
    }

    /// The plant, as nobody sees it from outside.
    #[must_use]
    pub fn plant(&self) -> &P {
        &self.plant
    }

    /// The plant, for what is said to persons in it.
    pub fn plant_mut(&mut self) -> &mut P {
        &mut self.plant
    }

    /// Why the plant cannot go on, if it cannot: the device is gone then.
    #[must_use]
    pub fn fault(&self) -> Option<&SimError> {
        self.fault.as_ref()
    }

    /// Lets a control period pass in which nobody commands: the drives hold.
    ///
    /// # Errors
    /// The plant cannot go on.
    pub fn elapse(&mut self) -> Result<(), HalError> {
        for (drive, command) in self.drives.iter_mut().zip(self.command) {
            drive.chain.push(drive.output.output(command));
        }
        let sampled = self.sampling.advance();
        if let Err(error) = self.pass(sampled) {
            self.fault = Some(error);
            return Err(HalError::Gone { code: 1 });
        }
        let now_ns = self.clock.now_ns() + self.period_ns;
        self.clock.now_ns.store(now_ns, Ordering::Release);
        self.publish(sampled.is_lost);
        Ok(())
    }

    /// Moves on by a period and takes the sample at its end, or so much earlier.
    fn pass(&mut self, sampled: Sampled) -> Result<(), SimError> {
        let (period, parts) = (seconds(self.period_ns), f64::from(self.substeps));
        let cut = period - sampled.early;
        let end = seconds(self.clock.now_ns()) + period;
        let mut is_taken = false;
        for part in 0..self.substeps {
            let [from, to] = [part, part + 1].map(|k| period * f64::from(k) / parts);
            // Exactly at an end there is nothing to be cut.
            if !is_taken && sampled.early > 0.0 && cut < to {
                if cut > from {
                    self.step(from, cut - from)?;
                }
                self.take_sample(end);
                is_taken = true;
                self.step(cut.max(from), to - cut.max(from))?;
            } else {
                self.step(from, to - from)?;
            }
        }
        if !is_taken {
            self.take_sample(end);
        }
        Ok(())
    }

    /// Moves on by `h`, from `offset` after the period's begin.
    fn step(&mut self, offset: f64, h: f64) -> Result<(), SimError> {
        let Self { plant, drives, tau, .. } = self;
        for (k, (tau, drive)) in tau.iter_mut().zip(drives.iter_mut()).enumerate() {
            *tau = drive.chain.mean_over(offset, h);
            if let Some(transmission) = &mut drive.transmission {
                // The load is foretold; its velocity at the end of the step is not known yet.
                *tau = transmission.advance(*tau, plant.position()[k] + h * plant.velocity()[k], h);
            }
            drive.effort.follow(*tau, h);
        }
        let t = seconds(self.clock.now_ns()) + offset;
        let mut before = [0.0; MAX_AXES];
        before[..tau.len()].copy_from_slice(plant.position());
        plant.step(tau, h)?;
        for ((drive, from), to) in drives.iter_mut().zip(before).zip(plant.position()) {
            let offset = drive.encoder.offset;
            drive.velocity.follow([from - offset, to - offset], t, h);
        }
        for Gauge { probe, seen, cells } in &mut self.gauges {
            probe(&mut self.plant, seen);
            cells.iter_mut().zip(seen.iter()).for_each(|(cell, seen)| cell.follow(*seen, h));
        }
        Ok(())
    }

    fn describe(&mut self) {
        let (n, n_sensors) = (self.drives.len(), self.n_cells());
        let all = first_bits(n);
        let measured = |k: usize| u32::from(self.drives[k].velocity.is_there()) << k;
        let valid_v = (0..n).map(measured).sum();
        let sample = StateFrame::new(n, n_sensors);
        let valid_sensor = first_bits(n_sensors);
        self.sample = StateFrame { valid_q: all, valid_v, valid_tau: all, valid_sensor, ..sample };
    }

    /// Reads every sensor of the plant as it stands, at time `end` `[s]`.
    fn take_sample(&mut self, end: f64) {
        let period = seconds(self.period_ns);
        for (k, drive) in self.drives.iter_mut().enumerate() {
            let reading = drive.encoder.read(self.plant.position()[k], end, &mut self.random);
            self.sample.q[k] = reading;
            self.sample.v[k] = drive.velocity.sample(end, period, self.plant.velocity()[k], reading);
            self.sample.tau[k] = drive.effort.read();
        }
        for (to, cell) in self.sample.sensor.iter_mut().zip(self.gauges.iter_mut().flat_map(|g| &mut g.cells)) {
            *to = cell.read();
        }
    }

    fn publish(&mut self, is_lost: bool) {
        self.sample.sequence += 1;
        self.sample.stamp_ns = self.clock.now_ns();
        if !is_lost {
            self.shown = self.sample.sealed();
        }
    }
}

impl<P: Plant> Backend for SimBackend<P> {
    fn n_axes(&self) -> usize {
        self.drives.len()
    }

    fn n_sensors(&self) -> usize {
        self.n_cells()
    }

    fn read(&mut self) -> Result<StateFrame, HalError> {
        if self.fault.is_some() { Err(HalError::Gone { code: 1 }) } else { Ok(self.shown) }
    }

    fn write(&mut self, command: &CommandFrame) -> Result<(), HalError> {
        let mode = command.check(self.n_axes())?;
        if mode == Mode::Brake {
            return Err(HalError::Mode { code: mode.code() });
        }
        if self.fault.is_some() {
            return Err(HalError::Gone { code: 1 });
        }
        let is_powered = mode == Mode::Effort;
        self.command = if is_powered { command.tau } else { [0.0; MAX_AXES] };
        self.sample.status = if is_powered { status::POWERED } else { 0 };
        (self.sample.nonce, self.sample.command_sequence) = (command.nonce, command.sequence);
        self.elapse()
    }
}
