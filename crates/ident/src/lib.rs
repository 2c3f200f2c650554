//! From time-aligned signals to what an estimator can use: uniform grids, zero-phase filters, derivatives, spectra.
//!
//! Knows no files (that is `pkm-record`) and no diagnosis (that is `pkm-diagnose`).

extern crate alloc;

pub mod base;
pub mod dataset;
pub mod filter;
pub mod grid;
pub mod spectrum;

pub use dataset::{EffortKind, KnownLoad, Meta, Recording};
