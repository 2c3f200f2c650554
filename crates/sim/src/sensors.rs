//! Sensors: encoders that round and are zeroed wrongly, efforts with noise.
//!
//! One file each: [`TickCounter`] (raw counts), [`VelocitySensor`] (pulses per period, or time between them), [`ForceCell`], [`Drift`], and
//! [`Sampling`] (a clock that jitters, frames that are lost).

mod counter;
mod drift;
mod force_cell;
mod sampling;
mod velocity;

pub use counter::TickCounter;
pub use drift::Drift;
pub use force_cell::{ForceCell, ForceCellConfig};
pub use sampling::{Sampled, Sampling, SamplingConfig};
pub use velocity::{VelocitySensing, VelocitySensor};

use pkm_dyn::effects::{Law, Robot};

use crate::random::Random;

/// The position sensor of one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Encoder {
    /// True position less reading `[m | rad]`.
    pub offset: f64,
    /// Width of a count `[m | rad]`; 0 does not round.
    pub resolution: f64,
    /// Standard deviation of white noise before rounding `[m | rad]`.
    pub noise: f64,
}

impl Encoder {
    /// The sensor of joint `j` with the offsets that the effects of `robot` give it.
    #[must_use]
    pub fn new(robot: &Robot, j: usize, resolution: f64, noise: f64) -> Self {
        Self { offset: robot.chain(j, |law| matches!(law, Law::PositionOffset)).sum(), resolution, noise }
    }

    /// What it reads at the true position `q` `[m | rad]`.
    pub(crate) fn read(&self, q: f64, random: &mut Random) -> f64 {
        let mut reading = q - self.offset;
        if self.noise > 0.0 {
            reading += self.noise * random.normal();
        }
        if self.resolution > 0.0 {
            reading = (reading / self.resolution).round() * self.resolution;
        }
        reading
    }
}

/// Adds white noise of `share` times the signal's own rms.
pub(crate) fn add_noise(signal: &mut [f64], share: f64, random: &mut Random) {
    let sigma = share * rms(signal.iter().copied());
    if sigma > 0.0 {
        for x in signal {
            *x += sigma * random.normal();
        }
    }
}

/// Root mean square; 0 of nothing.
pub(crate) fn rms(signal: impl Iterator<Item = f64>) -> f64 {
    let (n, sum) = signal.fold((0.0, 0.0), |(n, sum), x| (n + 1.0, sum + x * x));
    if n > 0.0 { pkm_dyn::math::sqrt(sum / n) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Stream;

    #[test]
    fn a_reading_is_the_true_position_less_the_offset_in_whole_counts() {
        let encoder = Encoder { offset: 0.002, resolution: 1e-4, noise: 0.0 };
        let reading = encoder.read(0.123_46, &mut Random::new(1, Stream::Encoders));
        assert!((reading - 0.1215).abs() < 1e-15, "{reading}");
    }

    #[test]
    fn noise_has_the_stated_share() {
        let mut signal = vec![2.0; 10_000];
        add_noise(&mut signal, 0.1, &mut Random::new(1, Stream::Efforts));
        let sigma = rms(signal.iter().map(|x| x - 2.0));
        // Five standard errors of a standard deviation.
        assert!((sigma / 0.2 - 1.0).abs() < 5.0 / 141.0, "{sigma}");
    }
}
