//! A cable that pulls one way going in and another coming out.

use pkm_dyn::effects::{JointState, Unit};
use pkm_dyn::math;

use super::{ForeignLaw, Form, optional, required};

pub(super) const FORM: Form = Form {
    effects: &["cable_force"],
    name: "bouc_wen",
    equation: "stiffness·(q − rest) + hysteresis·z, dz/dt = (v − abs(z)^n·(beta·v + (1 − beta)·abs(v)·sign(z)))/reach",
    parameters: &[
        required("stiffness", Unit::EffortPerPosition, 0.0),
        required("hysteresis", Unit::Effort, 0.0),
        required("reach", Unit::Position, 1e-9),
        optional("rest", Unit::Position, f64::NEG_INFINITY, 0.0),
        optional("n", Unit::One, 1.0, 1.0),
        optional("beta", Unit::Share, 0.0, 0.5),
    ],
    build: |joint, p| Box::new(BoucWen { joint, stiffness: p[0], hysteresis: p[1], reach: p[2], rest: p[3], n: p[4], beta: p[5], z: 0.0 }),
};

/// Way in one go, in reaches, and the most parts of a step.
const PART: f64 = 0.05;
const MOST_PARTS: f64 = 1000.0;

/// \[Wen1976\] with both shape factors adding up to one, so that abs(z) stays below one.
#[derive(Debug, Clone)]
struct BoucWen {
    joint: usize,
    stiffness: f64,
    hysteresis: f64,
    reach: f64,
    rest: f64,
    n: f64,
    beta: f64,
    z: f64,
}

impl BoucWen {
    fn rate(&self, z: f64, v: f64) -> f64 {
        (v - math::powf(z.abs(), self.n) * (self.beta * v + (1.0 - self.beta) * v.abs() * math::sign(z))) / self.reach
    }
}

impl ForeignLaw for BoucWen {
    fn joint(&self) -> usize {
        self.joint
    }

    fn levels(&self, state: &JointState) -> (f64, f64) {
        let effort = self.stiffness * (state.q - self.rest) + self.hysteresis * self.z;
        (effort, effort)
    }

    fn advance(&mut self, state: &JointState, h: f64) {
        let v = state.v;
        let parts = (h * v.abs() / (PART * self.reach)).ceil().clamp(1.0, MOST_PARTS);
        let h = h / parts;
        let mut done = 0.0;
        while done < parts {
            let middle = self.z + 0.5 * h * self.rate(self.z, v);
            self.z = (self.z + h * self.rate(middle, v)).clamp(-1.0, 1.0);
            done += 1.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_pull_is_an_exponential_over_the_way() {
        let mut law = BoucWen { joint: 0, stiffness: 50.0, hysteresis: 3.0, reach: 0.01, rest: 0.1, n: 1.0, beta: 0.5, z: 0.0 };
        let (h, v) = (1e-3, 0.02);
        for i in 0..2000 {
            let q = h * v * f64::from(i);
            let want = 50.0 * (q - 0.1) + 3.0 * (1.0 - math::exp(-q / 0.01));
            let got = law.levels(&JointState { q, v, ..JointState::default() }).0;
            assert!((got - want).abs() < 1e-4, "{q}: {got} instead of {want}");
            law.advance(&JointState { q, v, ..JointState::default() }, h);
        }
    }

    #[test]
    fn a_closed_way_costs_what_the_loop_encloses() {
        let mut law = BoucWen { joint: 0, stiffness: 50.0, hysteresis: 3.0, reach: 0.001, rest: 0.0, n: 1.0, beta: 0.5, z: 0.0 };
        let (amplitude, h) = (0.1_f64, 1e-3);
        let (mut work, mut q) = (0.0, 0.0);
        for leg in 0..9 {
            let v = if leg % 2 == 0 { amplitude } else { -amplitude };
            for _ in 0..if leg == 0 { 1000 } else { 2000 } {
                let state = JointState { q, v, ..JointState::default() };
                if leg > 4 {
                    work += 0.5 * h * v * law.levels(&state).0;
                }
                law.advance(&state, h);
                q += h * v;
                if leg > 4 {
                    work += 0.5 * h * v * law.levels(&JointState { q, ..state }).0;
                }
            }
        }
        // Two rounds; each turn back first crosses z from ±1 to 0 along a line of length reach, then rises as an exponential:
        // per leg hysteresis·(2·amplitude − reach/2 − 2·reach).
        let want = 4.0 * 3.0 * (2.0 * amplitude - 2.5 * 0.001);
        assert!((work / want - 1.0).abs() < 1e-3, "{work} J instead of {want} J");
    }
}
