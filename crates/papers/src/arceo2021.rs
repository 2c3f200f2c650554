//! Arceo et al. 2021: motoBOTTE, computed torque against active disturbance rejection \[Arceo2021\].

mod dynamics;
mod equations;
pub mod exercises;
mod friction;
mod gains;
mod geometry;
mod identification;
mod projected_mass;
mod references;
mod tracking;

pub use tracking::on_the_whole_robot;

use crate::error::PaperError;
use crate::row::Reproduction;

/// The paper's experiments.
pub(crate) fn reproduce(progress: crate::Progress) -> Result<Reproduction, PaperError> {
    let mut rows = geometry::rows()?;
    rows.extend(dynamics::rows()?);
    let (more, mass) = projected_mass::rows()?;
    rows.extend(more);
    rows.extend(friction::rows());
    rows.extend(identification::rows()?);
    rows.extend(gains::rows());
    progress(0.3);
    let (more, beating) = tracking::rows(&mut |share| progress(0.3 + 0.5 * share))?;
    rows.extend(more);
    rows.extend(references::rows()?);
    let (more, mut plots) = exercises::rows()?;
    rows.extend(more);
    progress(1.0);
    plots.extend([beating, mass]);
    Ok(Reproduction { rows, plots })
}
