//! Pictures as inline SVG, without a library: the page stays one file, and every picture follows its colours and its width.
//!
//! A picture stretches with the page, so what must keep its shape (text, dots, line widths) is not stretched: text is HTML placed in
//! per cent over the drawing, dots are round line ends, and strokes do not scale.

mod axis;
mod bars;
mod heat;
mod line;
mod plot;
mod scatter;

pub(crate) use axis::Axis;
pub use axis::Scale;
pub(crate) use bars::bar;
pub(crate) use heat::{Grid, LEVELS, cross};
pub(crate) use line::{decimate, path, spans};
pub(crate) use plot::{Frame, Plot};
pub(crate) use scatter::{curve, dots};
