//! Gains of the error dynamics of a computed-torque law, placed in closed form.

use pkm_dyn::math;

/// Gains of `a_cmd = a_ref − (ki·∫e + kp·e + kv·e')` with `e = q_ref − q`: for a stable loop all are negative, as in \[Arceo2021, eq. 9\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorGains {
    /// Of the integral of the error `[1/s³]`.
    pub ki: f64,
    /// Of the error `[1/s²]`.
    pub kp: f64,
    /// Of its rate `[1/s]`.
    pub kv: f64,
}

impl ErrorGains {
    /// Gains that put the poles of the continuous error dynamics, `s³ − kv·s² − kp·s − ki`, at `poles` `[1/s]`.
    ///
    /// The paper prints the labels of `kp` and `ki` exchanged.
    #[must_use]
    pub fn placed(poles: [f64; 3]) -> Self {
        let [c0, c1, c2] = coefficients(poles);
        Self { ki: -c0, kp: -c1, kv: -c2 }
    }

    /// Gains that put the poles of the error dynamics sampled at `dt` `[s]` (Tustin) at `exp(poles·dt)`, `poles` in `[1/s]`.
    ///
    /// With `D = z − 1` the sampled loop is `D³ − kv·T·D² − kp·T²·(D + D²/2) − ki·T³·(1 + D + D²/4)`; its coefficients are compared.
    #[must_use]
    pub fn placed_sampled(poles: [f64; 3], dt: f64) -> Self {
        let [c0, c1, c2] = coefficients(poles.map(|p| math::exp(p * dt) - 1.0));
        Self { ki: -c0 / (dt * dt * dt), kp: (c0 - c1) / (dt * dt), kv: (c0 / 4.0 - (c0 - c1) / 2.0 - c2) / dt }
    }
}

/// `[c0, c1, c2]` of `x³ + c2·x² + c1·x + c0` with these roots.
fn coefficients([a, b, c]: [f64; 3]) -> [f64; 3] {
    [-a * b * c, a * b + b * c + c * a, -(a + b + c)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poles_at_minus_5_6_7_have_the_corrected_gains_of_the_paper() {
        let near = |got: f64, want: f64, tolerance: f64| assert!((got - want).abs() < tolerance, "{got} {want}");
        let gains = ErrorGains::placed([-5.0, -6.0, -7.0]);
        near(gains.ki, -210.0, 1e-12);
        near(gains.kp, -107.0, 1e-12);
        near(gains.kv, -18.0, 1e-12);
        let sampled = ErrorGains::placed_sampled([-5.0, -6.0, -7.0], 0.01);
        near(sampled.ki, -192.013_532, 5e-7);
        near(sampled.kp, -98.824_334, 5e-7);
        near(sampled.kv, -16.962_300, 5e-7);
    }

    #[test]
    fn the_sampled_gains_annihilate_the_characteristic_polynomial_at_every_pole() {
        let (t, poles) = (0.01, [-5.0, -6.0, -7.0]);
        let gains = ErrorGains::placed_sampled(poles, t);
        // Determinant of z·I − A − B·K with A and B of Tustin's rule, not the polynomial in D that the gains come from.
        let [a, b] = [[[1.0, t, t * t / 2.0], [0.0, 1.0, t], [0.0, 0.0, 1.0]], [[t * t * t / 4.0, t * t / 2.0, t], [0.0; 3], [0.0; 3]]];
        let k = [gains.ki, gains.kp, gains.kv];
        for pole in poles {
            let z = math::exp(pole * t);
            let m = nalgebra::Matrix3::from_fn(|i, j| if i == j { z } else { 0.0 } - a[i][j] - b[0][i] * k[j]);
            assert!(m.determinant().abs() < 1e-16, "{}", m.determinant());
        }
    }
}
