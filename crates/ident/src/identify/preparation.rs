//! Recordings as they are fitted: after every step of preprocessing, clocks set right.

use pkm_dyn::effects::Robot;

use crate::Recording;
use crate::answer::Settings;
use crate::error::InputError;
use crate::estimate::least_squares;
use crate::estimate::weighted::scatter;
use crate::factor::{Factors, squared_error};
use crate::motion::Use;
use crate::observation::{Observation, Rows};
use crate::preprocess::time_offset::lowest;
use crate::preprocess::{Clock, Done, prepared, shifted};
use crate::shapes::independent;

/// Recordings after preprocessing, and what was done.
pub(crate) struct Prepared {
    pub(crate) fit: Vec<Recording>,
    pub(crate) holdout: Vec<Recording>,
    pub(crate) done: Vec<Done>,
}

impl Prepared {
    pub(crate) fn of(robot: &Robot, [fit, holdout]: [&[Recording]; 2], settings: &Settings) -> Result<Self, InputError> {
        let mut done = Vec::new();
        let mut each = |list: &[Recording]| -> Result<Vec<Recording>, InputError> {
            let mut out = Vec::new();
            for r in list {
                let (r, steps) = prepared(r, &settings.preprocess)?;
                done.extend(steps);
                out.push(r);
            }
            Ok(out)
        };
        let (mut fit, mut holdout) = (each(fit)?, each(holdout)?);
        let late = match settings.preprocess.clock {
            Clock::Stamped => return Ok(Self { fit, holdout, done }),
            Clock::Late(late) => late,
            Clock::Estimated(most) => lateness(robot, &fit, most, settings)?,
        };
        for r in fit.iter_mut().chain(&mut holdout) {
            done.push(Done::new(r, "clock of the efforts", "tau", &[("late_s", late)]));
            *r = shifted(r, late);
        }
        Ok(Self { fit, holdout, done })
    }
}

/// How late the efforts of all drives are: the shift with which the equations leave least of them.
fn lateness(robot: &Robot, fit: &[Recording], most: f64, settings: &Settings) -> Result<f64, InputError> {
    let left = |late: f64| -> Result<f64, InputError> {
        let moved: Vec<Recording> = fit.iter().map(|r| shifted(r, late)).collect();
        let pairs: Vec<(&Recording, Use)> = moved.iter().map(|r| (r, Use::Fit)).collect();
        let observation = Observation::try_new(robot, &pairs, settings.rows)?;
        let factors = Factors::of(&observation, Rows::Fitted, &mut |_| {})?;
        let weight = |k: usize| {
            let d = factors.drive(k);
            if d.effort_square() > 0.0 { (d.count() as f64 / d.effort_square()).sqrt() } else { 0.0 }
        };
        let weights: Vec<f64> = (0..factors.n_drives()).map(weight).collect();
        let triangle = factors.weighted(&weights).triangle();
        let kept = independent(&triangle);
        let theta = scatter(&least_squares::ordinary(&triangle, &kept), &kept, factors.n_columns());
        Ok(squared_error(&triangle, &theta))
    };
    left(0.0)?;
    Ok(lowest(|late| left(late).unwrap_or(f64::INFINITY), [-most, most], 1e-3 * most))
}
