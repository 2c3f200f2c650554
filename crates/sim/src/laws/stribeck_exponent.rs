//! A friction peak at low speed that falls with another power of speed than two.

use pkm_dyn::effects::{JointState, Unit};
use pkm_dyn::math;

use super::{ForeignLaw, Form, optional, required, set};

pub(super) const FORM: Form = Form {
    effects: &["friction_stribeck"],
    name: "exponent",
    equation: "(coulomb + (stiction − coulomb)·exp(−abs(v/stribeck_velocity)^exponent))·s",
    parameters: &[
        required("coulomb", Unit::Effort, 0.0),
        required("stiction", Unit::Effort, 0.0),
        required("stribeck_velocity", Unit::Velocity, 1e-9),
        optional("exponent", Unit::One, 0.05, 0.8),
    ],
    build: |joint, p| Box::new(Exponent { joint, coulomb: p[0], stiction: p[1], stribeck_velocity: p[2], exponent: p[3] }),
};

/// \[Armstrong1994\].
#[derive(Debug, Clone)]
struct Exponent {
    joint: usize,
    coulomb: f64,
    stiction: f64,
    stribeck_velocity: f64,
    exponent: f64,
}

impl ForeignLaw for Exponent {
    fn joint(&self) -> usize {
        self.joint
    }

    fn levels(&self, state: &JointState) -> (f64, f64) {
        let peak = |v: f64| math::exp(-math::powf((v / self.stribeck_velocity).abs(), self.exponent));
        set(state.v, |v, s| (self.coulomb + (self.stiction - self.coulomb) * peak(v)) * s)
    }

    fn advance(&mut self, _: &JointState, _: f64) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_the_stribeck_velocity_one_part_in_e_is_left_whatever_the_exponent() {
        for exponent in [0.5, 1.0, 2.0] {
            let law = Exponent { joint: 0, coulomb: 2.0, stiction: 5.0, stribeck_velocity: 0.01, exponent };
            let at = |v: f64| law.levels(&JointState { v, ..JointState::default() });
            assert!((at(0.01).1 - (2.0 + 3.0 / core::f64::consts::E)).abs() < 1e-12);
            assert!((at(0.04).1 - (2.0 + 3.0 * math::exp(-math::powf(4.0, exponent)))).abs() < 1e-12);
            assert!((at(0.0).0 + 5.0).abs() < 1e-12 && (at(0.0).1 - 5.0).abs() < 1e-12);
        }
    }
}
