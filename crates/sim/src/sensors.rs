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
use pkm_dyn::math;
use pkm_ident::size::rms;

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
    /// Errors that repeat with position: amplitude `[m | rad]`, order `[1/m | 1/rad]`, phase `[rad]`.
    periodic: [[f64; 3]; MAX_PERIODIC],
    /// How fast the reading leaves the truth `[m/s | rad/s]`.
    drift: f64,
}

/// Periodic errors of one encoder: the disc's and the gear's, each with its double. More than that are summed up in nobody's file.
const MAX_PERIODIC: usize = 4;

impl Encoder {
    /// The sensor of joint `j` with the offsets that the effects of `robot` give it.
    #[must_use]
    pub fn new(robot: &Robot, j: usize, resolution: f64, noise: f64) -> Self {
        let mut periodic = [[0.0; 3]; MAX_PERIODIC];
        let stated = robot.effects.iter().filter(|e| e.is_at_joint(j) && matches!(e.entry.law, Law::PositionPeriodic));
        for (slot, e) in periodic.iter_mut().zip(stated) {
            slot.iter_mut().zip(&e.values).for_each(|(slot, value)| *slot = *value);
        }
        Self {
            offset: robot.chain(j, |law| matches!(law, Law::PositionOffset)).sum(),
            resolution,
            noise,
            periodic,
            drift: robot.chain(j, |law| matches!(law, Law::Drift)).sum(),
        }
    }

    /// A sensor without errors but counts of width `resolution` and noise `[m | rad]`.
    #[must_use]
    pub fn without_errors(resolution: f64, noise: f64) -> Self {
        Self { offset: 0.0, resolution, noise, periodic: [[0.0; 3]; MAX_PERIODIC], drift: 0.0 }
    }

    /// True position less reading, noise and counts apart, at the true position `q` `[m | rad]` and time `t` `[s]`.
    #[must_use]
    pub fn error(&self, q: f64, t: f64) -> f64 {
        let periodic =
            |[amplitude, order, phase]: &[f64; 3]| if *amplitude == 0.0 { 0.0 } else { amplitude * math::sin(order * q + phase) };
        self.offset + self.periodic.iter().map(periodic).sum::<f64>() - self.drift * t
    }

    /// The same sensor whose reading leaves the truth by `rate` more in every second `[m/s | rad/s]`.
    #[must_use]
    pub fn drifting(mut self, rate: f64) -> Self {
        self.drift += rate;
        self
    }

    /// The true position at which it reads `reading` `[m | rad]` when a run begins.
    #[must_use]
    pub(crate) fn true_position(&self, reading: f64) -> f64 {
        // A contraction by amplitude times order, far below one for anything that is still a position sensor.
        (0..50).fold(reading + self.offset, |q, _| reading + self.error(q, 0.0))
    }

    /// What it reads at the true position `q` `[m | rad]` at time `t` `[s]`.
    pub(crate) fn read(&self, q: f64, t: f64, random: &mut Random) -> f64 {
        let mut reading = q - self.error(q, t);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Stream;

    #[test]
    fn a_reading_is_the_true_position_less_the_offset_in_whole_counts() {
        let encoder = Encoder { offset: 0.002, resolution: 1e-4, noise: 0.0, periodic: [[0.0; 3]; MAX_PERIODIC], drift: 0.0 };
        let reading = encoder.read(0.123_46, 3.0, &mut Random::new(1, Stream::Encoders));
        assert!((reading - 0.1215).abs() < 1e-15, "{reading}");
    }

    #[test]
    fn a_disc_off_centre_and_a_drift_are_what_the_reading_lacks() {
        let mut encoder = Encoder { offset: 0.01, resolution: 0.0, noise: 0.0, periodic: [[0.0; 3]; MAX_PERIODIC], drift: 2e-3 };
        encoder.periodic[1] = [0.02, 3.0, 0.5];
        let (q, t) = (0.7, 4.0);
        let reading = encoder.read(q, t, &mut Random::new(1, Stream::Encoders));
        assert!((reading - (q - 0.01 - 0.02 * math::sin(3.0 * q + 0.5) + 8e-3)).abs() < 1e-15);
        let at_start = encoder.true_position(0.3);
        assert!((encoder.read(at_start, 0.0, &mut Random::new(1, Stream::Encoders)) - 0.3).abs() < 1e-15);
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
