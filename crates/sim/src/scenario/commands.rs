//! A controller replayed on what it saw in a recording: no plant, so that its commands can be held against the recorded ones.

use alloc::collections::BTreeMap;

use pkm_ctrl::Running;
use pkm_dyn::effects::Robot;
use pkm_ident::Recording;

use super::drive_pds::DrivePds;
use super::pilot::{Measured, Pilot};
use super::rates::MAX_STEPS;
use crate::error::SimError;
use crate::reference::Sample;
use crate::replay::{RecordedReference, between, finite, under_stated_conditions};
use crate::trajectory::Trajectory;

/// Rate of the controller of [`crate::run`] where none is given `[Hz]`.
const RATE_HZ: f64 = 1000.0;

/// Commands of a controller that knows `nominal`, fed with the positions, efforts and references of `recording`: by joint name, at the
/// recording's samples `[N | N·m]`. Without a controller, that of [`crate::run`].
///
/// # Errors
/// A recording without references or with numbers that are not finite; a controller for another number of drives; its first fault.
pub fn replay_commands(
    controller: Option<Box<dyn Running>>,
    nominal: &Robot,
    recording: &Recording,
) -> Result<BTreeMap<String, Vec<f64>>, SimError> {
    let reference = RecordedReference::try_new(nominal, recording)?;
    let robot = under_stated_conditions(nominal, recording)?;
    let model = &robot.model;
    let names: Vec<&String> = model.actuators.iter().map(|&j| &model.joints[j].name).collect();
    let column = |prefix: &str| names.iter().map(|n| finite(recording, format!("{prefix}.{n}"))).collect::<Result<Vec<_>, _>>();
    let (q, tau) = (column("q")?, column("tau")?);
    let controller = match controller {
        Some(controller) => controller,
        None => Box::new(DrivePds::try_new(model, 1.0 / RATE_HZ)?),
    };
    let period = 1.0 / controller.about().rate_hz;
    let time: Vec<f64> = recording.time.iter().map(|t| t - recording.time[0]).collect();
    let steps = (recording.duration() / period).floor();
    if steps > MAX_STEPS {
        return Err(SimError::Scenario { what: "steps of the controller", value: steps, limit: "are too many for a replay" });
    }
    let mut sample = Sample::default();
    reference.at(0.0, &mut sample);
    let mut pilot = Pilot::try_new(controller, model, period, &sample)?;
    let mut at = Vec::new();
    let mut commands = vec![Vec::new(); names.len()];
    let mut step = 0.0;
    while step <= steps {
        let t = step * period;
        reference.at(t, &mut sample);
        pilot.weigh(&sample, t)?;
        let seen = |columns: &[Vec<f64>]| columns.iter().map(|c| between(&time, c, t)).collect::<Vec<f64>>();
        pilot.decide(&Measured { q: &seen(&q), tau: &seen(&tau), wrench: [0.0; 6] }, &sample, t)?;
        at.push(t);
        commands.iter_mut().zip(&pilot.command).for_each(|(all, command)| all.push(*command));
        step += 1.0;
    }
    let of = |all: &Vec<f64>| time.iter().map(|&t| between(&at, all, t)).collect();
    Ok(names.into_iter().cloned().zip(commands.iter().map(of)).collect())
}
