//! The diagnosis, or a scanned workspace, as one HTML file: no network, no script, everything inline.

mod escape;
mod findings;
mod joints;
mod numbers;
mod page;
mod tables;
mod workspace;

pub(crate) use escape::{esc, num};
pub(crate) use page::STYLE;
pub use page::html;
pub use workspace::workspace_html;
