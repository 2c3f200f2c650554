//! A diagnosis, or an identification, as one HTML file: no network, no script, everything inline.

mod escape;
mod findings;
mod identification;
mod joints;
mod numbers;
mod page;
mod tables;

pub(crate) use escape::{esc, num};
pub use identification::identification_html;
pub use page::html;
