//! A diagnosis, a plan, a scanned workspace, or an identification, as one HTML file: no network, no script, everything inline.

mod escape;
mod findings;
mod identification;
mod isolability;
mod joints;
mod leftover;
mod numbers;
mod page;
mod plan;
mod replay;
mod tables;
mod workspace;

pub(crate) use escape::{esc, num, prose};
pub use identification::{HOPELESS, identification_html};
pub(crate) use page::STYLE;
pub use page::html;
pub use plan::plan_html;
pub use workspace::workspace_html;
