//! What is wrong with the input of a design.

use nalgebra::DMatrix;

use super::mu::MuError;

/// Why a design has no answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DesignError {
    /// A system that is none.
    #[error(transparent)]
    System(#[from] MuError),
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
    /// A number outside its range.
    #[error("{what}: {value} ({limit})")]
    Value {
        /// Which number.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        limit: &'static str,
    },
    /// A matrix that had to be inverted and cannot be.
    #[error("{what} is singular")]
    Singular {
        /// Name of the matrix.
        what: &'static str,
    },
    /// Poles that are not as many as states, or complex ones without their conjugates.
    #[error("{found} poles for {states} states (one each is needed, complex ones in conjugate pairs)")]
    Poles {
        /// Poles found, those with a partner only.
        found: usize,
        /// States of the system.
        states: usize,
    },
    /// A mode that no input reaches, or no convergence for another reason.
    #[error("{what}: no solution (residual {residual:e}); is every mode that must be moved within reach of an input?")]
    NoSolution {
        /// What was sought.
        what: &'static str,
        /// Relative residual of the best answer.
        residual: f64,
    },
}

/// Refuses a matrix of another shape or with entries that are no numbers.
pub(super) fn must_be(what: &'static str, X: &DMatrix<f64>, expected_rows: usize, expected_cols: usize) -> Result<(), DesignError> {
    let (rows, cols) = X.shape();
    if (rows, cols) != (expected_rows, expected_cols) {
        return Err(DesignError::Shape { what, rows, cols, expected_rows, expected_cols });
    }
    for col in 0..cols {
        for row in 0..rows {
            let value = X[(row, col)];
            if !value.is_finite() {
                return Err(DesignError::NotFinite { what, row, col, value });
            }
        }
    }
    Ok(())
}

/// Refuses a number that is not finite and positive.
pub(super) fn must_be_positive(what: &'static str, value: f64) -> Result<(), DesignError> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { Err(DesignError::Value { what, value, limit: "must be finite and > 0" }) }
}

/// Inverse, or the name of what has none.
pub(super) fn inverse(what: &'static str, X: &DMatrix<f64>) -> Result<DMatrix<f64>, DesignError> {
    let inverse = X.clone().try_inverse().ok_or(DesignError::Singular { what })?;
    if inverse.iter().all(|x| x.is_finite()) { Ok(inverse) } else { Err(DesignError::Singular { what }) }
}
