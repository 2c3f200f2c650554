//! Ripple with overtones, whose size varies along the stroke.

use pkm_dyn::effects::{JointState, Unit};
use pkm_dyn::math;

use super::{ForeignLaw, Form, optional, required};

pub(super) const FORM: Form = Form {
    effects: &["torque_ripple"],
    name: "harmonics",
    equation: "amplitude·(1 + depth·sin(slow·q))·(sin x + second·sin 2x + third·sin 3x), x = order·q + phase",
    parameters: &[
        required("amplitude", Unit::Effort, 0.0),
        required("order", Unit::PerPosition, 0.0),
        optional("phase", Unit::Rad, f64::NEG_INFINITY, 0.0),
        optional("second", Unit::One, f64::NEG_INFINITY, 0.4),
        optional("third", Unit::One, f64::NEG_INFINITY, 0.2),
        optional("depth", Unit::Share, 0.0, 0.3),
        optional("slow", Unit::PerPosition, 0.0, 1.0),
    ],
    build: |joint, p| Box::new(Harmonics { joint, p: core::array::from_fn(|i| p[i]) }),
};

#[derive(Debug, Clone)]
struct Harmonics {
    joint: usize,
    /// As in [`FORM`].
    p: [f64; 7],
}

impl ForeignLaw for Harmonics {
    fn joint(&self) -> usize {
        self.joint
    }

    fn levels(&self, state: &JointState) -> (f64, f64) {
        let [amplitude, order, phase, second, third, depth, slow] = self.p;
        let x = order * state.q + phase;
        let wave = math::sin(x) + second * math::sin(2.0 * x) + third * math::sin(3.0 * x);
        let effort = amplitude * (1.0 + depth * math::sin(slow * state.q)) * wave;
        (effort, effort)
    }

    fn advance(&mut self, _: &JointState, _: f64) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Coefficient of sin(n·q) over a turn.
    fn coefficient(law: &Harmonics, n: f64, cosine: f64) -> f64 {
        let points = 720;
        let at = |i: i32| 2.0 * core::f64::consts::PI * f64::from(i) / f64::from(points);
        let sum: f64 = (0..points)
            .map(|i| {
                law.levels(&JointState { q: at(i), ..JointState::default() }).0
                    * math::sin(n * at(i) + cosine * core::f64::consts::FRAC_PI_2)
            })
            .sum();
        2.0 * sum / f64::from(points)
    }

    #[test]
    fn its_spectrum_is_that_of_overtones_with_side_bands() {
        let law = Harmonics { joint: 0, p: [2.0, 8.0, 0.0, 0.4, 0.2, 0.5, 1.0] };
        for (n, want) in [(8.0, 2.0), (16.0, 0.8), (24.0, 0.4), (12.0, 0.0)] {
            assert!((coefficient(&law, n, 0.0) - want).abs() < 1e-12, "{n}");
        }
        // sin q · sin 8q = (cos 7q − cos 9q)/2, times amplitude and depth.
        for (n, want) in [(7.0, 0.5), (9.0, -0.5), (15.0, 0.2)] {
            assert!((coefficient(&law, n, 1.0) - want).abs() < 1e-12, "{n}");
        }
    }
}
