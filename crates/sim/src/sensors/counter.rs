//! A position counter as the drive's electronics have it: whole ticks, a limited number of bits, and noise on the edge.

use pkm_dyn::math;
use pkm_hal::units::EncoderScale;

use crate::error::SimError;
use crate::random::{Random, Stream};

/// Counts ticks and wraps at the end of its bits.
#[derive(Debug, Clone)]
pub struct TickCounter {
    scale: EncoderScale,
    zero: f64,
    bits: u32,
    noise: f64,
    random: Random,
}

/// Whole numbers up to here are exact in a double.
const EXACT: f64 = 9.0e15;

impl TickCounter {
    /// A counter of `bits` bits (1 to 32) and ticks of width `tick` that reads 0 at `zero`, with white noise before rounding of standard
    /// deviation `noise`, all `[m | rad]`; `seed` and the number of the `axis` choose the noise.
    ///
    /// # Errors
    /// A tick of no width, numbers that are none, or bits that no counter has.
    pub fn try_new([tick, zero, noise]: [f64; 3], bits: u32, seed: u64, axis: usize) -> Result<Self, SimError> {
        let bad = |what, value, limit| Err(SimError::Scenario { what, value, limit });
        let Ok(scale) = EncoderScale::try_new(tick, zero) else {
            return bad("width of a tick", tick, "must be finite and not 0, and so must its zero be finite");
        };
        if !(noise.is_finite() && noise >= 0.0) {
            return bad("noise of a counter", noise, "must be finite and not negative");
        }
        if !(1..=32).contains(&bits) {
            return bad("bits of a counter", f64::from(bits), "1 to 32");
        }
        Ok(Self { scale, zero, bits, noise, random: Random::nth(seed, Stream::Counts, axis) })
    }

    /// What it reads at the true position `q` `[m | rad]`: the low bits of the count.
    pub fn read(&mut self, q: f64) -> u32 {
        let noise = if self.noise > 0.0 { self.noise * self.random.normal() } else { 0.0 };
        low_bits(math::round((q + noise - self.zero) / self.scale.tick()), self.bits)
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "masked: the low bits are what a counter keeps")]
fn low_bits(count: f64, bits: u32) -> u32 {
    (count.clamp(-EXACT, EXACT) as i64 as u64 & (u64::MAX >> (64 - bits))) as u32
}

#[cfg(test)]
mod tests {
    use pkm_hal::units::UnwrappedTicks;

    use super::*;

    #[test]
    fn a_counter_followed_across_its_wraps_is_the_position_in_ticks() {
        let mut counter = TickCounter::try_new([-1e-3, 0.2, 0.0], 8, 1, 0).unwrap();
        let mut ticks = UnwrappedTicks::new(8, counter.read(0.2));
        for k in 0..4000 {
            let q = 0.2 + 3.0 * math::sin(1e-2 * f64::from(k));
            let total = ticks.follow(counter.read(q));
            let error = q - (0.2 - 1e-3 * total as f64);
            assert!(error.abs() <= 0.5e-3 + 1e-12, "at {q}: off by {error}");
        }
    }

    #[test]
    fn a_position_at_random_is_rounded_with_a_variance_of_a_twelfth_of_a_tick_squared() {
        let (tick, mut counter) = (1e-3, TickCounter::try_new([1e-3, 0.0, 0.0], 32, 1, 0).unwrap());
        let mut random = Random::new(5, Stream::Counts);
        let n = 40_000;
        let error = |q: f64, counter: &mut TickCounter| tick * f64::from(counter.read(q)) - q;
        let sum: f64 = (0..n).map(|_| error(random.uniform(0.0, 1.0), &mut counter)).map(|e| e * e).sum();
        let variance = sum / f64::from(n);
        // The variance of a variance of a uniform is (1/80 − 1/144)·tick⁴/n; five standard errors.
        let error = math::sqrt((1.0 / 80.0 - 1.0 / 144.0) / f64::from(n));
        assert!((variance / (tick * tick) - 1.0 / 12.0).abs() < 5.0 * error, "{variance}");
    }

    #[test]
    fn noise_has_its_width_and_each_axis_its_own() {
        let readings = |seed, axis| {
            let mut counter = TickCounter::try_new([1e-6, 0.0, 1e-3], 32, seed, axis).unwrap();
            (0..10_000).map(|_| f64::from(counter.read(0.0).cast_signed()) * 1e-6).collect::<Vec<_>>()
        };
        let x = readings(3, 0);
        let sigma = math::sqrt(x.iter().map(|x| x * x).sum::<f64>() / 10_000.0);
        assert!((sigma / 1e-3 - 1.0).abs() < 5.0 / 141.0, "{sigma}");
        assert_eq!(x, readings(3, 0));
        assert!(x != readings(3, 1) && x != readings(4, 0));
    }

    #[test]
    fn counters_that_do_not_exist_are_refused() {
        for (numbers, bits) in [([0.0, 0.0, 0.0], 8), ([1.0, f64::NAN, 0.0], 8), ([1.0, 0.0, -1.0], 8), ([1.0, 0.0, 0.0], 0)] {
            assert!(TickCounter::try_new(numbers, bits, 1, 0).is_err());
        }
    }
}
