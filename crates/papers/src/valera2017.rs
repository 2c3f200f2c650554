//! Valera et al. 2017: the 3-PRS, its velocity observer, its identification, its force control \[Valera2017\].

mod base_parameters;
mod dynamics;
mod force;
mod identification;
mod kinematics;
mod observation;
mod observer;
mod position;
pub mod velocity;

use crate::error::PaperError;
use crate::row::Reproduction;

/// The paper's experiments.
pub(crate) fn reproduce(progress: crate::Progress) -> Result<Reproduction, PaperError> {
    let mut rows = position::rows()?;
    rows.extend(kinematics::rows()?);
    rows.extend(dynamics::rows()?);
    rows.extend(base_parameters::counts()?);
    rows.extend(base_parameters::combinations_of_set_1()?);
    progress(0.1);
    let (more, conditions) = base_parameters::condition_numbers(&mut |share| progress(0.1 + 0.2 * share))?;
    rows.extend(more);
    let (more, noise) = observer::noise()?;
    rows.extend(more);
    let (more, mut plots) = observer::table_2()?;
    rows.extend(more);
    rows.extend(observer::other_loops()?);
    progress(0.5);
    let (more, errors) = identification::rows(&mut |share| progress(0.5 + 0.3 * share))?;
    rows.extend(more);
    let (more, force) = force::rows(&mut |share| progress(0.8 + 0.2 * share))?;
    rows.extend(more);
    plots.extend([noise, conditions, errors, force]);
    Ok(Reproduction { rows, plots })
}
