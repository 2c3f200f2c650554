//! Ends of a range that harden the further one goes.

use pkm_dyn::math;

use crate::error::SimError;

/// Progressive ends of a range: `stiffness·d^exponent·(1 + damping·d')` at a depth `d` beyond either end \[Hunt1975\].
///
/// The damping grows with the depth, so the effort begins at zero, without a jump at contact, and never pulls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndStops {
    /// Lower end `[m | rad]`; −∞ without one.
    pub lower: f64,
    /// Upper end `[m | rad]`; ∞ without one.
    pub upper: f64,
    /// `[N/m^exponent | N·m/rad^exponent]`.
    pub stiffness: f64,
    /// 1 is a linear spring; 2 and 3 harden.
    pub exponent: f64,
    /// `[s/m | s/rad]`.
    pub damping: f64,
}

impl EndStops {
    /// No ends.
    pub const NONE: Self = Self { lower: f64::NEG_INFINITY, upper: f64::INFINITY, stiffness: 0.0, exponent: 1.0, damping: 0.0 };

    pub(super) fn check(&self) -> Result<(), SimError> {
        let bad = |what, value, limit| Err(SimError::Scenario { what, value, limit });
        if self.lower.is_nan() || self.upper.is_nan() || self.lower >= self.upper {
            return bad("upper end of a limb", self.upper, "must be above the lower end");
        }
        if !(1.0..=10.0).contains(&self.exponent) {
            return bad("exponent of an end stop", self.exponent, "1 to 10");
        }
        for (what, value) in [("stiffness of an end stop", self.stiffness), ("damping of an end stop", self.damping)] {
            if !(value.is_finite() && value >= 0.0) {
                return bad(what, value, "must be finite and not negative");
            }
        }
        Ok(())
    }

    /// Depth beyond an end, and the direction outward; 0 within the range.
    fn depth(&self, q: f64) -> (f64, f64) {
        if q > self.upper {
            (q - self.upper, 1.0)
        } else if q < self.lower {
            (self.lower - q, -1.0)
        } else {
            (0.0, 0.0)
        }
    }

    /// Effort on the robot at position `q` and velocity `v` `[N | N·m]`.
    #[must_use]
    pub fn effort(&self, q: f64, v: f64) -> f64 {
        let (depth, outward) = self.depth(q);
        if depth <= 0.0 {
            return 0.0;
        }
        let push = self.stiffness * math::powf(depth, self.exponent) * (1.0 + self.damping * outward * v).max(0.0);
        -outward * push
    }

    /// Energy stored at position `q` `[J]`.
    #[must_use]
    pub fn energy(&self, q: f64) -> f64 {
        let (depth, _) = self.depth(q);
        if depth <= 0.0 { 0.0 } else { self.stiffness * math::powf(depth, self.exponent + 1.0) / (self.exponent + 1.0) }
    }
}
