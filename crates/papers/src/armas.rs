//! Armas et al.: the 3UPS+1RPU, its base parameters, its exciting motion, its reduced model \[Armas\].

mod efforts;

use crate::error::PaperError;
use crate::row::Reproduction;

/// The paper's experiments.
pub(crate) fn reproduce(progress: crate::Progress) -> Result<Reproduction, PaperError> {
    let rows = efforts::rows()?;
    progress(1.0);
    Ok(Reproduction { rows, plots: Vec::new() })
}
