//! What a recorder writes of a run.

use pkm_dyn::model::Model;
use pkm_ident::{EffortKind, Recording};

use super::world::World;
use super::{Scenario, whole};
use crate::random::{Random, Stream};
use crate::sensors::add_noise;

/// Signals by drive.
pub(super) struct Log {
    time: Vec<f64>,
    /// Commands of every control period: efforts are averaged over them.
    commands: Vec<Vec<f64>>,
    readings: Vec<Vec<f64>>,
    q_ref: Vec<Vec<f64>>,
    v_ref: Vec<Vec<f64>>,
    steps: usize,
}

impl Log {
    pub(super) fn new(n: usize) -> Self {
        let empty = vec![Vec::new(); n];
        Self { time: Vec::new(), commands: empty.clone(), readings: empty.clone(), q_ref: empty.clone(), v_ref: empty, steps: 0 }
    }

    pub(super) fn record(&mut self, world: &World, is_sample: bool) {
        for (k, drive) in world.drives.iter().enumerate() {
            self.commands[k].push(drive.command);
            if is_sample {
                self.readings[k].push(drive.reading);
                self.q_ref[k].push(world.sample.q[k]);
                self.v_ref[k].push(world.sample.v[k]);
            }
        }
        if is_sample {
            self.time.push(world.period * self.steps as f64);
        }
        self.steps += 1;
    }

    pub(super) fn finish(self, world: &World, model: &Model, scenario: &Scenario, per_sample: usize) -> Recording {
        let mut out = Recording { name: format!("{}, simulated", model.name), ..Recording::default() };
        let mut random = Random::new(scenario.seed, Stream::Efforts);
        let columns = self.readings.into_iter().zip(self.q_ref).zip(self.v_ref);
        for (k, ((readings, q_ref), v_ref)) in columns.enumerate() {
            let late = world.drives[k].chain.recording_delay() / world.period;
            let mut tau: Vec<f64> = (0..self.time.len()).map(|i| measured(&self.commands[k], (i * per_sample) as f64 - late)).collect();
            let share = world.drives[k].chain.recorded_share();
            tau.iter_mut().for_each(|tau| *tau *= share);
            add_noise(&mut tau, scenario.effort_noise, &mut random);
            let joint = &model.joints[model.actuators[k]].name;
            for (prefix, column) in [("q", readings), ("tau", tau), ("q_ref", q_ref), ("dq_ref", v_ref)] {
                out.signals.insert(format!("{prefix}.{joint}"), column);
            }
        }
        out.meta.tau = Some(EffortKind::Measured);
        out.meta.other.insert("simulated_seed".to_string(), scenario.seed.to_string());
        out.time = self.time;
        out
    }
}

/// Mean of the held commands over one control period on either side of time `at` (in periods).
///
/// A current sensor integrates; and taken on one side only, the hold would look like half a period of delay.
fn measured(commands: &[f64], at: f64) -> f64 {
    let floor = at.floor();
    let share = at - floor;
    let command = |i: f64| commands[whole(i.max(0.0)).min(commands.len() - 1)];
    0.5 * ((1.0 - share) * command(floor - 1.0) + command(floor) + share * command(floor + 1.0))
}
