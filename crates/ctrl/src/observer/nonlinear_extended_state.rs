//! Han's extended state observer with power-law corrections \[Arceo2021, Fig. 6; Han2009\].

use crate::tracking_differentiator::fal;

/// Exponents of the corrections of velocity and missing acceleration.
const ALPHA: [f64; 2] = [0.5, 0.25];

/// Nonlinear extended state observer of one drive; its gains are of one sampling period and are not multiplied by it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NonlinearEso {
    /// Gains of the corrections of position, velocity and missing acceleration: `beta01`, `beta02`, `beta03`.
    pub beta: [f64; 3],
    /// Error below which the corrections are straight `[m | rad]`.
    pub delta: f64,
}

impl NonlinearEso {
    /// Han's gains for a period `h` `[s]`: `1`, `1/(2·h^0.5)`, `2/(25·h^1.2)`.
    ///
    /// \[Arceo2021\] prints `1/(3h)` for the second, with which the loop of its own robot oscillates between its limits of voltage.
    #[must_use]
    pub fn for_period(h: f64, delta: f64) -> Self {
        use pkm_dyn::math::{powf, sqrt};
        Self { beta: [1.0, 1.0 / (2.0 * sqrt(h)), 2.0 / (25.0 * powf(h, 1.2))], delta }
    }

    /// Estimates `[position, velocity, missing acceleration]` after a period `h` `[s]` at the known acceleration `u` `[m/s² | rad/s²]`,
    /// corrected by the error against `q_meas` `[m | rad]`.
    #[must_use]
    pub fn step(&self, z: [f64; 3], u: f64, q_meas: f64, h: f64) -> [f64; 3] {
        let e = z[0] - q_meas;
        [
            z[0] + h * z[1] - self.beta[0] * e,
            z[1] + h * (z[2] + u) - self.beta[1] * fal(e, ALPHA[0], self.delta),
            z[2] - self.beta[2] * fal(e, ALPHA[1], self.delta),
        ]
    }
}
