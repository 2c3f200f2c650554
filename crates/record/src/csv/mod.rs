//! CSV, the plain import format: one line per sample, one column per signal, `# key = value` lines before the header.

mod read;
mod write;

pub(crate) use read::parse;
pub(crate) use write::write;
