//! Arceo et al. 2021: motoBOTTE, computed torque against active disturbance rejection \[Arceo2021\].

mod geometry;
mod projected_mass;

use crate::error::PaperError;
use crate::row::Reproduction;

/// The paper's experiments.
pub(crate) fn reproduce(progress: crate::Progress) -> Result<Reproduction, PaperError> {
    let (rows, plot) = projected_mass::rows()?;
    progress(1.0);
    Ok(Reproduction { rows, plots: vec![plot] })
}
