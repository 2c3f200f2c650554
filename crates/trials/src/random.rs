//! Random numbers of the trials: PCG streams, each with a name, so that one draw more in one place changes nothing in another.

use core::f64::consts::TAU;

use rand::{Rng as _, SeedableRng as _};
use rand_pcg::Pcg64;

use crate::math;

/// A stream of random numbers.
#[derive(Debug, Clone)]
pub struct Stream(Pcg64);

impl Stream {
    /// The stream called `name` of the case `case` under `seed`.
    #[must_use]
    pub fn new(seed: u64, case: u64, name: &str) -> Self {
        // FNV-1a: the names are few and ours; all it has to do is to tell them apart.
        let hash = name.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
        let mut bytes = [0_u8; 32];
        for (chunk, word) in bytes.chunks_exact_mut(8).zip([seed, case, hash, seed ^ case.rotate_left(32)]) {
            chunk.copy_from_slice(&word.to_le_bytes());
        }
        Self(Pcg64::from_seed(bytes))
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Uniform between `low` and `high`.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        let unit = (self.bits() >> 11) as f64 / (1_u64 << 53) as f64;
        low + (high - low) * unit
    }

    /// True with probability `p`.
    pub fn chance(&mut self, p: f64) -> bool {
        self.uniform(0.0, 1.0) < p
    }

    /// An index below `n`.
    pub fn index(&mut self, n: usize) -> usize {
        usize::try_from(self.bits() % n.max(1) as u64).unwrap_or(0)
    }

    /// One of the choices.
    pub fn choose<'a, T>(&mut self, choices: &'a [T]) -> Option<&'a T> {
        if choices.is_empty() { None } else { choices.get(self.index(choices.len())) }
    }

    /// Normally distributed with variance one (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * math::ln(1.0 - self.uniform(0.0, 1.0))).sqrt();
        radius * math::cos(self.uniform(0.0, TAU))
    }

    /// Plus or minus one.
    pub fn sign(&mut self) -> f64 {
        if self.chance(0.5) { 1.0 } else { -1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_are_reproducible_and_different() {
        let first = |seed, case, name| Stream::new(seed, case, name).bits();
        assert_eq!(first(1, 2, "a"), first(1, 2, "a"));
        assert!(first(1, 2, "a") != first(1, 2, "b") && first(1, 2, "a") != first(1, 3, "a") && first(1, 2, "a") != first(2, 2, "a"));
    }

    #[test]
    fn normal_numbers_have_the_moments_of_the_normal_distribution() {
        let mut stream = Stream::new(1, 1, "normal");
        let x: Vec<f64> = (0..40_000).map(|_| stream.normal()).collect();
        let moment = |p: i32| x.iter().map(|v| math::pow(v.abs(), f64::from(p)) * v.signum()).sum::<f64>() / x.len() as f64;
        let fourth = x.iter().map(|v| v * v * v * v).sum::<f64>() / x.len() as f64;
        let second = x.iter().map(|v| v * v).sum::<f64>() / x.len() as f64;
        assert!(moment(1).abs() < 0.02 && (second - 1.0).abs() < 0.03 && (fourth - 3.0).abs() < 0.2);
    }
}
