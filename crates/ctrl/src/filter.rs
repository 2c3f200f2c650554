//! Low-pass filters of one signal, discretised exactly for an input that is constant over a period: any period, also one of an overrun.

use pkm_dyn::math;

/// Share of the new input after `dt` `[s]` in a first-order low-pass of time constant `time_s` `[s]`; 1 where that is zero.
#[must_use]
pub fn low_pass_share(time_s: f64, dt: f64) -> f64 {
    if time_s > 0.0 { 1.0 - math::exp(-dt / time_s) } else { 1.0 }
}

/// A critically damped second-order low-pass: output and its rate.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SecondOrder {
    /// Output, in the unit of the input.
    pub x: f64,
    /// Rate of the output, in that unit per second.
    pub rate: f64,
}

impl SecondOrder {
    /// Moves on by `dt` `[s]` towards `input` with both poles at `-bandwidth` `[1/s]`.
    ///
    /// Closed form of `x'' + 2·w·x' + w²·x = w²·input`, so that steps of any length land on the same curve.
    pub fn step(&mut self, input: f64, bandwidth: f64, dt: f64) {
        let decay = math::exp(-bandwidth * dt);
        let gap = self.x - input;
        let slope = self.rate + bandwidth * gap;
        self.x = input + decay * (gap + slope * dt);
        self.rate = decay * (self.rate - bandwidth * slope * dt);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_long_step_equals_many_short_ones_on_the_closed_form() {
        let (mut once, mut often) = (SecondOrder::default(), SecondOrder::default());
        once.step(1.0, 8.0, 0.25);
        for _ in 0..25 {
            often.step(1.0, 8.0, 0.01);
        }
        let want = 1.0 - math::exp(-2.0) * 3.0;
        assert!((once.x - want).abs() < 1e-15 && (often.x - want).abs() < 1e-14, "{once:?} {often:?}");
        assert!((often.rate - 64.0 * 0.25 * math::exp(-2.0)).abs() < 1e-13, "{often:?}");
    }

    #[test]
    fn a_low_pass_without_a_time_constant_passes_everything() {
        assert!((low_pass_share(0.0, 0.01) - 1.0).abs() < 1e-15);
        assert!((low_pass_share(0.02, 0.02) - (1.0 - math::exp(-1.0))).abs() < 1e-15);
    }
}
