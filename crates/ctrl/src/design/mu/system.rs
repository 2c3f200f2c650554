//! State space in continuous or discrete time, as a frequency response.

use alloc::vec::Vec;

use nalgebra::{Complex, DMatrix};

use super::response::Response;
use super::{CMatrix, MuError, must_be_finite};
use crate::design::margin::eigenvalues;

/// `z = C·x + D·w` with `x' = A·x + B·w`, or with `x` one sample later when there is a sample time.
#[derive(Debug, Clone, PartialEq)]
pub struct StateSpace {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    c: DMatrix<f64>,
    d: DMatrix<f64>,
    dt: Option<f64>,
}

impl StateSpace {
    /// Checks dimensions and numbers; `dt` is the sample time `[s]` of a discrete system.
    ///
    /// # Errors
    /// Dimensions that do not fit, entries that are not finite, a sample time that is not positive.
    pub fn try_new([a, b, c, d]: [DMatrix<f64>; 4], dt: Option<f64>) -> Result<Self, MuError> {
        let (n, m, p) = (a.nrows(), d.ncols(), d.nrows());
        for (what, X, rows, cols) in [("A", &a, n, n), ("B", &b, n, m), ("C", &c, p, n), ("D", &d, p, m)] {
            if X.shape() != (rows, cols) {
                let (found_rows, found_cols) = X.shape();
                return Err(MuError::Shape { what, rows: found_rows, cols: found_cols, expected_rows: rows, expected_cols: cols });
            }
            must_be_finite(what, X.iter().flat_map(|x| [*x, 0.0]), rows)?;
        }
        match dt {
            Some(value) if !(value.is_finite() && value > 0.0) => Err(MuError::SampleTime { value }),
            _ => Ok(Self { a, b, c, d, dt }),
        }
    }

    /// A, B, C, D.
    #[must_use]
    pub fn matrices(&self) -> [&DMatrix<f64>; 4] {
        [&self.a, &self.b, &self.c, &self.d]
    }

    /// Sample time `[s]` of a discrete system.
    #[must_use]
    pub fn dt(&self) -> Option<f64> {
        self.dt
    }

    /// Eigenvalues of A.
    #[must_use]
    pub fn poles(&self) -> Vec<Complex<f64>> {
        eigenvalues(&self.a)
    }

    /// The pole closest to instability and its distance: minus the real part, or one minus the modulus; negative when unstable.
    /// None without states.
    #[must_use]
    pub fn stability(&self) -> Option<(Complex<f64>, f64)> {
        let distance = |p: &Complex<f64>| if self.dt.is_some() { 1.0 - pkm_dyn::math::hypot(p.re, p.im) } else { -p.re };
        self.poles().into_iter().map(|p| (p, distance(&p))).min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Highest frequency that means anything `[rad/s]`: half the sample rate, or infinity.
    #[must_use]
    pub fn nyquist(&self) -> f64 {
        self.dt.map_or(f64::INFINITY, |dt| core::f64::consts::PI / dt)
    }

    /// The point s or z that belongs to a frequency, and its derivative.
    fn point(&self, w: f64) -> [Complex<f64>; 2] {
        match self.dt {
            None => [Complex::new(0.0, w), Complex::new(0.0, 1.0)],
            Some(dt) => {
                let (sin, cos) = pkm_dyn::math::sin_cos(w * dt);
                [Complex::new(cos, sin), Complex::new(-dt * sin, dt * cos)]
            }
        }
    }

    /// (point·I − A)⁻¹ times each right-hand side in turn.
    fn resolvent(&self, point: Complex<f64>) -> Option<nalgebra::LU<Complex<f64>, nalgebra::Dyn, nalgebra::Dyn>> {
        let n = self.a.nrows();
        let mut S = complex(&self.a);
        S.iter_mut().for_each(|s| *s = -*s);
        (0..n).for_each(|i| S[(i, i)] += point);
        let lu = S.lu();
        lu.is_invertible().then_some(lu)
    }

    /// The same frequency response as a continuous system of another frequency Ω = tan(w·dt/2), by the bilinear map z = (1 + s)/(1 − s);
    /// a continuous system is returned as it is.
    ///
    /// # Errors
    /// A pole at z = −1, which the map sends to infinity.
    pub(crate) fn continuous(&self) -> Result<Self, MuError> {
        if self.dt.is_none() {
            return Ok(self.clone());
        }
        let n = self.a.nrows();
        let one = DMatrix::identity(n, n);
        let lu = (&self.a + &one).lu();
        let pole = || MuError::Pole { w: self.nyquist() };
        let a = lu.solve(&(&self.a - &one)).ok_or_else(pole)?;
        let b = lu.solve(&self.b).ok_or_else(pole)?;
        let d = &self.d - &self.c * &b;
        let right = (&self.a + &one).transpose().lu().solve(&self.c.transpose()).ok_or_else(pole)?;
        let root = core::f64::consts::SQRT_2;
        Self::try_new([a, b * root, right.transpose() * root, d], None)
    }
}

impl Response for StateSpace {
    fn at(&self, w: f64) -> Option<CMatrix> {
        let D = complex(&self.d);
        if self.a.nrows() == 0 || !w.is_finite() {
            return Some(D);
        }
        let X = self.resolvent(self.point(w)[0])?.solve(&complex(&self.b))?;
        let M = complex(&self.c) * X + D;
        M.iter().all(|m| m.re.is_finite() && m.im.is_finite()).then_some(M)
    }

    fn slope(&self, w: f64) -> Option<CMatrix> {
        if self.a.nrows() == 0 || !w.is_finite() {
            return Some(CMatrix::zeros(self.d.nrows(), self.d.ncols()));
        }
        let [point, along] = self.point(w);
        let lu = self.resolvent(point)?;
        let X = lu.solve(&lu.solve(&complex(&self.b))?)?;
        Some(complex(&self.c) * X * -along)
    }
}

pub(crate) fn complex(A: &DMatrix<f64>) -> CMatrix {
    A.map(|a| Complex::new(a, 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn system(dt: Option<f64>) -> StateSpace {
        let a = DMatrix::from_row_slice(2, 2, &[0.3, 0.5, -0.4, 0.1]);
        let b = DMatrix::from_row_slice(2, 1, &[1.0, -2.0]);
        let c = DMatrix::from_row_slice(1, 2, &[0.7, 0.2]);
        StateSpace::try_new([a, b, c, DMatrix::from_element(1, 1, 0.4)], dt).unwrap()
    }

    #[test]
    fn the_bilinear_map_keeps_the_response() {
        let discrete = system(Some(0.1));
        let continuous = discrete.continuous().unwrap();
        for w in [0.01, 1.0, 20.0, 31.0] {
            let (M, N) = (discrete.at(w).unwrap(), continuous.at(pkm_dyn::math::tan(w * 0.05)).unwrap());
            assert!((M - N).norm() < 1e-12);
        }
    }

    #[test]
    fn the_slope_is_the_difference_quotient() {
        for s in [system(None), system(Some(0.1))] {
            let (w, h) = (1.7, 1e-5);
            let difference = (s.at(w + h).unwrap() - s.at(w - h).unwrap()) / Complex::new(2.0 * h, 0.0);
            assert!((difference - s.slope(w).unwrap()).norm() < 1e-8);
        }
    }

    #[test]
    fn wrong_dimensions_and_sample_times_are_named() {
        let m = |r, c| DMatrix::<f64>::zeros(r, c);
        let text = |e: Result<StateSpace, MuError>| alloc::string::ToString::to_string(&e.unwrap_err());
        assert_eq!(text(StateSpace::try_new([m(2, 2), m(2, 1), m(1, 3), m(1, 1)], None)), "C: 1 x 3 (must be 1 x 2)");
        assert_eq!(text(StateSpace::try_new([m(2, 2), m(2, 1), m(1, 2), m(1, 1)], Some(0.0))), "sample time: 0 s (must be finite and > 0)");
        let text = text(StateSpace::try_new([m(1, 1), m(1, 1), m(1, 1), DMatrix::from_element(1, 1, f64::NAN)], None));
        assert_eq!(text, "D: entry (1, 1) is NaN (must be finite)");
    }
}
