//! Damping that follows the temperature of a gearbox, which its own friction and a warm motor heat.

use pkm_dyn::effects::{JointState, Unit};
use pkm_dyn::math;

use super::{ForeignLaw, Form, optional, required};

pub(super) const FORM: Form = Form {
    effects: &["friction_thermal"],
    name: "two_temperatures",
    equation: "viscous·exp(−rate·T_gear)·v; motor_capacity·dT_motor/dt = loss·load² − q, gear_capacity·dT_gear/dt = friction power + q − \
               T_gear/outward, q = (T_motor − T_gear)/inward; T in °C above the start, capacities J/°C, resistances °C/W, loss W/N²",
    parameters: &[
        required("viscous", Unit::EffortPerVelocity, 0.0),
        required("rate", Unit::PerWarmth, f64::NEG_INFINITY),
        optional("gear_capacity", Unit::One, 1e-6, 300.0),
        optional("motor_capacity", Unit::One, 1e-6, 500.0),
        optional("inward", Unit::One, 1e-6, 0.5),
        optional("outward", Unit::One, 1e-6, 1.0),
        optional("loss", Unit::One, 0.0, 0.0),
    ],
    build: |joint, p| {
        Box::new(TwoTemperatures {
            joint,
            viscous: p[0],
            rate: p[1],
            capacity: [p[2], p[3]],
            inward: p[4],
            outward: p[5],
            loss: p[6],
            warmth: [0.0; 2],
        })
    },
};

/// A temperature that the exponential still follows `[1/°C times °C]`: beyond, oil is no oil.
const MOST: f64 = 5.0;

#[derive(Debug, Clone)]
struct TwoTemperatures {
    joint: usize,
    viscous: f64,
    rate: f64,
    /// Gear, motor `[J/°C]`.
    capacity: [f64; 2],
    inward: f64,
    outward: f64,
    loss: f64,
    /// Gear, motor, above the start `[°C]`.
    warmth: [f64; 2],
}

impl TwoTemperatures {
    fn damping(&self) -> f64 {
        self.viscous * math::exp(-(self.rate * self.warmth[0]).clamp(-MOST, MOST))
    }
}

impl ForeignLaw for TwoTemperatures {
    fn joint(&self) -> usize {
        self.joint
    }

    fn levels(&self, state: &JointState) -> (f64, f64) {
        let effort = self.damping() * state.v;
        (effort, effort)
    }

    fn advance(&mut self, state: &JointState, h: f64) {
        let heat = [self.damping() * state.v * state.v, self.loss * state.load * state.load];
        let ([gear, motor], [cg, cm]) = (self.warmth, self.capacity);
        let between = (motor - gear) / self.inward;
        let flow = [heat[0] + between - gear / self.outward, heat[1] - between];
        // The middle of the step decides (trapezoidal rule): of second order, and steady for any capacity.
        let a = [[cg / h + 0.5 / self.inward + 0.5 / self.outward, -0.5 / self.inward], [-0.5 / self.inward, cm / h + 0.5 / self.inward]];
        let determinant = a[0][0] * a[1][1] - a[0][1] * a[1][0];
        self.warmth[0] += (flow[0] * a[1][1] - flow[1] * a[0][1]) / determinant;
        self.warmth[1] += (flow[1] * a[0][0] - flow[0] * a[1][0]) / determinant;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn law(rate: f64) -> TwoTemperatures {
        let capacity = [30.0, 50.0];
        TwoTemperatures { joint: 0, viscous: 100.0, rate, capacity, inward: 0.5, outward: 1.0, loss: 0.01, warmth: [0.0; 2] }
    }

    #[test]
    fn heat_that_does_not_change_warms_both_as_scipys_matrix_exponential_says() {
        let mut law = law(0.0);
        let state = JointState { v: 0.3, load: 20.0, ..JointState::default() };
        for _ in 0..20_000 {
            law.advance(&state, 1e-3);
        }
        // tests/golden/laws/make_golden.py: expm of the two equations over 20 s.
        assert!(law.warmth.iter().zip(WARMTH).all(|(t, want)| (t - want).abs() < 1e-6), "{:?}", law.warmth);
    }

    #[test]
    fn in_the_end_friction_power_is_what_flows_out() {
        let mut law = law(0.05);
        let state = JointState { v: 0.3, ..JointState::default() };
        for _ in 0..200_000 {
            law.advance(&state, 0.02);
        }
        let power = law.levels(&state).0 * 0.3;
        assert!((law.warmth[0] - power).abs() < 1e-6 && (law.warmth[1] - law.warmth[0]).abs() < 1e-6, "{:?} {power}", law.warmth);
        // T = 9·exp(−T/20): W(9/20)·20.
        assert!((law.warmth[0] - 6.502_072).abs() < 1e-3, "{:?}", law.warmth);
    }

    const WARMTH: [f64; 2] = [3.445_697_87, 2.327_994_49];
}
