//! A load that sloshes: part of the payload swings like a pendulum, as a liquid in a tank does.

use pkm_dyn::effects::{JointState, Unit};
use pkm_dyn::math;

use super::{ForeignLaw, Form, optional, required};

pub(super) const FORM: Form = Form {
    effects: &["payload"],
    name: "sloshing",
    equation: "mass·(w²·(q − x) + 2·damping·w·(v − dx/dt)) = mass·d²x/dt², w = √(9.81/length)",
    parameters: &[required("mass", Unit::Inertia, 1e-9), required("length", Unit::Length, 1e-6), optional("damping", Unit::One, 0.0, 0.02)],
    build: |joint, p| {
        Box::new(Sloshing { joint, mass: p[0], frequency: math::sqrt(GRAVITY / p[1]), damping: p[2], place: 0.0, velocity: None })
    },
};

/// Gravity that the liquid swings in `[m/s²]`.
const GRAVITY: f64 = 9.81;

/// The first mode of a liquid as an equivalent pendulum \[Ibrahim2005\], for small swings; at a hinge, mass is a moment of inertia.
#[derive(Debug, Clone)]
struct Sloshing {
    joint: usize,
    mass: f64,
    /// `[rad/s]`.
    frequency: f64,
    damping: f64,
    /// Position of the swinging mass relative to the joint `[m | rad]`.
    place: f64,
    /// Its velocity; before the first step that of the joint.
    velocity: Option<f64>,
}

impl Sloshing {
    /// Acceleration of the swinging mass.
    fn pull(&self, place: f64, rate: f64) -> f64 {
        -self.frequency * (self.frequency * place + 2.0 * self.damping * rate)
    }
}

impl ForeignLaw for Sloshing {
    fn joint(&self) -> usize {
        self.joint
    }

    fn levels(&self, state: &JointState) -> (f64, f64) {
        let effort = self.mass * self.pull(self.place, self.velocity.unwrap_or(state.v) - state.v);
        (effort, effort)
    }

    fn advance(&mut self, state: &JointState, h: f64) {
        // Implicit midpoint: steady however short the pendulum.
        let rate = self.velocity.unwrap_or(state.v) - state.v;
        let w = self.frequency;
        let change = h * self.pull(self.place + 0.5 * h * rate, rate) / (1.0 + 0.25 * h * h * w * w + h * self.damping * w);
        self.place += h * (rate + 0.5 * change);
        self.velocity = Some(state.v + rate + change);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shaken_it_answers_as_the_pendulum_does() {
        let (mass, w0, zeta) = (2.0, 4.0, 0.1);
        for w in [1.0, 4.0, 9.0] {
            let mut law = Sloshing { joint: 0, mass, frequency: w0, damping: zeta, place: 0.0, velocity: None };
            let (h, mut top) = (1e-3, 0.0_f64);
            for i in 0..60_000 {
                let t = h * f64::from(i);
                let v = |t: f64| 0.01 * w * math::cos(w * t);
                if t > 40.0 {
                    top = top.max(law.levels(&JointState { v: v(t), ..JointState::default() }).0.abs());
                }
                law.advance(&JointState { v: v(t + 0.5 * h), ..JointState::default() }, h);
            }
            // x/q = (w0² + 2i·ζ·w0·w)/(w0² − w² + 2i·ζ·w0·w); the effort is mass·w²·x.
            let (a, b) = (w0 * w0, 2.0 * zeta * w0 * w);
            let gain = math::sqrt((a * a + b * b) / ((a - w * w) * (a - w * w) + b * b));
            let want = mass * w * w * gain * 0.01;
            assert!((top / want - 1.0).abs() < 2e-3, "{w} rad/s: {top} instead of {want}");
        }
    }
}
