//! From time-aligned signals to the parameters of a robot: uniform grids, zero-phase filters, the observation matrix, base parameters,
//! estimators, and how far they can be trusted. [`identify()`] is all of it.
//!
//! Knows no files (that is `pkm-record`) and no diagnosis (that is `pkm-diagnose`).

extern crate alloc;

pub mod answer;
pub mod base;
pub mod beside;
pub mod bulk;
pub mod columns;
pub mod dataset;
pub mod degrees;
pub mod distributions;
mod electronics;
pub mod error;
pub mod estimate;
pub mod excitation;
pub mod factor;
pub mod filter;
pub mod gains;
pub mod gram;
pub mod grid;
pub mod grouping;
pub mod identify;
pub mod minimise;
pub mod mixed;
pub mod motion;
pub mod note;
pub mod observation;
pub mod output_error;
pub mod payload;
pub mod preprocess;
pub mod refine;
pub mod relevant;
pub mod seconds;
pub mod shapes;
pub mod size;
pub mod spectrum;
pub mod statistics;
pub mod thousands;
mod walk;

pub use answer::{Identification, IdentifyError, Intervals, Settings, Shapes, Simulate, Term};
pub use error::InputError;
pub use excitation::excite;
pub use identify::{identify, identify_in_closed_loop};

pub use dataset::{EffortKind, KnownLoad, Meta, Recording};
