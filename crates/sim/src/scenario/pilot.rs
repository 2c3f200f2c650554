//! The controller of a run on simulated hardware: what it is given of a frame, and the efforts it commands.

use pkm_ctrl::catalogue::Drives;
use pkm_ctrl::{Fault, FaultCode, Running, Signals};
use pkm_dyn::Data;
use pkm_dyn::inverse_dynamics::inverse_dynamics;
use pkm_dyn::loops::{assemble, walk_to};
use pkm_dyn::model::Model;
use pkm_hal::StateFrame;

use super::world::stopped;
use crate::error::SimError;
use crate::plant::check;
use crate::reference::Sample;

/// A controller with the nominal model whose weight it is fed.
pub(super) struct Pilot<'r> {
    controller: Box<dyn Running>,
    nominal: &'r Model,
    data: Data,
    /// Its period `[s]`.
    period: f64,
    zero: Vec<f64>,
    sent: Vec<f64>,
    /// The command before, where commands are voltages.
    sent_last: Vec<f64>,
    /// Efforts for the drives `[N | N·m]`.
    pub(super) command: Vec<f64>,
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
        let mut pilot = Self { controller, nominal, data, period, zero, sent, sent_last, command };
        pilot.weigh(start, 0.0)?;
        pilot.command.copy_from_slice(pilot.data.tau_act.as_slice());
        Ok(pilot)
    }

    /// Puts the efforts that hold the nominal robot where `sample` is into `data`; surplus drives share them.
    fn weigh(&mut self, sample: &Sample, t: f64) -> Result<(), SimError> {
        check(&inverse_dynamics(self.nominal, &mut self.data, &sample.q, &self.zero, &self.zero), t)
    }

    /// One step on the newest frame that arrived and a wrench in the root's axes.
    pub(super) fn decide(&mut self, frame: &StateFrame, wrench_meas: [f64; 6], sample: &Sample, t: f64) -> Result<(), SimError> {
        self.weigh(sample, t)?;
        let n = self.zero.len();
        let signals = Signals {
            dt: self.period,
            q_meas: &frame.q[..n],
            tau_meas: &frame.tau[..n],
            wrench_meas,
            q_ref: &sample.q,
            v_ref: &sample.v,
            a_ref: &sample.a,
            wrench_ref: [0.0; 6],
            tau_ff: self.data.tau_act.as_slice(),
        };
        let health = self.controller.step(&signals, &mut self.sent);
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
