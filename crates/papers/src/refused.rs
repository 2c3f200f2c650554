//! What a library refuses, as an error of an experiment.

use crate::error::PaperError;

/// Wraps what a library says in the name of the experiment it was for.
pub(crate) fn refused<E: ToString>(what: &'static str) -> impl Fn(E) -> PaperError {
    move |e| PaperError::Other { what, reason: e.to_string() }
}
