//! Damping of a thinning lubricant: the drag of oil grows ever slower with speed.

use pkm_dyn::effects::{JointState, Unit};
use pkm_dyn::math;

use super::{ForeignLaw, Form, required};

pub(super) const FORM: Form = Form {
    effects: &["friction_viscous", "friction_quadratic"],
    name: "eyring",
    equation: "viscous·velocity·asinh(v/velocity)",
    parameters: &[required("viscous", Unit::EffortPerVelocity, 0.0), required("velocity", Unit::Velocity, 1e-9)],
    build: |joint, p| Box::new(Eyring { joint, viscous: p[0], velocity: p[1] }),
};

/// \[Eyring1936\], for the shear of a lubricant film.
#[derive(Debug, Clone)]
struct Eyring {
    joint: usize,
    viscous: f64,
    velocity: f64,
}

impl ForeignLaw for Eyring {
    fn joint(&self) -> usize {
        self.joint
    }

    fn levels(&self, state: &JointState) -> (f64, f64) {
        let x = (state.v / self.velocity).abs();
        let effort = self.viscous * self.velocity * math::ln(x + math::sqrt(x * x + 1.0)) * math::sign(state.v);
        (effort, effort)
    }

    fn advance(&mut self, _: &JointState, _: f64) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_viscous_when_slow_and_a_logarithm_when_fast() {
        let law = Eyring { joint: 0, viscous: 4.0, velocity: 0.1 };
        let at = |v: f64| law.levels(&JointState { v, ..JointState::default() }).0;
        assert!((at(1e-4) / 4e-4 - 1.0).abs() < 1e-6, "{}", at(1e-4));
        // asinh(3/4) = ln 2
        assert!((at(-0.075) + 0.4 * core::f64::consts::LN_2).abs() < 1e-14);
    }
}
