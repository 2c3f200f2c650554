//! Lists of names as arguments: one name alone is a list of one.

use pyo3::prelude::*;

/// A name, or a sequence of names.
#[derive(FromPyObject)]
pub(crate) enum Names {
    One(String),
    Several(Vec<String>),
}

impl Names {
    /// All of them; none where nothing was given.
    pub(crate) fn all(given: Option<Self>) -> Vec<String> {
        match given {
            Some(Self::One(name)) => vec![name],
            Some(Self::Several(names)) => names,
            None => Vec::new(),
        }
    }
}
