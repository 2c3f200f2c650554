//! Recordings as they are fitted: after every step of preprocessing, clocks set right.

use pkm_dyn::effects::Robot;

use crate::Recording;
use crate::answer::Settings;
use crate::error::InputError;
use crate::estimate::least_squares;
use crate::estimate::weighted::scatter;
use crate::factor::{Factors, squared_error};
use crate::motion::Use;
use crate::note::Note;
use crate::observation::{Observation, Rows};
use crate::preprocess::time_offset::lowest;
use crate::preprocess::{Clock, Done, prepared, shifted};
use crate::shapes::independent;

/// Recordings after preprocessing, and what was done.
pub(crate) struct Prepared {
    pub(crate) fit: Vec<Recording>,
    pub(crate) holdout: Vec<Recording>,
    pub(crate) done: Vec<Done>,
    pub(crate) notes: Vec<Note>,
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
            Clock::Stamped => return Ok(Self { fit, holdout, done, notes: Vec::new() }),
            Clock::Late(late) => late,
            Clock::Estimated(most) => match lateness(robot, &fit, most, settings)? {
                late if late.abs() < (1.0 - EDGE) * most => late,
                late_s => {
                    let notes = vec![Note::LatenessAtEdge { late_s, most_s: most }];
                    return Ok(Self { fit, holdout, done, notes });
                }
            },
        };
        for r in fit.iter_mut().chain(&mut holdout) {
            done.push(Done::new(r, "clock of the efforts", "tau", &[("late_s", late)]));
            *r = shifted(r, late);
        }
        Ok(Self { fit, holdout, done, notes: Vec::new() })
    }
}

/// A search that ends within this share of its range from an end has found the end and no lateness.
const EDGE: f64 = 5e-3;

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
        let all = factors.weighted(&weights);
        let triangle = all.triangle();
        let kept = independent(&triangle);
        let theta = scatter(&least_squares::ordinary(&triangle, &kept), &kept, factors.n_columns());
        // A shift loses rows at the ends: fewer rows are no better rows.
        Ok(squared_error(&triangle, &theta) / all.count().max(1) as f64)
    };
    left(0.0)?;
    Ok(lowest(|late| left(late).unwrap_or(f64::INFINITY), [-most, most], 1e-3 * most))
}
