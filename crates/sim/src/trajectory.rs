//! What every motion of the drives has in common: it is known at every time, and it is checked against the robot before anything moves.

use pkm_dyn::Data;
use pkm_dyn::loops::{assemble, solve_positions, walk_to};
use pkm_dyn::model::Model;

use crate::error::SimError;
use crate::plant::check;
use crate::reference::{Reference, Sample};

/// Times at which drives are checked `[s]`.
const DRIVE_STEP: f64 = 1e-3;

/// Loops and passive joints are checked at every so many of them: they take a Newton solution each.
const LOOP_STRIDE: usize = 10;

/// Longest motion that is checked at every [`DRIVE_STEP`] `[steps]`; a longer one is checked at so many times.
const MAX_CHECKS: f64 = 1e6;

/// A motion of all drives with its velocity and acceleration.
pub trait Trajectory {
    /// The motion at time `t` `[s]`, written into `out`: one entry per drive.
    fn at(&self, t: f64, out: &mut Sample);
}

impl Trajectory for Reference {
    fn at(&self, t: f64, out: &mut Sample) {
        Reference::at(self, t, out);
    }
}

/// Checks the motion from time 0 to `duration_s` `[s]`: loops close, and positions of all joints and velocities of the drives stay within
/// the limits that `model` states.
///
/// # Errors
/// The first joint that leaves its limits, with time, value and limit; loops that do not close.
pub fn check_limits(model: &Model, trajectory: &dyn Trajectory, duration_s: f64) -> Result<(), SimError> {
    let mut sample = Sample::default();
    trajectory.at(0.0, &mut sample);
    if sample.q.len() != model.n_act() {
        return Err(SimError::NotTheSameRobot { what: "number of drives" });
    }
    let mut data = Data::new(model);
    check_drives(model, &sample, 0.0)?;
    for closure in [assemble(model, &mut data), walk_to(model, &mut data, &sample.q)] {
        check(&closure, 0.0)?;
    }
    let checks = (duration_s / DRIVE_STEP).ceil().clamp(1.0, MAX_CHECKS);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 1 and MAX_CHECKS")]
    let last = checks as usize;
    for i in 0..=last {
        let t = duration_s * (i as f64 / checks);
        trajectory.at(t, &mut sample);
        check_drives(model, &sample, t)?;
        if i % LOOP_STRIDE == 0 || i == last {
            check(&solve_positions(model, &mut data, &sample.q), t)?;
            for (j, &q) in data.q.iter().enumerate() {
                check_position(model, j, q, t)?;
            }
        }
    }
    Ok(())
}

fn check_drives(model: &Model, sample: &Sample, time: f64) -> Result<(), SimError> {
    for (k, &j) in model.actuators.iter().enumerate() {
        check_position(model, j, sample.q[k], time)?;
        let (v, most) = (sample.v[k], model.joints[j].limits.velocity);
        // No stated limit is 0 or infinite.
        if most > 0.0 && (v.is_nan() || v.abs() > most) {
            let joint = model.joints[j].name.clone();
            return Err(SimError::OutOfLimits { time, joint, what: "velocity", value: v, lower: -most, upper: most });
        }
    }
    Ok(())
}

fn check_position(model: &Model, j: usize, q: f64, time: f64) -> Result<(), SimError> {
    let limits = model.joints[j].limits;
    if limits.lower <= q && q <= limits.upper {
        return Ok(());
    }
    let joint = model.joints[j].name.clone();
    Err(SimError::OutOfLimits { time, joint, what: "position", value: q, lower: limits.lower, upper: limits.upper })
}
