//! A gain over a singular value: piecewise linear, constant beyond its ends.

use crate::controller::ConfigError;

/// Breakpoints that a [`GainCurve`] has room for.
pub const MOST_POINTS: usize = 8;

/// A piecewise-linear gain \[McDaid, Figure 8.14\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GainCurve {
    points: [[f64; 2]; MOST_POINTS],
    len: usize,
}

impl GainCurve {
    /// The same gain everywhere.
    #[must_use]
    pub const fn constant(gain: f64) -> Self {
        Self { points: [[0.0, gain]; MOST_POINTS], len: 1 }
    }

    /// Through `points` of (singular value `[kg]`, gain), values rising.
    ///
    /// # Errors
    /// No point or more than [`MOST_POINTS`], values that do not rise, gains that are negative, anything that is not finite.
    pub fn try_new(points: &[[f64; 2]]) -> Result<Self, ConfigError> {
        let bad = |drive, what, value, limit| Err(ConfigError { drive, what, value, limit });
        if points.is_empty() || points.len() > MOST_POINTS {
            return bad(0, "number of breakpoints", points.len() as f64, "must be 1 to 8");
        }
        let mut out = Self::constant(0.0);
        for (k, &[value, gain]) in points.iter().enumerate() {
            if !(value.is_finite() && (k == 0 || value > points[k - 1][0])) {
                return bad(k, "breakpoint", value, "must be finite and above the one before");
            }
            if !(gain.is_finite() && gain >= 0.0) {
                return bad(k, "gain", gain, "must be finite and >= 0");
            }
            out.points[k] = [value, gain];
        }
        out.len = points.len();
        Ok(out)
    }

    /// The gain at a singular value `[kg]`; the first one where that is no number.
    #[must_use]
    pub fn at(&self, value: f64) -> f64 {
        let points = &self.points[..self.len];
        let after = points.iter().position(|p| p[0] > value).unwrap_or(if value.is_nan() { 0 } else { self.len });
        if after == 0 {
            return points[0][1];
        }
        let [x0, y0] = points[after - 1];
        points.get(after).map_or(y0, |&[x1, y1]| y0 + (y1 - y0) * (value - x0) / (x1 - x0))
    }

    /// Largest gain of the curve.
    #[must_use]
    pub fn most(&self) -> f64 {
        self.points[..self.len].iter().fold(0.0, |most, p| most.max(p[1]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_between_points_and_constants_beyond() {
        let curve = GainCurve::try_new(&[[2.0, 60.0], [3.0, 40.0], [10.0, 5.0]]).unwrap();
        for (value, want) in [(0.0, 60.0), (2.0, 60.0), (2.5, 50.0), (3.0, 40.0), (6.5, 22.5), (10.0, 5.0), (1e9, 5.0), (f64::NAN, 60.0)] {
            assert!((curve.at(value) - want).abs() < 1e-12, "{value}: {}", curve.at(value));
        }
        assert!((curve.most() - 60.0).abs() < 1e-15 && (GainCurve::constant(7.0).at(-3.0) - 7.0).abs() < 1e-15);
        for bad in [&[][..], &[[1.0, 1.0], [1.0, 2.0]], &[[1.0, -1.0]], &[[f64::NAN, 1.0]], &[[1.0, 1.0]; 9]] {
            assert!(GainCurve::try_new(bad).is_err(), "{bad:?}");
        }
    }
}
