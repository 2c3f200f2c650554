//! Minimisation over a handful of parameters, where a function value is a whole simulation: without derivatives ([`nelder_mead`]), and of
//! sums of squares with differences ([`levenberg_marquardt`]).
//!
//! A trial that cannot be evaluated (a simulation that fails) is infinitely bad, never an error.

pub mod levenberg_marquardt;
pub mod nelder_mead;

/// How a search ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// Steps and improvements fell below their tolerances.
    Settled,
    /// The number of evaluations ran out.
    OutOfBudget,
    /// The start itself cannot be evaluated.
    NoStart,
}

/// Bounds of one parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest value.
    pub lower: f64,
    /// Largest value.
    pub upper: f64,
}

impl Bounds {
    /// No bounds at all.
    pub const NONE: Self = Self { lower: f64::NEG_INFINITY, upper: f64::INFINITY };

    /// The nearest value within.
    #[must_use]
    pub fn clamp(&self, x: f64) -> f64 {
        x.max(self.lower).min(self.upper)
    }
}
