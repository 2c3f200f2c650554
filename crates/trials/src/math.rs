//! Transcendental functions with the same bits on every machine.
//!
//! nalgebra's own go through libm here (its feature `libm-force`), as do those of `pkm_dyn::math`, which this crate must not use.

use nalgebra::ComplexField;

/// Sine of `x` `[rad]`.
#[must_use]
pub fn sin(x: f64) -> f64 {
    ComplexField::sin(x)
}

/// Cosine of `x` `[rad]`.
#[must_use]
pub fn cos(x: f64) -> f64 {
    ComplexField::cos(x)
}

/// Exponential function.
#[must_use]
pub fn exp(x: f64) -> f64 {
    ComplexField::exp(x)
}

/// Natural logarithm.
#[must_use]
pub fn ln(x: f64) -> f64 {
    ComplexField::ln(x)
}

/// `x` to the power `p`.
#[must_use]
pub fn pow(x: f64, p: f64) -> f64 {
    ComplexField::powf(x, p)
}

/// Hyperbolic tangent.
#[must_use]
pub fn tanh(x: f64) -> f64 {
    ComplexField::tanh(x)
}
