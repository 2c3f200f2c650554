//! A diagnosis, a plan of one, or a scanned workspace, as one self-contained HTML page and as terminal text; an identification, and curves and tables of
//! anything else, as a page of the same kind.
//!
//! Both renderings show the same content in the same order: the answer, the held-out numbers, the findings with their proof, what was
//! ruled out, what could not have been seen. Nothing is computed here that the verdict does not already say, and no file is written.

/// Appends formatted text; writing to a `String` cannot fail.
macro_rules! put {
    ($out:expr, $($arg:tt)*) => {{
        use core::fmt::Write as _;
        let _ = write!($out, $($arg)*);
    }};
}

mod format;
mod html;
mod pose;
mod sheet;
mod svg;
mod terminal;
mod words;

pub use html::{HOPELESS, html, identification_html, plan_html, workspace_html};
pub use sheet::{Curve, Figure, Ink, Sheet, Table, Tone, sheet};
pub use svg::Scale;
pub use terminal::{Style, plan_terminal, terminal, workspace_terminal};
