//! McDaid, Tsoi and Xie: force control of a 4-UPS ankle robot in the coordinates of its legs \[McDaid\].

mod legs;

use crate::error::PaperError;
use crate::row::Reproduction;

/// The chapter's experiments.
pub(crate) fn reproduce(progress: crate::Progress) -> Result<Reproduction, PaperError> {
    let rows = legs::rows()?;
    progress(1.0);
    Ok(Reproduction { rows, plots: Vec::new() })
}
