//! Seeded random numbers whose bits depend on this file and the generator alone, not on a sampling library's version.

use pkm_dyn::math;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// What a stream of random numbers is for: one seed serves all of them, and adding a sensor does not change the motion.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Stream {
    Reference = 1,
    Encoders = 2,
    Efforts = 3,
    Hidden = 4,
    Person = 5,
    Jitter = 12,
    Counts = 16,
    ForceCells = 17,
    Sampling = 18,
    Drift = 19,
    Tremor = 20,
    Will = 21,
}

/// A stream of random numbers.
#[derive(Debug, Clone)]
pub(crate) struct Random {
    generator: ChaCha8Rng,
    spare: Option<f64>,
}

impl Random {
    pub(crate) fn new(seed: u64, stream: Stream) -> Self {
        Self::nth(seed, stream, 0)
    }

    /// The stream of the sensor, axis, … number `index` among those of its kind.
    pub(crate) fn nth(seed: u64, stream: Stream, index: usize) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(stream as u64 | (index as u64) << 8);
        Self { generator, spare: None }
    }

    /// Uniform in [0, 1): the upper 53 bits, which a double holds exactly.
    fn unit(&mut self) -> f64 {
        (self.generator.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(crate) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// −1 or 1.
    pub(crate) fn sign(&mut self) -> f64 {
        if self.unit() < 0.5 { -1.0 } else { 1.0 }
    }

    /// One of 0 … n−1; 0 when n is 0.
    pub(crate) fn index(&mut self, n: usize) -> usize {
        // The bias of the remainder is below n / 2^64.
        usize::try_from(self.generator.next_u64() % (n.max(1) as u64)).unwrap_or(0)
    }

    /// Normal with mean 0 and variance 1 (Box and Muller).
    pub(crate) fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        let radius = math::sqrt(-2.0 * math::ln(1.0 - self.unit()));
        let (s, c) = math::sin_cos(2.0 * core::f64::consts::PI * self.unit());
        self.spare = Some(radius * s);
        radius * c
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_numbers_have_mean_zero_and_variance_one() {
        let mut random = Random::new(7, Stream::Encoders);
        let n = 20_000;
        let x: Vec<f64> = (0..n).map(|_| random.normal()).collect();
        let mean = x.iter().sum::<f64>() / f64::from(n);
        let variance = x.iter().map(|x| x * x).sum::<f64>() / f64::from(n);
        // Five standard errors.
        assert!(mean.abs() < 5.0 / 141.0 && (variance - 1.0).abs() < 5.0 / 100.0, "{mean} {variance}");
    }

    #[test]
    fn streams_of_one_seed_differ_and_repeat() {
        let first = |stream| Random::new(3, stream).uniform(0.0, 1.0);
        assert_eq!(first(Stream::Hidden).to_bits(), first(Stream::Hidden).to_bits());
        assert_ne!(first(Stream::Hidden).to_bits(), first(Stream::Reference).to_bits());
    }
}
