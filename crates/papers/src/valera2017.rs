//! Valera et al. 2017: the 3-PRS, its velocity observer, its identification, its force control \[Valera2017\].

mod position;

use crate::error::PaperError;
use crate::row::Reproduction;

/// The paper's experiments.
pub(crate) fn reproduce(progress: crate::Progress) -> Result<Reproduction, PaperError> {
    let rows = position::rows()?;
    progress(1.0);
    Ok(Reproduction { rows, plots: Vec::new() })
}
