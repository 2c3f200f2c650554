//! Velocities and accelerations from positions.

use super::b_spline::Spline;
use super::savitzky_golay::SavitzkyGolay;
use crate::filter::{LowPass, derivative};

/// Order of the sliding polynomials: acceleration is then a parabola over the window.
const ORDER: usize = 4;

/// How positions become velocities and accelerations; all are without phase.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Derivative {
    /// Zero-phase low-pass, then central differences twice.
    #[default]
    Filtered,
    /// Central differences of positions as they are: for positions without noise.
    Central,
    /// Sliding polynomials whose half-power frequency is the low-pass's.
    SavitzkyGolay,
    /// A least-squares spline of degree five with two knots per period of the low-pass's cut-off.
    Spline,
}

impl Derivative {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Filtered, Self::Central, Self::SavitzkyGolay, Self::Spline];

    /// Name, as on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Filtered => "filtered",
            Self::Central => "central",
            Self::SavitzkyGolay => "savitzky-golay",
            Self::Spline => "spline",
        }
    }

    /// Position, velocity, acceleration, and a number that says how: half window, knots, or padded samples.
    #[must_use]
    pub fn apply(self, q: &[f64], cutoff_hz: f64, dt: f64) -> ([Vec<f64>; 3], f64) {
        let differences = |q: Vec<f64>| {
            let v = derivative(&q, dt);
            let a = derivative(&v, dt);
            [q, v, a]
        };
        match self {
            Self::Filtered => {
                let filter = LowPass::new(cutoff_hz, dt);
                (differences(filter.apply(q)), filter.reach() as f64)
            }
            Self::Central => (differences(q.to_vec()), 1.0),
            Self::SavitzkyGolay => {
                let f = SavitzkyGolay::with_cutoff(cutoff_hz, ORDER, dt);
                ([0, 1, 2].map(|d| f.apply(q, d, dt)), f.half() as f64)
            }
            Self::Spline => match Spline::fit(q, dt, 0.5 / cutoff_hz) {
                Some(spline) => ([0, 1, 2].map(|d| spline.sample(q.len(), dt, d)), spline.len() as f64),
                None => (differences(q.to_vec()), 0.0),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_dyn::math;

    #[test]
    fn every_way_gives_the_derivatives_of_a_slow_sine() {
        let (dt, w) = (2e-3, 5.0);
        let q: Vec<f64> = (0..4000).map(|i| math::sin(w * dt * f64::from(i))).collect();
        for way in Derivative::ALL {
            let ([_, v, a], _) = way.apply(&q, 20.0, dt);
            for i in (200..3800).step_by(50) {
                let (s, c) = math::sin_cos(w * dt * i as f64);
                assert!((v[i] - w * c).abs() < 2e-3 * w && (a[i] + w * w * s).abs() < 4e-3 * w * w, "{way:?} {i}: {} {}", v[i], a[i]);
            }
        }
    }
}
