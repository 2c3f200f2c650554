//! Structured singular value μ: how large must an uncertainty of known structure be to make a loop singular?
//!
//! `1/μ(M) = min { σ(Δ) : det(I − M·Δ) = 0, Δ of the structure }` \[Packard1993\]. μ itself cannot be computed in reasonable time for
//! real parameters, so it is enclosed: [`upper_bound`] proves that nothing smaller than 1/β does harm, with scalings anyone can check;
//! [`lower_bound`] shows a perturbation that does. Neither bound rests on the iterations that found it.
//!
//! Conventions: z = M·w, w = Δ·z; M has `n_z` rows (columns of Δ) and `n_w` columns (rows of Δ).

use core::fmt;

mod ascent;
mod balance;
mod certificate;
mod gain;
mod hermitian;
mod interval;
mod lmi;
mod lower;
mod perturbation;
mod power;
mod response;
mod structure;
mod sweep;
mod system;
mod upper;

pub use certificate::Certificate;
pub use gain::{Gain, Performance, worst_case_gain};
pub use lower::{LowerBound, lower_bound};
pub use perturbation::{Perturbation, SINGULAR, Value};
pub use response::{Constant, Response};
pub use structure::{Block, Structure};
pub use sweep::{Guarantee, Point, Segment, Settings, Sweep, sweep};
pub use system::StateSpace;
pub use upper::{UpperBound, UpperStatus, scalings_for, upper_bound};

/// Complex matrix.
pub type CMatrix = nalgebra::DMatrix<nalgebra::Complex<f64>>;

/// What is wrong with the input of an analysis.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MuError {
    /// A structure without a block.
    #[error("the uncertainty has no block (at least 1 is needed)")]
    NoBlock,
    /// A block without rows or columns.
    #[error("block {}: size 0 (must be at least 1)", block + 1)]
    EmptyBlock {
        /// Index from 0.
        block: usize,
    },
    /// A matrix of other dimensions than the rest of the problem.
    #[error("{what}: {rows} x {cols} (must be {expected_rows} x {expected_cols})")]
    Shape {
        /// Name of the matrix.
        what: &'static str,
        /// Rows found.
        rows: usize,
        /// Columns found.
        cols: usize,
        /// Rows the rest asks for.
        expected_rows: usize,
        /// Columns the rest asks for.
        expected_cols: usize,
    },
    /// An entry that is no number, or infinite.
    #[error("{what}: entry ({}, {}) is {value} (must be finite)", row + 1, col + 1)]
    NotFinite {
        /// Name of the matrix.
        what: &'static str,
        /// Row from 0.
        row: usize,
        /// Column from 0.
        col: usize,
        /// The entry.
        value: f64,
    },
    /// A sample time that is none.
    #[error("sample time: {value} s (must be finite and > 0)")]
    SampleTime {
        /// The sample time `[s]`.
        value: f64,
    },
    /// A pole of the nominal system on the stability boundary, within the frequencies asked for.
    #[error("the nominal system has a pole at {w} rad/s (its response must be finite on the whole range)")]
    Pole {
        /// Its frequency `[rad/s]`.
        w: f64,
    },
    /// A range of frequencies that is none.
    #[error("frequencies: {lower} to {upper} rad/s (must be 0 <= lower < upper <= {limit})")]
    Range {
        /// Lower end `[rad/s]`.
        lower: f64,
        /// Upper end `[rad/s]`.
        upper: f64,
        /// Highest frequency of the system `[rad/s]`.
        limit: f64,
    },
}

/// Refuses numbers that are none; `values` run down the columns, two per complex entry.
fn must_be_finite(what: &'static str, values: impl Iterator<Item = f64>, rows: usize) -> Result<(), MuError> {
    for (i, value) in values.enumerate() {
        if !value.is_finite() {
            return Err(MuError::NotFinite { what, row: i / 2 % rows, col: i / 2 / rows, value });
        }
    }
    Ok(())
}

impl fmt::Display for Block {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Real { repeats } => write!(f, "real x {repeats}"),
            Self::Complex { repeats } => write!(f, "complex x {repeats}"),
            Self::Full { rows, cols } => write!(f, "full {rows} x {cols}"),
        }
    }
}
