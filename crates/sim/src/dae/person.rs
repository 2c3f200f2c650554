//! A person who leans on a link: a force that no repetition of the motion brings back.

use core::f64::consts::TAU;

use nalgebra::Vector3;
use pkm_dyn::math;

use crate::random::{Random, Stream};

/// Tones of the force. With so many at drawn frequencies it does not repeat within hours.
const TONES: usize = 24;

/// Slowest and fastest tone `[Hz]`: from leaning to trembling.
const BAND_HZ: (f64, f64) = (0.05, 8.0);

/// Beyond this frequency a person's force falls off `[Hz]`.
const CORNER_HZ: f64 = 1.0;

/// A force of stated rms in a drawn direction: tones at drawn frequencies and phases, equal in number per octave, first-order fall-off.
///
/// A function of time and not of steps: every integrator sees the same force.
#[derive(Debug, Clone)]
pub(crate) struct Person {
    pub(crate) link: usize,
    direction: Vector3<f64>,
    /// Angular frequency `[rad/s]`, phase `[rad]`, amplitude `[N]`.
    tones: [[f64; 3]; TONES],
}

impl Person {
    /// The `index`-th person of the run with the given seed; `rms` `[N]`.
    pub(crate) fn draw(seed: u64, index: u64, link: usize, rms: f64) -> Self {
        let mut random = Random::new(seed.wrapping_add(index.wrapping_mul(0x9E37_79B9_7F4A_7C15)), Stream::Person);
        let direction = Vector3::from_fn(|_, _| random.normal());
        let length = math::sqrt(direction.dot(&direction)).max(f64::MIN_POSITIVE);
        let octaves = math::ln(BAND_HZ.1 / BAND_HZ.0);
        let mut tones = [[0.0; 3]; TONES];
        for (k, tone) in tones.iter_mut().enumerate() {
            let share = (k as f64 + random.uniform(0.0, 1.0)) / TONES as f64;
            let hz = BAND_HZ.0 * math::exp(share * octaves);
            let ratio = hz / CORNER_HZ;
            *tone = [TAU * hz, random.uniform(0.0, TAU), 1.0 / math::sqrt(1.0 + ratio * ratio)];
        }
        let power: f64 = tones.iter().map(|t| 0.5 * t[2] * t[2]).sum();
        for tone in &mut tones {
            tone[2] *= rms / math::sqrt(power);
        }
        Self { link, direction: direction / length, tones }
    }

    /// Force of the person on the link at time `t` `[s]`, in the root frame `[N]`.
    pub(crate) fn force(&self, t: f64) -> Vector3<f64> {
        self.direction * self.tones.iter().map(|[w, phase, size]| size * math::sin(w * t + phase)).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_person_pushes_with_the_stated_rms_along_one_direction_and_differs_from_seed_to_seed() {
        let person = Person::draw(3, 0, 1, 20.0);
        let forces: Vec<Vector3<f64>> = (0..200_000).map(|k| person.force(0.01 * f64::from(k))).collect();
        let rms = math::sqrt(forces.iter().map(|f| f.dot(f)).sum::<f64>() / forces.len() as f64);
        assert!((rms / 20.0 - 1.0).abs() < 0.02, "{rms} N");
        assert!(forces.iter().all(|f| f.cross(&person.direction).norm() < 1e-10));
        assert_eq!(person.force(1.7), Person::draw(3, 0, 1, 20.0).force(1.7));
        for other in [Person::draw(4, 0, 1, 20.0), Person::draw(3, 1, 1, 20.0)] {
            assert!((person.force(1.7) - other.force(1.7)).norm() > 0.1);
        }
    }
}
