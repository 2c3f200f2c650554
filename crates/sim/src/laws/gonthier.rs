//! Friction with a dwell time: the longer a joint has stood, the harder it breaks loose.

use pkm_dyn::effects::{JointState, Unit};
use pkm_dyn::math;

use super::{ForeignLaw, Form, optional, relaxed, required};

pub(super) const FORM: Form = Form {
    effects: &["friction_presliding", "friction_stribeck", "friction_coulomb"],
    name: "gonthier",
    equation: "clamp(stiffness·z + damping·dz/dt, ± (coulomb + (stiction − coulomb)·dwell)) + viscous·v; \
               dz/dt = w·v + (1 − w)·(coulomb·dir(v) − stiffness·z)/damping, w = exp(−(v/stribeck_velocity)²)",
    parameters: &[
        required("stiffness", Unit::EffortPerPosition, 1e-9),
        required("damping", Unit::EffortPerVelocity, 1e-9),
        required("coulomb", Unit::Effort, 1e-9),
        required("stiction", Unit::Effort, 1e-9),
        required("stribeck_velocity", Unit::Velocity, 1e-9),
        required("dwell_time", Unit::Second, 1e-9),
        optional("viscous", Unit::EffortPerVelocity, 0.0, 0.0),
    ],
    build: |joint, p| {
        let [stiffness, damping, coulomb, stiction, stribeck_velocity, dwell_time, viscous] = [p[0], p[1], p[2], p[3], p[4], p[5], p[6]];
        Box::new(Gonthier { joint, stiffness, damping, coulomb, stiction, stribeck_velocity, dwell_time, viscous, z: 0.0, dwell: 1.0 })
    },
};

/// Share of the Stribeck velocity over which the direction of sliding passes through zero.
const TURN: f64 = 0.01;

/// \[Gonthier2004\], for one direction of sliding.
#[derive(Debug, Clone)]
struct Gonthier {
    joint: usize,
    stiffness: f64,
    damping: f64,
    coulomb: f64,
    stiction: f64,
    stribeck_velocity: f64,
    dwell_time: f64,
    viscous: f64,
    /// Deflection of the bristles `[m | rad]`.
    z: f64,
    /// 0 while sliding, towards 1 the longer it stands.
    dwell: f64,
}

impl Gonthier {
    fn sticking(&self, v: f64) -> f64 {
        let ratio = v / self.stribeck_velocity;
        math::exp(-ratio * ratio)
    }

    fn most(&self) -> f64 {
        self.coulomb + (self.stiction - self.coulomb).max(0.0) * self.dwell
    }

    /// dz/dt = a − b·z.
    fn rate(&self, v: f64) -> (f64, f64) {
        let w = self.sticking(v);
        let direction = (v / (TURN * self.stribeck_velocity)).clamp(-1.0, 1.0);
        (w * v + (1.0 - w) * self.coulomb * direction / self.damping, (1.0 - w) * self.stiffness / self.damping)
    }
}

impl ForeignLaw for Gonthier {
    fn joint(&self) -> usize {
        self.joint
    }

    fn levels(&self, state: &JointState) -> (f64, f64) {
        let (a, b) = self.rate(state.v);
        let bristles = self.stiffness * self.z + self.damping * (a - b * self.z);
        let effort = bristles.clamp(-self.most(), self.most()) + self.viscous * state.v;
        (effort, effort)
    }

    fn advance(&mut self, state: &JointState, h: f64) {
        let limit = self.most() / self.stiffness;
        self.z = relaxed(self.z, self.rate(state.v), h).clamp(-limit, limit);
        let w = self.sticking(state.v);
        // Contacts form slowly and break as fast as the bristles relax.
        let time = if w >= self.dwell { self.dwell_time } else { self.damping / self.stiffness };
        self.dwell = relaxed(self.dwell, (w / time, 1.0 / time), h);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn law() -> Gonthier {
        Gonthier {
            joint: 0,
            stiffness: 1e5,
            damping: 400.0,
            coulomb: 1.0,
            stiction: 1.5,
            stribeck_velocity: 1e-3,
            dwell_time: 0.5,
            viscous: 0.4,
            z: 0.0,
            dwell: 1.0,
        }
    }

    /// After sliding for a second and standing for `rest` `[s]`.
    fn rested(rest: f64) -> Gonthier {
        let mut law = law();
        let still = JointState::default();
        let steps = |t: f64| (0_u32..).take_while(move |i| f64::from(*i) * 1e-4 < t);
        steps(1.0).for_each(|_| law.advance(&JointState { v: 0.05, ..still }, 1e-4));
        steps(rest).for_each(|_| law.advance(&still, 1e-4));
        law
    }

    /// Largest effort in the first half second of moving at `v` `[m/s]`.
    fn peak(mut law: Gonthier, v: f64) -> f64 {
        let state = JointState { v, ..JointState::default() };
        (0..5000).fold(0.0, |top: f64, _| {
            law.advance(&state, 1e-4);
            top.max(law.levels(&state).1)
        })
    }

    #[test]
    fn fast_sliding_is_coulomb_and_viscous() {
        let mut law = law();
        let state = JointState { v: -0.05, ..JointState::default() };
        for _ in 0..1000 {
            law.advance(&state, 1e-3);
        }
        assert!((law.levels(&state).0 - (-1.0 - 0.4 * 0.05)).abs() < 1e-9);
    }

    #[test]
    fn what_it_holds_grows_with_the_time_it_stood_as_the_exponential_says() {
        for rest in [0.05_f64, 0.5, 5.0] {
            let want = 1.0 - math::exp(-rest / 0.5);
            assert!((rested(rest).dwell - want).abs() < 1e-3, "{rest} s: {}", rested(rest).dwell);
        }
        let peaks = [0.05, 0.5, 5.0].map(|rest| peak(rested(rest), 5e-4));
        assert!(peaks[0] < peaks[1] && peaks[1] < peaks[2] && peaks[2] < 1.5, "{peaks:?}");
    }

    #[test]
    fn creeping_for_long_is_the_stribeck_curve() {
        let mut law = rested(5.0);
        let state = JointState { v: 5e-4, ..JointState::default() };
        for _ in 0..100_000 {
            law.advance(&state, 1e-4);
        }
        let want = 1.0 + 0.5 * math::exp(-0.25) + 0.4 * 5e-4;
        assert!((law.levels(&state).0 - want).abs() < 1e-6, "{}", law.levels(&state).0);
    }
}
