//! Plant, controller, actuators and encoders of a run, and what they say of each other in every step.

use pkm_ctrl::catalogue::Drives;
use pkm_ctrl::{Fault, FaultCode, Running, Signals};
use pkm_dyn::Data;
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{assemble, walk_to};
use pkm_dyn::model::{Model, SensorKind};

use super::drive_pds::DrivePds;
use super::rates::Rates;
use super::{Scenario, Setup};
use crate::actuators::ActuatorChain;
use crate::error::SimError;
use crate::plant::{Plant, check};
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

/// Room for what the controller sees and says, one entry per drive.
struct Exchange {
    q_meas: Vec<f64>,
    /// Mean effort that acted since the controller's last step.
    tau_meas: Vec<f64>,
    acted: usize,
    sent: Vec<f64>,
    /// The command before, where commands are voltages.
    sent_last: Vec<f64>,
}

pub(super) struct World<'r> {
    plant: Box<dyn Plant>,
    controller: Box<dyn Running>,
    nominal: &'r Model,
    nominal_data: Data,
    pub(super) drives: Vec<Drive>,
    pub(super) sample: Sample,
    random: Random,
    pub(super) period: f64,
    control_period: f64,
    exchange: Exchange,
    tau: Vec<f64>,
    zero: Vec<f64>,
}

impl<'r> World<'r> {
    pub(super) fn try_new(setup: Setup<'r>, scenario: &Scenario, reference: &dyn Trajectory, rates: &Rates) -> Result<Self, SimError> {
        let [truth, nominal] = setup.robots;
        let (model, period) = (&nominal.model, rates.period);
        let mut sample = Sample::default();
        reference.at(0.0, &mut sample);
        if sample.q.len() != model.n_act() {
            return Err(SimError::NotTheSameRobot { what: "number of drives" });
        }
        let controller = match setup.controller {
            Some(controller) => controller,
            None => Box::new(DrivePds::try_new(model, period)?),
        };
        if controller.about().n_drives != model.n_act() {
            return Err(SimError::NotTheSameRobot { what: "number of drives" });
        }
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
        let n = drives.len();
        let mut nominal_data = Data::new(model);
        for closure in [assemble(model, &mut nominal_data), walk_to(model, &mut nominal_data, &sample.q)] {
            check(&closure, 0.0)?;
        }
        let plant = scenario.plant.build_with_laws(truth, scenario.seed, &start, &sample.v, setup.laws)?;
        let zero = vec![0.0; n];
        let exchange = Exchange { q_meas: zero.clone(), tau_meas: zero.clone(), acted: 0, sent: zero.clone(), sent_last: zero.clone() };
        Ok(Self {
            plant,
            controller,
            nominal: model,
            nominal_data,
            drives,
            sample,
            random: Random::new(scenario.seed, Stream::Encoders),
            period,
            control_period: period * rates.per_control as f64,
            exchange,
            tau: zero.clone(),
            zero,
        })
    }

    /// Reads the sensors at `t`; where `is_control` also computes the commands of the period that begins. What is sent is held.
    pub(super) fn control(&mut self, reference: &dyn Trajectory, t: f64, is_control: bool) -> Result<(), SimError> {
        reference.at(t, &mut self.sample);
        let Self { drives, plant, random, exchange, .. } = self;
        for (k, drive) in drives.iter_mut().enumerate() {
            drive.reading = drive.encoder.read(plant.position()[k], t, random);
            exchange.q_meas[k] = drive.reading;
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
        let wrench_meas = self.wrench();
        let Self { nominal_data, sample, zero, controller, exchange, .. } = self;
        let closure = inverse_dynamics(self.nominal, nominal_data, &sample.q, zero, zero);
        check(&closure, t)?;
        let weight = &nominal_data.tau_act;
        if exchange.acted == 0 {
            exchange.tau_meas.copy_from_slice(weight.as_slice());
        } else {
            exchange.tau_meas.iter_mut().for_each(|tau| *tau /= exchange.acted as f64);
        }
        let signals = Signals {
            dt: self.control_period,
            q_meas: &exchange.q_meas,
            tau_meas: &exchange.tau_meas,
            wrench_meas,
            q_ref: &sample.q,
            v_ref: &sample.v,
            a_ref: &sample.a,
            wrench_ref: [0.0; 6],
            tau_ff: weight.as_slice(),
        };
        let health = controller.step(&signals, &mut exchange.sent);
        if health.is_faulted {
            let own = Fault { code: FaultCode::Controller, drive: 0, value: 0.0, limit: 0.0 };
            return Err(stopped(self.nominal, &controller.about().name, t, &health.fault.unwrap_or(own)));
        }
        let about = controller.about();
        for (k, drive) in self.drives.iter_mut().enumerate() {
            // A drive that takes voltages makes an effort of their rate.
            drive.command = match about.drives {
                Drives::Effort => exchange.sent[k],
                Drives::Voltage => about.effort_per_rate[k] * (exchange.sent[k] - exchange.sent_last[k]) / self.control_period,
            };
        }
        exchange.sent_last.copy_from_slice(&exchange.sent);
        exchange.tau_meas.fill(0.0);
        exchange.acted = 0;
        Ok(())
    }

    /// What the first wrench sensor says, in the root's axes; zero where there is none.
    fn wrench(&mut self) -> [f64; 6] {
        let Some(i) = self.nominal.sensors.iter().position(|s| s.kind == SensorKind::Wrench) else { return [0.0; 6] };
        let sensor = &self.nominal.sensors[i];
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
                self.exchange.tau_meas[k] += self.tau[k];
            }
            self.exchange.acted += 1;
            self.plant.step(&self.tau, h)?;
        }
        Ok(())
    }
}

/// A controller's fault as an error.
pub(super) fn stopped(model: &Model, law: &str, time: f64, fault: &Fault) -> SimError {
    let joint = |k: usize| model.actuators.get(k).map_or(String::new(), |&j| format!(" at joint {:?}", model.joints[j].name));
    let place = match fault.code {
        FaultCode::Wrench | FaultCode::WrenchNotFinite => {
            format!(" in {}", ["fx", "fy", "fz", "mx", "my", "mz"].get(fault.drive).copied().unwrap_or("a component"))
        }
        FaultCode::Late | FaultCode::Frozen | FaultCode::Controller => String::new(),
        _ => joint(fault.drive),
    };
    SimError::Fault { law: law.to_string(), code: fault.code, place, time, value: fault.value, limit: fault.limit }
}
