//! Shipped robots and poses of theirs.

use pkm_dyn::loops::{Closure, assemble, walk_to};
use pkm_dyn::urdf::{Description, parse};
use pkm_dyn::{Data, Model};

use crate::error::PaperError;

/// The shipped robot of that name.
pub(crate) fn shipped(name: &'static str) -> Result<Description, PaperError> {
    let bad = |reason: String| PaperError::Robot { name, reason };
    let files = pkm_robots::find(name).ok_or_else(|| bad("is not shipped".to_string()))?;
    parse(files.toml, files.urdf, [files.toml_name, files.urdf_name]).map_err(|e| bad(e.to_string()))
}

/// Positions of the tree with the drives at `q_act` `[m | rad]`, reached from the assembly.
pub(crate) fn closed_at(model: &Model, data: &mut Data, q_act: &[f64], what: &'static str) -> Result<(), PaperError> {
    for closure in [assemble(model, data), walk_to(model, data, q_act)] {
        closed(&closure, what)?;
    }
    Ok(())
}

/// An open loop as an error.
pub(crate) fn closed(closure: &Closure, what: &'static str) -> Result<(), PaperError> {
    if closure.is_closed { Ok(()) } else { Err(PaperError::Open { what, gap: closure.gap }) }
}
