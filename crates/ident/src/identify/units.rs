//! The efforts of every recording beside those of the robot as its files have it: a unit that is a thousand times another one shows, and so does
//! a turned sign.

use crate::columns::{Columns, Quantity};
use crate::error::InputError;
use crate::mixed::{Pair, mixed};
use crate::motion::Motion;
use crate::note::Note;
use crate::observation::{Observation, Rows};
use crate::thousands::{Seen, other_units, seen};

/// Rows of one drive in one recording; NaN where the drive does not count, of its own columns only those where it does.
#[derive(Clone, Default)]
struct Series {
    effort: Vec<f64>,
    nominal: Vec<f64>,
    own: [Vec<f64>; 4],
}

/// What the recordings, those to judge on included, say against their units.
///
/// # Errors
/// Loops that do not close along a recording.
pub(super) fn notes(observation: &Observation<'_>) -> Result<Vec<Note>, InputError> {
    let model = &observation.robot().model;
    let all = series_of(observation)?;
    let notes = |(motion, drives): (&Motion, &Vec<Series>)| {
        let pairs: Vec<_> = drives.iter().map(|s| Pair { effort: &s.effort, model: &s.nominal }).collect();
        let units = other_units(model, &motion.name, &seen_each(drives)).into_iter().map(Note::OtherUnits);
        units.chain(mixed(model, &motion.name, &pairs).into_iter().map(Note::Mixed)).collect::<Vec<_>>()
    };
    Ok(observation.motions().iter().zip(&all).flat_map(notes).collect())
}

/// The efforts of every recording beside the model's, drive by drive.
///
/// # Errors
/// Loops that do not close along a recording.
pub(crate) fn seen_of(observation: &Observation<'_>) -> Result<Vec<Vec<Option<Seen>>>, InputError> {
    Ok(series_of(observation)?.iter().map(|drives| seen_each(drives)).collect())
}

fn seen_each(drives: &[Series]) -> Vec<Option<Seen>> {
    let counted = |x: &Vec<f64>| x.iter().copied().filter(|x| x.is_finite()).collect::<Vec<_>>();
    drives.iter().map(|s| seen(&counted(&s.effort), &counted(&s.nominal), &s.own)).collect()
}

/// Rows of every recording, [recording][drive].
fn series_of(observation: &Observation<'_>) -> Result<Vec<Vec<Series>>, InputError> {
    let (model, columns) = (&observation.robot().model, observation.columns());
    let nominal = columns.nominal();
    let own: Vec<[Option<usize>; 4]> = model.actuators.iter().map(|&joint| own_columns(columns, joint)).collect();
    let mut all = vec![vec![Series::default(); model.n_act()]; observation.motions().len()];
    for rows in [Rows::Fitted, Rows::HeldOut] {
        let mut visit = |block: &crate::observation::Block<'_>| {
            for (k, series) in all[block.recording].iter_mut().enumerate() {
                for i in 0..block.len() {
                    if !block.is_active(k, i) {
                        series.effort.push(f64::NAN);
                        series.nominal.push(f64::NAN);
                        continue;
                    }
                    let row = block.row(k, i);
                    let known = block.effort(k, i) - block.target(k, i);
                    series.effort.push(block.effort(k, i));
                    series.nominal.push(known + row.iter().zip(&nominal).map(|(w, x)| w * x).sum::<f64>());
                    for (out, at) in series.own.iter_mut().zip(&own[k]) {
                        out.push(at.map_or(0.0, |c| row[c]));
                    }
                }
            }
        };
        observation.each(rows, &mut visit, &mut |_| {})?;
    }
    Ok(all)
}

/// Columns of a drive itself: offset, viscous and dry friction, rotor.
fn own_columns(columns: &Columns, drive: usize) -> [Option<usize>; 4] {
    let at = |wanted: Quantity| columns.list.iter().position(|p| p.quantity == wanted);
    [
        Quantity::Offset { joint: drive },
        Quantity::Viscous { joint: drive },
        Quantity::Coulomb { joint: drive },
        Quantity::Rotor { joint: drive },
    ]
    .map(at)
}
