//! What is analysed at a frequency: a frequency response, or one matrix.

use super::CMatrix;

/// A matrix that depends on a frequency.
pub trait Response {
    /// M at frequency `w` `[rad/s]`; none at a pole.
    fn at(&self, w: f64) -> Option<CMatrix>;

    /// Derivative of M with respect to the frequency.
    fn slope(&self, w: f64) -> Option<CMatrix>;
}

/// One matrix, at every frequency.
#[derive(Debug, Clone, PartialEq)]
pub struct Constant(pub CMatrix);

impl Response for Constant {
    fn at(&self, _: f64) -> Option<CMatrix> {
        Some(self.0.clone())
    }

    fn slope(&self, _: f64) -> Option<CMatrix> {
        Some(CMatrix::zeros(self.0.nrows(), self.0.ncols()))
    }
}
