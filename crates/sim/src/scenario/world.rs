//! Plant, controller, actuators and encoders of a run, and what they say of each other in every step.

use pkm_dyn::model::SensorKind;

use super::drive_pds::DrivePds;
use super::pilot::{Measured, Pilot};
use super::rates::Rates;
use super::{Scenario, Setup};
use crate::actuators::ActuatorChain;
use crate::error::SimError;
use crate::plant::Plant;
use crate::random::{Random, Stream};
use crate::reference::Sample;
use crate::sensors::Encoder;
use crate::trajectory::Trajectory;

/// Plant steps per base period: at 1 kHz the leapfrog's error is then below 1e-5 of the efforts.
const SUBSTEPS: usize = 2;

/// One drive with its actuator chain and encoder.
pub(super) struct Drive {
    pub(super) chain: ActuatorChain,
    encoder: Encoder,
    pub(super) reading: f64,
    /// Effort that is sent `[N | N·m]`.
    pub(super) command: f64,
}

/// What the controller will see, one entry per drive.
struct Seen {
    q: Vec<f64>,
    /// Effort that acted since the controller's last step, summed over so many steps of the plant.
    tau: Vec<f64>,
    acted: usize,
}

pub(super) struct World<'r> {
    plant: Box<dyn Plant>,
    pilot: Pilot<'r>,
    pub(super) drives: Vec<Drive>,
    pub(super) sample: Sample,
    random: Random,
    pub(super) period: f64,
    seen: Seen,
    tau: Vec<f64>,
}

impl<'r> World<'r> {
    pub(super) fn try_new(setup: Setup<'r>, scenario: &Scenario, reference: &dyn Trajectory, rates: &Rates) -> Result<Self, SimError> {
        let [truth, nominal] = setup.robots;
        let (model, period) = (&nominal.model, rates.period);
        let mut sample = Sample::default();
        reference.at(0.0, &mut sample);
        let controller = match setup.controller {
            Some(controller) => controller,
            None => Box::new(DrivePds::try_new(model, period)?),
        };
        let pilot = Pilot::try_new(controller, model, period * rates.per_control as f64, &sample)?.watched(setup.watch);
        let mut drives = Vec::new();
        for &j in &model.actuators {
            drives.push(Drive {
                chain: ActuatorChain::try_new(truth, j, period)?,
                encoder: Encoder::new(truth, j, scenario.encoder_resolution, scenario.encoder_noise),
                reading: 0.0,
                command: 0.0,
            });
        }
        let start: Vec<f64> = sample.q.iter().zip(&drives).map(|(q, d)| d.encoder.true_position(*q)).collect();
        let plant = scenario.plant.build_with_laws(truth, scenario.seed, &start, &sample.v, setup.laws)?;
        let zero = vec![0.0; drives.len()];
        let seen = Seen { q: zero.clone(), tau: zero.clone(), acted: 0 };
        Ok(Self { plant, pilot, drives, sample, random: Random::new(scenario.seed, Stream::Encoders), period, seen, tau: zero })
    }

    /// Reads the sensors at `t`; where `is_control` also computes the commands of the period that begins. What is sent is held.
    pub(super) fn control(&mut self, reference: &dyn Trajectory, t: f64, is_control: bool) -> Result<(), SimError> {
        reference.at(t, &mut self.sample);
        let Self { drives, plant, random, seen, .. } = self;
        for (k, drive) in drives.iter_mut().enumerate() {
            drive.reading = drive.encoder.read(plant.position()[k], t, random);
            seen.q[k] = drive.reading;
        }
        if is_control {
            self.decide(t)?;
        }
        let is_first = t <= 0.0;
        for drive in &mut self.drives {
            if is_first {
                drive.chain.settle(drive.command);
            }
            drive.chain.push(drive.command);
        }
        Ok(())
    }

    /// One step of the controller.
    fn decide(&mut self, t: f64) -> Result<(), SimError> {
        let wrench = self.wrench();
        let Self { pilot, sample, seen, drives, .. } = self;
        pilot.weigh(sample, t)?;
        if seen.acted == 0 {
            seen.tau.copy_from_slice(pilot.weight());
        } else {
            seen.tau.iter_mut().for_each(|tau| *tau /= seen.acted as f64);
        }
        pilot.decide(&Measured { q: &seen.q, tau: &seen.tau, wrench }, sample, t)?;
        drives.iter_mut().zip(&pilot.command).for_each(|(drive, command)| drive.command = *command);
        seen.tau.fill(0.0);
        seen.acted = 0;
        Ok(())
    }

    /// What the first wrench sensor says, in the root's axes; zero where there is none.
    fn wrench(&mut self) -> [f64; 6] {
        let Some(i) = self.pilot.nominal.sensors.iter().position(|s| s.kind == SensorKind::Wrench) else { return [0.0; 6] };
        let sensor = &self.pilot.nominal.sensors[i];
        let (Some(wrench), Some((link, _))) = (self.plant.sensor_wrench(i), self.plant.link_motion(sensor.link)) else { return [0.0; 6] };
        let rotation = link.compose(&sensor.pose).rotation;
        let (force, moment) = (rotation * wrench.linear, rotation * wrench.angular);
        [force.x, force.y, force.z, moment.x, moment.y, moment.z]
    }

    /// Moves the plant on by one base period.
    pub(super) fn advance(&mut self) -> Result<(), SimError> {
        let h = self.period / SUBSTEPS as f64;
        for part in 0..SUBSTEPS {
            for (k, drive) in self.drives.iter_mut().enumerate() {
                self.tau[k] = drive.chain.mean_over(h * part as f64, h);
                self.seen.tau[k] += self.tau[k];
            }
            self.seen.acted += 1;
            self.plant.step(&self.tau, h)?;
        }
        Ok(())
    }
}
