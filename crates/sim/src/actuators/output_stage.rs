//! The last stage before the motor: a ceiling, whole steps of a converter or a pulse width, and a dead zone of the bridge.

use pkm_dyn::math;

use crate::error::SimError;

/// What becomes of a command, in its unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutputStage {
    ceiling: f64,
    step: f64,
    dead_zone: f64,
}

impl OutputStage {
    /// A stage that changes nothing.
    #[must_use]
    pub const fn ideal() -> Self {
        Self { ceiling: f64::INFINITY, step: 0.0, dead_zone: 0.0 }
    }

    /// At most `ceiling` either way, in whole `step`s (0: does not round), and within `dead_zone` about zero nothing, beyond it so much less.
    ///
    /// # Errors
    /// A number that is negative or none.
    pub fn try_new(ceiling: f64, step: f64, dead_zone: f64) -> Result<Self, SimError> {
        let limit = "must not be negative";
        for (what, value) in [("ceiling of a drive", ceiling), ("step of a drive", step), ("dead zone of a drive", dead_zone)] {
            if value.is_nan() || value < 0.0 || (value.is_infinite() && what != "ceiling of a drive") {
                return Err(SimError::Scenario { what, value, limit });
            }
        }
        Ok(Self { ceiling, step, dead_zone })
    }

    /// A converter of `bits` bits whose codes reach `ceiling` either way; zero is one of them.
    ///
    /// # Errors
    /// A ceiling that is infinite, negative or none, or not 2 to 24 bits.
    pub fn of_bits(ceiling: f64, bits: u32, dead_zone: f64) -> Result<Self, SimError> {
        if !(2..=24).contains(&bits) {
            return Err(SimError::Scenario { what: "bits of a drive", value: f64::from(bits), limit: "2 to 24" });
        }
        Self::try_new(ceiling, ceiling / f64::from((1_u32 << (bits - 1)) - 1), dead_zone)
    }

    /// A pulse width out of `counts` timer counts a period, at a supply that gives `ceiling` when it is on all the time.
    ///
    /// # Errors
    /// A ceiling that is infinite, negative or none, or no counts.
    pub fn of_pulse_width(ceiling: f64, counts: u32, dead_zone: f64) -> Result<Self, SimError> {
        if counts == 0 {
            return Err(SimError::Scenario { what: "counts of a pulse width", value: 0.0, limit: "at least 1" });
        }
        Self::try_new(ceiling, ceiling / f64::from(counts), dead_zone)
    }

    /// What it makes of a command.
    #[must_use]
    pub fn output(&self, command: f64) -> f64 {
        let clipped = command.max(-self.ceiling).min(self.ceiling);
        let whole = if self.step > 0.0 { math::round(clipped / self.step) * self.step } else { clipped };
        math::sign(whole) * (whole.abs() - self.dead_zone).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Random, Stream};

    #[test]
    fn ceiling_and_dead_zone_are_straight_lines() {
        let stage = OutputStage::try_new(10.0, 0.0, 1.5).unwrap();
        for (command, want) in [(0.0, 0.0), (1.4, 0.0), (-1.5, 0.0), (2.0, 0.5), (-4.0, -2.5), (12.0, 8.5), (-1e300, -8.5)] {
            assert!((stage.output(command) - want).abs() < 1e-12, "{command}");
        }
        for x in [0.0, -3.25, 1e300] {
            assert!((OutputStage::ideal().output(x) - x).abs() <= 0.0);
        }
    }

    #[test]
    fn steps_add_a_variance_of_a_twelfth_of_their_square() {
        let (bits, counts) = (OutputStage::of_bits(10.0, 8, 0.0).unwrap(), OutputStage::of_pulse_width(10.0, 500, 0.0).unwrap());
        for (stage, step) in [(bits, 10.0 / 127.0), (counts, 0.02)] {
            let mut random = Random::new(2, Stream::Counts);
            let n = 40_000;
            let sum: f64 = (0..n)
                .map(|_| {
                    let x = random.uniform(-9.9, 9.9);
                    let error = stage.output(x) - x;
                    assert!(error.abs() < 0.5 * step + 1e-12);
                    error * error
                })
                .sum();
            let variance = sum / f64::from(n) / (step * step);
            assert!((variance - 1.0 / 12.0).abs() < 5.0 * 0.0746 / 200.0, "{variance}");
        }
        assert!((bits.output(10.0) - 10.0).abs() < 1e-12 && bits.output(0.0).abs() <= 0.0);
    }

    #[test]
    fn stages_that_do_not_exist_are_refused() {
        assert!(OutputStage::try_new(-1.0, 0.0, 0.0).is_err() && OutputStage::try_new(1.0, f64::NAN, 0.0).is_err());
        assert!(OutputStage::of_bits(f64::INFINITY, 8, 0.0).is_err() && OutputStage::of_bits(1.0, 1, 0.0).is_err());
        assert!(OutputStage::of_pulse_width(1.0, 0, 0.0).is_err());
    }
}
