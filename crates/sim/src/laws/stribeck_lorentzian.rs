//! A friction peak at low speed with wide flanks.

use pkm_dyn::effects::{JointState, Unit};

use super::{ForeignLaw, Form, required, set};

pub(super) const FORM: Form = Form {
    effects: &["friction_stribeck"],
    name: "lorentzian",
    equation: "(coulomb + (stiction − coulomb)/(1 + (v/stribeck_velocity)²))·s",
    parameters: &[
        required("coulomb", Unit::Effort, 0.0),
        required("stiction", Unit::Effort, 0.0),
        required("stribeck_velocity", Unit::Velocity, 1e-9),
    ],
    build: |joint, p| Box::new(Lorentzian { joint, coulomb: p[0], stiction: p[1], stribeck_velocity: p[2] }),
};

/// \[Armstrong1994\].
#[derive(Debug, Clone)]
struct Lorentzian {
    joint: usize,
    coulomb: f64,
    stiction: f64,
    stribeck_velocity: f64,
}

impl ForeignLaw for Lorentzian {
    fn joint(&self) -> usize {
        self.joint
    }

    fn levels(&self, state: &JointState) -> (f64, f64) {
        set(state.v, |v, s| {
            let ratio = v / self.stribeck_velocity;
            (self.coulomb + (self.stiction - self.coulomb) / (1.0 + ratio * ratio)) * s
        })
    }

    fn advance(&mut self, _: &JointState, _: f64) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_the_stribeck_velocity_half_the_peak_is_left() {
        let law = Lorentzian { joint: 0, coulomb: 2.0, stiction: 5.0, stribeck_velocity: 0.01 };
        let at = |v: f64| law.levels(&JointState { v, ..JointState::default() });
        assert!((at(0.01).1 - 3.5).abs() < 1e-12 && (at(-0.03).0 + 2.3).abs() < 1e-12);
        assert!((at(0.0).1 - 5.0).abs() < 1e-12 && (at(0.01).0 + 5.0).abs() < 1e-12);
    }
}
