//! Friction that differs with direction and passes smoothly through rest.

use pkm_dyn::effects::{JointState, Unit};
use pkm_dyn::math;

use super::{ForeignLaw, Form, optional, required};

pub(super) const FORM: Form = Form {
    effects: &["friction_asymmetric"],
    name: "tanh",
    equation: "mean·t + half_difference·t² + viscous·v, t = tanh(v/width)",
    parameters: &[
        required("coulomb_pos", Unit::Effort, 0.0),
        required("coulomb_neg", Unit::Effort, 0.0),
        required("width", Unit::Velocity, 1e-9),
        optional("viscous", Unit::EffortPerVelocity, 0.0, 0.0),
    ],
    build: |joint, p| Box::new(Tanh { joint, coulomb: [p[0], p[1]], width: p[2], viscous: p[3] }),
};

#[derive(Debug, Clone)]
struct Tanh {
    joint: usize,
    /// Forward, backward.
    coulomb: [f64; 2],
    width: f64,
    viscous: f64,
}

impl ForeignLaw for Tanh {
    fn joint(&self) -> usize {
        self.joint
    }

    fn levels(&self, state: &JointState) -> (f64, f64) {
        let [forward, backward] = self.coulomb;
        let t = math::tanh(state.v / self.width);
        let effort = 0.5 * (forward + backward) * t + 0.5 * (forward - backward) * t * t + self.viscous * state.v;
        (effort, effort)
    }

    fn advance(&mut self, _: &JointState, _: f64) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn far_from_rest_each_direction_has_its_own_friction_and_none_feeds() {
        let law = Tanh { joint: 0, coulomb: [3.0, 1.0], width: 0.01, viscous: 2.0 };
        let at = |v: f64| law.levels(&JointState { v, ..JointState::default() }).0;
        assert!((at(1.0) - 5.0).abs() < 1e-12 && (at(-1.0) + 3.0).abs() < 1e-12);
        for i in -100..100 {
            let v = 1e-3 * f64::from(i);
            assert!(at(v) * v >= 0.0, "{v}");
        }
    }
}
