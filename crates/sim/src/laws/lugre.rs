//! Friction as bristles that bend and slip: pre-sliding, a peak at low speed and sliding friction in one law.

use pkm_dyn::effects::{JointState, Unit};
use pkm_dyn::math;

use super::{ForeignLaw, Form, optional, relaxed, required};

pub(super) const FORM: Form = Form {
    effects: &["friction_presliding", "friction_stribeck", "friction_coulomb"],
    name: "lugre",
    equation: "stiffness·z + damping·dz/dt + viscous·v, dz/dt = v − stiffness·abs(v)·z/g(v), g = coulomb + (stiction − coulomb)·exp(−(v/stribeck_velocity)²)",
    parameters: &[
        required("stiffness", Unit::EffortPerPosition, 0.0),
        required("coulomb", Unit::Effort, 1e-9),
        required("stiction", Unit::Effort, 1e-9),
        required("stribeck_velocity", Unit::Velocity, 1e-9),
        optional("damping", Unit::EffortPerVelocity, 0.0, 0.0),
        optional("viscous", Unit::EffortPerVelocity, 0.0, 0.0),
    ],
    build: |joint, p| {
        let [stiffness, coulomb, stiction, stribeck_velocity, damping, viscous] = [p[0], p[1], p[2], p[3], p[4], p[5]];
        Box::new(Lugre { joint, stiffness, coulomb, stiction, stribeck_velocity, damping, viscous, z: 0.0 })
    },
};

// The equations are those of [CanudasDeWit1995].
#[derive(Debug, Clone)]
struct Lugre {
    joint: usize,
    stiffness: f64,
    coulomb: f64,
    stiction: f64,
    stribeck_velocity: f64,
    damping: f64,
    viscous: f64,
    /// Mean deflection of the bristles `[m | rad]`.
    z: f64,
}

impl Lugre {
    /// How fast a deflection decays at velocity `v` `[1/s]`.
    fn decay(&self, v: f64) -> f64 {
        let ratio = v / self.stribeck_velocity;
        let level = self.coulomb + (self.stiction - self.coulomb) * math::exp(-ratio * ratio);
        self.stiffness * v.abs() / level
    }
}

impl ForeignLaw for Lugre {
    fn joint(&self) -> usize {
        self.joint
    }

    fn levels(&self, state: &JointState) -> (f64, f64) {
        let rate = state.v - self.decay(state.v) * self.z;
        let effort = self.stiffness * self.z + self.damping * rate + self.viscous * state.v;
        (effort, effort)
    }

    fn advance(&mut self, state: &JointState, h: f64) {
        self.z = relaxed(self.z, (state.v, self.decay(state.v)), h);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lugre() -> Lugre {
        Lugre { joint: 0, stiffness: 1e5, coulomb: 1.0, stiction: 1.5, stribeck_velocity: 1e-3, damping: 316.0, viscous: 0.4, z: 0.0 }
    }

    #[test]
    fn steady_sliding_is_the_stribeck_curve() {
        for v in [-0.02_f64, -5e-4, 2e-4, 1e-3, 0.1] {
            let mut law = lugre();
            let state = JointState { v, ..JointState::default() };
            for _ in 0..2000 {
                law.advance(&state, 1e-3);
            }
            let x = v / 1e-3;
            let want = (1.0 + 0.5 * math::exp(-x * x)) * math::sign(v) + 0.4 * v;
            assert!((law.levels(&state).0 - want).abs() < 1e-9, "{v}");
        }
    }

    #[test]
    fn a_sine_of_velocity_gives_scipys_efforts() {
        // tests/golden/laws/make_golden.py: solve_ivp (Radau, 1e-12) with v = 2e-3·sin(20 t).
        let golden = LUGRE;
        let (mut law, h) = (lugre(), 1e-5);
        let speed = |t: f64| JointState { v: 2e-3 * math::sin(20.0 * t), ..JointState::default() };
        for i in 0..100_000_u32 {
            let t = h * f64::from(i);
            if let Some((_, want)) = golden.iter().find(|(at, _)| (at - t).abs() < 0.1 * h) {
                assert!((law.levels(&speed(t)).0 - want).abs() < 1e-4, "t = {t}: {} instead of {want}", law.levels(&speed(t)).0);
            }
            law.advance(&speed(t + 0.5 * h), h);
        }
    }

    const LUGRE: [(f64, f64); 4] =
        [(0.1, 1.017_345_635_157_73), (0.3, -1.216_234_767_588_94), (0.55, -1.010_263_097_359_877), (0.9, -1.043_550_540_747_7)];
}
