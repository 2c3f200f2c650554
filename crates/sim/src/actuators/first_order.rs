//! A first-order lag, exact for any step: a current loop, an amplifier, a valve.

use pkm_dyn::math;

/// `time_constant·y' + y = u`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstOrderLag {
    time_constant: f64,
    output: f64,
}

impl FirstOrderLag {
    /// A lag of this time constant `[s]`, at rest at 0; without one (0, or less) the output is the input.
    #[must_use]
    pub const fn new(time_constant: f64) -> Self {
        Self { time_constant, output: 0.0 }
    }

    /// Its output.
    #[must_use]
    pub const fn output(&self) -> f64 {
        self.output
    }

    /// Brings it to rest at an input that has been held for ever.
    pub const fn settle(&mut self, input: f64) {
        self.output = input;
    }

    /// Lets `h` `[s]` pass under a constant input and returns the mean of the output meanwhile.
    pub fn advance(&mut self, input: f64, h: f64) -> f64 {
        // Also for a time constant that is no number.
        if !(self.time_constant > 0.0 && h > 0.0) {
            self.output = input;
            return input;
        }
        let (gap, decay) = (self.output - input, math::exp(-h / self.time_constant));
        self.output = input + gap * decay;
        input + gap * (self.time_constant / h) * (1.0 - decay)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_followed_exactly_whatever_the_steps() {
        for h in [1e-4, 3e-3, 0.1] {
            let (mut lag, mut t, mut area) = (FirstOrderLag::new(5e-3), 0.0, 0.0);
            for _ in 0..20 {
                area += h * lag.advance(2.0, h);
                t += h;
                let decay = math::exp(-t / 5e-3);
                assert!((lag.output() - 2.0 * (1.0 - decay)).abs() < 1e-13);
                assert!((area - 2.0 * (t - 5e-3 * (1.0 - decay))).abs() < 1e-13);
            }
        }
    }

    #[test]
    fn without_a_time_constant_the_output_is_the_input() {
        for time_constant in [0.0, -1.0, f64::NAN] {
            let mut lag = FirstOrderLag::new(time_constant);
            assert_eq!((lag.advance(3.0, 1e-3).to_bits(), lag.output().to_bits()), (3.0_f64.to_bits(), 3.0_f64.to_bits()));
        }
    }
}
