//! A diagnosis, a scanned workspace, or an identification, as one HTML file: no network, no script, everything inline.

mod escape;
mod findings;
mod identification;
mod joints;
mod leftover;
mod numbers;
mod page;
mod replay;
mod tables;
mod workspace;

pub(crate) use escape::{esc, num};
pub use identification::identification_html;
pub(crate) use page::STYLE;
pub use page::html;
pub use workspace::workspace_html;
