//! The controller of a run: what it is given, the efforts it commands, and its fault as an error.

use pkm_ctrl::catalogue::Drives;
use pkm_ctrl::{Fault, FaultCode, Health, Running, Signals};
use pkm_dyn::Data;
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{assemble, walk_to};
use pkm_dyn::model::Model;

use crate::error::SimError;
use crate::plant::check;
use crate::reference::Sample;

/// What sensors said to a controller since its last step, one entry per drive.
pub(super) struct Measured<'m> {
    /// Positions `[m | rad]`.
    pub(super) q: &'m [f64],
    /// Efforts `[N | N·m]`.
    pub(super) tau: &'m [f64],
    /// Wrench in the root's axes, force first `[N, N·m]`.
    pub(super) wrench: [f64; 6],
}

/// One step of the controller of a run, as it was made.
#[derive(Debug, Clone, Copy)]
pub struct Step<'a> {
    /// Time of the run `[s]`.
    pub t: f64,
    /// Number of the step, from zero.
    pub number: u64,
    /// What the controller was given.
    pub signals: Signals<'a>,
    /// What it answered: efforts `[N | N·m]`, or voltages `[V]`.
    pub command: &'a [f64],
    /// How it went.
    pub health: Health,
}

/// Who is told every step.
pub type Watch<'r> = Box<dyn FnMut(&Step<'_>) + 'r>;

/// A controller with the nominal model whose weight it is fed.
pub(super) struct Pilot<'r> {
    controller: Box<dyn Running>,
    pub(super) nominal: &'r Model,
    data: Data,
    /// Its period `[s]`.
    period: f64,
    zero: Vec<f64>,
    sent: Vec<f64>,
    /// The command before, where commands are voltages.
    sent_last: Vec<f64>,
    /// Efforts for the drives `[N | N·m]`.
    pub(super) command: Vec<f64>,
    watch: Option<Watch<'r>>,
    steps: u64,
}

impl<'r> Pilot<'r> {
    pub(super) fn try_new(controller: Box<dyn Running>, nominal: &'r Model, period: f64, start: &Sample) -> Result<Self, SimError> {
        let n = nominal.n_act();
        if controller.about().n_drives != n || start.q.len() != n {
            return Err(SimError::NotTheSameRobot { what: "number of drives" });
        }
        let mut data = Data::new(nominal);
        for closure in [assemble(nominal, &mut data), walk_to(nominal, &mut data, &start.q)] {
            check(&closure, 0.0)?;
        }
        let zero = vec![0.0; n];
        let (sent, sent_last, command) = (zero.clone(), zero.clone(), zero.clone());
        Ok(Self { controller, nominal, data, period, zero, sent, sent_last, command, watch: None, steps: 0 })
    }

    /// Tells `watch` every step.
    pub(super) fn watched(self, watch: Option<Watch<'r>>) -> Self {
        Self { watch, ..self }
    }

    /// Efforts that hold the nominal robot where it was last weighed `[N | N·m]`.
    pub(super) fn weight(&self) -> &[f64] {
        self.data.tau_act.as_slice()
    }

    /// Weighs the nominal robot where `sample` is; surplus drives share the efforts.
    pub(super) fn weigh(&mut self, sample: &Sample, t: f64) -> Result<(), SimError> {
        check(&inverse_dynamics(self.nominal, &mut self.data, &sample.q, &self.zero, &self.zero), t)
    }

    /// One step towards `sample`, where the robot was weighed.
    pub(super) fn decide(&mut self, measured: &Measured<'_>, sample: &Sample, t: f64) -> Result<(), SimError> {
        let signals = Signals {
            dt: self.period,
            q_dt: self.period,
            q_meas: measured.q,
            tau_meas: measured.tau,
            wrench_meas: measured.wrench,
            q_ref: &sample.q,
            v_ref: &sample.v,
            a_ref: &sample.a,
            wrench_ref: [0.0; 6],
            tau_ff: self.data.tau_act.as_slice(),
        };
        let health = self.controller.step(&signals, &mut self.sent);
        if let Some(watch) = &mut self.watch {
            watch(&Step { t, number: self.steps, signals, command: &self.sent, health });
        }
        self.steps += 1;
        let about = self.controller.about();
        if health.is_faulted {
            let own = Fault { code: FaultCode::Controller, drive: 0, value: 0.0, limit: 0.0 };
            return Err(stopped(self.nominal, &about.name, t, &health.fault.unwrap_or(own)));
        }
        for (k, command) in self.command.iter_mut().enumerate() {
            // A drive that takes voltages makes an effort of their rate.
            *command = match about.drives {
                Drives::Effort => self.sent[k],
                Drives::Voltage => about.effort_per_rate[k] * (self.sent[k] - self.sent_last[k]) / self.period,
            };
        }
        self.sent_last.copy_from_slice(&self.sent);
        Ok(())
    }
}

/// A controller's fault as an error.
fn stopped(model: &Model, law: &str, time: f64, fault: &Fault) -> SimError {
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
