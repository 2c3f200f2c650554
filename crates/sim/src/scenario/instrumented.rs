//! A run on simulated hardware: the controller and the recording see what the sensors say, through [`SimBackend`], and nothing else.

use pkm_dyn::effects::{Law, Robot};
use pkm_dyn::model::Model;
use pkm_hal::{Backend, CommandFrame, HalError, Mode, Signal, StateFrame};
use pkm_ident::{EffortKind, Recording};

use super::drive_pds::DrivePds;
use super::pilot::{Measured, Pilot};
use super::rates::Rates;
use super::{Scenario, Setup, same_mechanism};
use crate::actuators::{ActuatorChain, ThreeMass};
use crate::backend::{SimBackend, SimDrive, SimOptions};
use crate::equipment::{DriveEquipment, Equipment, LimbPlace};
use crate::error::SimError;
use crate::limb::{Patient, Strapped, Worn};
use crate::plant::Plant;
use crate::reference::Sample;
use crate::sensors::{Encoder, ForceCell, VelocitySensing, VelocitySensor};
use crate::trajectory::Trajectory;

/// Components of a wrench as columns name them.
const COMPONENTS: [&str; 6] = ["fx", "fy", "fz", "mx", "my", "mz"];

/// Cells are numbered by kind, so that one more of a kind changes no other's noise.
const SECOND_ENCODERS: usize = 100;
const WRENCH_CELLS: usize = 200;

/// What a run on simulated hardware leaves.
#[derive(Debug, Clone)]
pub struct Instrumented {
    /// What the sensors said; samples that never arrived are NaN in every measured column.
    pub recording: Recording,
    /// How many of its samples never arrived.
    pub lost: usize,
}

/// Runs the true robot of `setup` with `equipment` along `reference`. Encoders and effort noise of the scenario are not used. `each` is told
/// the time `[s]` before every base period.
///
/// Recorded are `q`, `dq` (where velocity is measured), `tau`, `q_ref` and `dq_ref` per drive, `q_link` of second encoders, and
/// `wrench.<sensor>.fx` to `.mz`. An effort is the one the cell shows at the sample: that of the period that ends there.
///
/// # Errors
/// As [`super::run_with`]; equipment that cannot be, sensors that the plant has nothing for, effects on the recorder alone.
pub fn run_instrumented(
    setup: Setup<'_>,
    scenario: &Scenario,
    equipment: &Equipment,
    reference: &dyn Trajectory,
    each: &mut dyn FnMut(f64),
) -> Result<Instrumented, SimError> {
    let [truth, nominal] = setup.robots;
    scenario.check()?;
    same_mechanism(&truth.model, &nominal.model)?;
    let rates = Rates::try_new(scenario, setup.controller.as_ref().map(|c| c.about().rate_hz))?;
    let period_ns = nanoseconds(rates.period);
    let period = period_ns as f64 * 1e-9;
    let mut sample = Sample::default();
    reference.at(0.0, &mut sample);
    let controller = match setup.controller {
        Some(controller) => controller,
        None => Box::new(DrivePds::try_new(&nominal.model, period)?),
    };
    let pilot = Pilot::try_new(controller, &nominal.model, period * rates.per_control as f64, &sample)?;
    let mut pilot = pilot.watched(setup.watch);
    pilot.weigh(&sample, 0.0)?;
    let n = nominal.model.n_act();
    let drives = equipped(truth, equipment, period)?;
    let start: Vec<f64> = sample.q.iter().zip(&drives).map(|(q, d)| d.encoder.true_position(*q)).collect();
    let plant = scenario.plant.build_with_laws(truth, scenario.seed, &start, &sample.v, setup.laws)?;
    let plant = with_limb(plant, nominal, equipment, &sample)?;
    let mut hal = hardware(plant, truth, drives, equipment, period_ns)?;
    hal.settle(pilot.weight());
    let mut log = Log::new(&nominal.model, equipment, truth);
    let mut last = hal.read()?;
    for step in 0..=rates.steps {
        let t = period * step as f64;
        each(t);
        reference.at(t, &mut sample);
        let frame = hal.read()?;
        let is_lost = step > 0 && frame.sequence == last.sequence;
        last = frame;
        let is_control = step % rates.per_control == 0;
        if is_control {
            let wrench = in_root_axes(&mut hal, &nominal.model, equipment, &frame);
            pilot.weigh(&sample, t)?;
            pilot.decide(&Measured { q: &frame.q[..n], tau: &frame.tau[..n], wrench }, &sample, t)?;
        }
        if step % rates.per_sample == 0 {
            log.record(t, (!is_lost).then_some(&frame), &sample);
        }
        if step < rates.steps {
            hal.plant_mut().expect_motion(&sample.q, &sample.v);
            pass(&mut hal, is_control.then_some(pilot.command.as_slice()), step as u64)?;
        }
    }
    Ok(log.finish(scenario))
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a period of 5 µs to 1 s, never negative")]
fn nanoseconds(period: f64) -> u64 {
    (period * 1e9).round() as u64
}

/// The drives as electronics, effects and sensors make them.
fn equipped(truth: &Robot, equipment: &Equipment, period: f64) -> Result<Vec<SimDrive>, SimError> {
    let model = &truth.model;
    if equipment.drives.len() != model.n_act() {
        return Err(SimError::NotTheSameRobot { what: "number of drives" });
    }
    let mut out = Vec::new();
    for (k, (&j, drive)) in model.actuators.iter().zip(&equipment.drives).enumerate() {
        let DriveEquipment { resolution, noise, offset, drift, velocity, effort, output, delay, lag, transmission, .. } = *drive;
        let chain = ActuatorChain::try_new(truth, j, period)?;
        if chain.recording_delay() > 0.0 {
            let what = format!("a recorder that is late at joint {:?}", model.joints[j].name);
            return Err(SimError::NotRepresentable { engine: "simulated hardware", what, problem: "it stamps its own frames" });
        }
        let mut encoder = Encoder::new(truth, j, resolution, noise).drifting(drift);
        encoder.offset += offset;
        out.push(SimDrive {
            output,
            chain: chain.followed_by(delay, lag)?,
            transmission: transmission.map(|p| ThreeMass::try_new(p, 0.0)).transpose()?,
            encoder,
            velocity: VelocitySensor::new(velocity, resolution),
            effort: ForceCell::new(effort, equipment.seed, k),
        });
    }
    Ok(out)
}

fn with_limb(plant: Box<dyn Plant>, nominal: &Robot, equipment: &Equipment, start: &Sample) -> Result<Box<dyn Plant>, SimError> {
    let Some(limb) = &equipment.limb else { return Ok(plant) };
    let patient = Some(Patient::try_new(limb.patient, limb.seed)?);
    Ok(match &limb.place {
        LimbPlace::Drives(joints) => Box::new(Worn::try_new(plant, joints.clone(), patient)?),
        LimbPlace::Link(link, axes) => Box::new(Strapped::try_new(plant, &nominal.model, *link, **axes, &start.q)?.with_patient(patient)),
    })
}

type Hardware = SimBackend<Box<dyn Plant>>;

/// The hardware with its further sensors: second encoders by drive, then wrench cells.
fn hardware(
    plant: Box<dyn Plant>,
    truth: &Robot,
    drives: Vec<SimDrive>,
    equipment: &Equipment,
    period_ns: u64,
) -> Result<Hardware, SimError> {
    let Equipment { seed, substeps, sampling, .. } = *equipment;
    let options = SimOptions { period_ns, substeps, seed, sampling, ..SimOptions::default() };
    let mut hal = SimBackend::try_new(plant, drives, &options)?;
    for (k, second) in equipment.drives.iter().enumerate() {
        if let Some(second) = second.second {
            let cell = ForceCell::new(second, equipment.seed, SECOND_ENCODERS + k);
            hal.add_sensor(move |plant| plant.load_position()[k], cell)?;
        }
    }
    for (sensor, cells) in &equipment.wrenches {
        let cell = |i: usize| ForceCell::new(cells[i], equipment.seed, WRENCH_CELLS + 6 * sensor + i);
        if truth.model.sensors.get(*sensor).is_none() {
            return Err(SimError::NotTheSameRobot { what: "sensors" });
        }
        hal.add_wrench(*sensor, core::array::from_fn(cell))?;
    }
    Ok(hal)
}

/// Commands, or lets the drives hold, and a base period passes.
fn pass(hal: &mut Hardware, command: Option<&[f64]>, step: u64) -> Result<(), SimError> {
    let passed = match command {
        Some(efforts) => {
            let mut frame = CommandFrame { sequence: step + 1, valid_until_ns: u64::MAX, ..CommandFrame::new(efforts.len(), Mode::Effort) };
            frame.tau[..efforts.len()].copy_from_slice(efforts);
            hal.write(&frame.sealed())
        }
        None => hal.elapse(),
    };
    passed.map_err(|refused: HalError| hal.fault().cloned().unwrap_or(SimError::Drives(refused)))
}

/// Number of second encoders, behind which the wrench cells are.
fn n_second(equipment: &Equipment) -> usize {
    equipment.drives.iter().filter(|d| d.second.is_some()).count()
}

/// What the first wrench sensor says, in the root's axes; zero where there is none.
fn in_root_axes(hal: &mut Hardware, model: &Model, equipment: &Equipment, frame: &StateFrame) -> [f64; 6] {
    let at = n_second(equipment);
    let (Some((i, _)), Some(cells)) = (equipment.wrenches.first(), frame.sensor.get(at..at + 6)) else { return [0.0; 6] };
    let Some(sensor) = model.sensors.get(*i) else { return [0.0; 6] };
    let Some((link, _)) = hal.plant_mut().link_motion(sensor.link) else { return [0.0; 6] };
    let rotation = link.compose(&sensor.pose).rotation;
    let turned = |x: &[f64]| rotation * nalgebra::Vector3::new(x[0], x[1], x[2]);
    let (force, moment) = (turned(&cells[..3]), turned(&cells[3..]));
    [force.x, force.y, force.z, moment.x, moment.y, moment.z]
}

/// A column of the recording: its name, where its samples come from, and its share of them.
struct Column {
    name: String,
    source: Source,
    share: f64,
    samples: Vec<f64>,
}

#[derive(Clone, Copy)]
enum Source {
    Frame(Signal, usize),
    Position(usize),
    Velocity(usize),
}

struct Log {
    name: String,
    time: Vec<f64>,
    columns: Vec<Column>,
    lost: usize,
}

impl Log {
    fn new(model: &Model, equipment: &Equipment, truth: &Robot) -> Self {
        let mut columns = Vec::new();
        let mut add = |name: String, source: Source, share: f64| columns.push(Column { name, source, share, samples: Vec::new() });
        let mut cell = 0;
        for (k, &j) in model.actuators.iter().enumerate() {
            let joint = &model.joints[j].name;
            let drive = &equipment.drives[k];
            let share: f64 = truth.chain(j, |law| matches!(law, Law::CommandShare)).map(|missing| 1.0 - missing).product();
            add(format!("q.{joint}"), Source::Frame(Signal::Position, k), 1.0);
            if drive.velocity != VelocitySensing::None {
                add(format!("dq.{joint}"), Source::Frame(Signal::Velocity, k), 1.0);
            }
            add(format!("tau.{joint}"), Source::Frame(Signal::Effort, k), share);
            add(format!("q_ref.{joint}"), Source::Position(k), 1.0);
            add(format!("dq_ref.{joint}"), Source::Velocity(k), 1.0);
            if drive.second.is_some() {
                add(format!("q_link.{joint}"), Source::Frame(Signal::Sensor, cell), 1.0);
                cell += 1;
            }
        }
        for (sensor, _) in &equipment.wrenches {
            for component in COMPONENTS {
                add(format!("wrench.{}.{component}", model.sensors[*sensor].name), Source::Frame(Signal::Sensor, cell), 1.0);
                cell += 1;
            }
        }
        Self { name: format!("{}, simulated", model.name), time: Vec::new(), columns, lost: 0 }
    }

    /// `frame` is none where it never arrived.
    fn record(&mut self, t: f64, frame: Option<&StateFrame>, sample: &Sample) {
        self.time.push(t);
        self.lost += usize::from(frame.is_none());
        for column in &mut self.columns {
            let value = match column.source {
                Source::Position(k) => sample.q[k],
                Source::Velocity(k) => sample.v[k],
                Source::Frame(signal, i) => frame.and_then(|f| f.measured(signal, i)).map_or(f64::NAN, |x| column.share * x),
            };
            column.samples.push(value);
        }
    }

    fn finish(self, scenario: &Scenario) -> Instrumented {
        let mut out = Recording { name: self.name, time: self.time, ..Recording::default() };
        for column in self.columns {
            out.signals.insert(column.name, column.samples);
        }
        out.meta.tau = Some(EffortKind::Measured);
        out.meta.other.insert("simulated_seed".to_string(), scenario.seed.to_string());
        out.meta.other.insert("simulated_lost".to_string(), self.lost.to_string());
        Instrumented { recording: out, lost: self.lost }
    }
}
