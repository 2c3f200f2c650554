//! An inertia behind a spring that hardens: soft near rest, stiff when wound up.

use pkm_dyn::effects::{JointState, Unit};
use pkm_dyn::math;

use super::{ForeignLaw, Form, optional, required};

pub(super) const FORM: Form = Form {
    effects: &["joint_elasticity"],
    name: "hardening",
    equation: "an inertia on stiffness·d + cubic·d³ + damping·dd/dt, d = its position relative to the joint",
    parameters: &[
        required("stiffness", Unit::EffortPerPosition, 0.0),
        required("cubic", Unit::EffortPerPositionCubed, 0.0),
        required("inertia", Unit::Inertia, 1e-9),
        optional("damping", Unit::EffortPerVelocity, 0.0, 0.0),
    ],
    build: |joint, p| Box::new(Hardening { joint, stiffness: p[0], cubic: p[1], inertia: p[2], damping: p[3], place: 0.0, velocity: None }),
};

/// Parts of a radian of its swing that are gone in one go, and the most parts of a step.
const PART: f64 = 0.05;
const MOST_PARTS: f64 = 1000.0;

#[derive(Debug, Clone)]
struct Hardening {
    joint: usize,
    stiffness: f64,
    cubic: f64,
    inertia: f64,
    damping: f64,
    /// Position relative to the joint `[m | rad]`.
    place: f64,
    /// Velocity of the inertia; before the first step that of the joint.
    velocity: Option<f64>,
}

impl Hardening {
    /// Effort that the joint gives the inertia.
    fn effort(&self, place: f64, rate: f64) -> f64 {
        -place * (self.stiffness + self.cubic * place * place) - self.damping * rate
    }
}

impl ForeignLaw for Hardening {
    fn joint(&self) -> usize {
        self.joint
    }

    fn levels(&self, state: &JointState) -> (f64, f64) {
        let rate = self.velocity.unwrap_or(state.v) - state.v;
        let effort = self.effort(self.place, rate);
        (effort, effort)
    }

    fn advance(&mut self, state: &JointState, h: f64) {
        let stiffest = self.stiffness + 3.0 * self.cubic * self.place * self.place;
        let fastest = math::sqrt(stiffest / self.inertia) + self.damping / self.inertia;
        let parts = (h * fastest / PART).ceil().clamp(1.0, MOST_PARTS);
        let h = h / parts;
        let mut velocity = self.velocity.unwrap_or(state.v);
        let mut done = 0.0;
        while done < parts {
            // Kick, drift, kick: energy does not drift.
            velocity += 0.5 * h * self.effort(self.place, velocity - state.v) / self.inertia;
            self.place += h * (velocity - state.v);
            velocity += 0.5 * h * self.effort(self.place, velocity - state.v) / self.inertia;
            done += 1.0;
        }
        self.velocity = Some(velocity);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_swings_with_duffings_period_beside_a_joint_that_stands() {
        let mut law = Hardening { joint: 0, stiffness: 400.0, cubic: 4e6, inertia: 0.5, damping: 0.0, place: 0.01, velocity: Some(0.0) };
        let (h, still) = (1e-4, JointState::default());
        let (mut crossings, mut before) = (Vec::new(), law.place);
        for i in 0..20_000 {
            law.advance(&still, h);
            if before < 0.0 && law.place >= 0.0 {
                crossings.push(h * (f64::from(i) + 1.0 - law.place / (law.place - before)));
            }
            before = law.place;
        }
        let period = (crossings[crossings.len() - 1] - crossings[0]) / (crossings.len() as f64 - 1.0);
        // tests/golden/laws/make_golden.py: 4·K(m)/√(k/J + c·A²/J), m = c·A²/(2(k + c·A²)).
        assert!((period / DUFFING - 1.0).abs() < 1e-5, "{period} s instead of {DUFFING} s");
    }

    #[test]
    fn without_a_hardening_it_resonates_at_root_k_over_j() {
        // Off resonance the inertia follows x/q = ω₀²/(ω₀² − ω²), so the effort is J·ω²·that.
        let (k, inertia, w) = (800.0, 0.5, 25.0);
        let mut law = Hardening { joint: 0, stiffness: k, cubic: 0.0, inertia, damping: 4.0, place: 0.0, velocity: Some(0.0) };
        let (h, mut top) = (1e-4, 0.0_f64);
        for i in 0..100_000 {
            let t = h * f64::from(i);
            let state = JointState { v: w * 1e-3 * math::cos(w * t), ..JointState::default() };
            if t > 5.0 {
                top = top.max(law.levels(&state).0.abs());
            }
            law.advance(&JointState { v: w * 1e-3 * math::cos(w * (t + 0.5 * h)), ..state }, h);
        }
        // |J·(−ω²)·(k + i·d·ω)/(k − J·ω² + i·d·ω)| · 1e-3
        let (re, im) = (k - inertia * w * w, 4.0 * w);
        let want = 1e-3 * inertia * w * w * math::sqrt((k * k + im * im) / (re * re + im * im));
        assert!((top / want - 1.0).abs() < 2e-3, "{top} instead of {want}");
    }

    const DUFFING: f64 = 0.168_575_035_481_259_6;
}
