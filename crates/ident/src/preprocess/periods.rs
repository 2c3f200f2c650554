//! Averages over the periods of a periodic motion, and what they say of the noise without any model: the pure error.

use super::Done;
use crate::Recording;
use crate::error::InputError;

/// A period may be this share of a sample off a whole number of samples, over all periods together; else the signal is interpolated.
const ON_GRID: f64 = 0.01;

/// One period, averaged.
#[derive(Debug, Clone, PartialEq)]
pub struct Averaged {
    /// Mean over the periods, by phase.
    pub mean: Vec<f64>,
    /// Variance of a single sample about the mean of its phase, pooled: the noise, whatever the model.
    pub pure_error: f64,
    /// Degrees of freedom of it.
    pub freedom: f64,
    /// Periods averaged.
    pub periods: usize,
}

/// Averages a uniform signal (period of samples `dt` `[s]`) over whole periods of `period` `[s]`; unknown samples (NaN) do not count.
/// `None` with fewer than two periods.
///
/// What it does to noise: the variance falls by the number of periods.
#[must_use]
pub fn averaged(x: &[f64], dt: f64, period: f64) -> Option<Averaged> {
    let per = period / dt;
    if !(per.is_finite() && per >= 2.0) {
        return None;
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive numbers of samples")]
    let (n, periods) = (per.round() as usize, ((x.len() as f64 + 0.5) / per).floor() as usize);
    if periods < 2 {
        return None;
    }
    let is_on_grid = (per - per.round()).abs() * (periods as f64) < ON_GRID;
    let at = |phase: usize, k: usize| {
        if is_on_grid {
            return x.get(k * n + phase).copied().unwrap_or(f64::NAN);
        }
        // Phases are n even parts of the true period.
        let place = per * (k as f64 + phase as f64 / n as f64);
        if place > (x.len() - 1) as f64 { f64::NAN } else { super::sampled(x, place) }
    };
    let (mut mean, mut square, mut freedom) = (vec![f64::NAN; n], 0.0, 0.0);
    for (phase, mean) in mean.iter_mut().enumerate() {
        let known: Vec<f64> = (0..periods).map(|k| at(phase, k)).filter(|x| !x.is_nan()).collect();
        if known.is_empty() {
            continue;
        }
        *mean = known.iter().sum::<f64>() / known.len() as f64;
        square += known.iter().map(|x| (x - *mean) * (x - *mean)).sum::<f64>();
        freedom += (known.len() - 1) as f64;
    }
    Some(Averaged { mean, pure_error: square / f64::max(freedom, 1.0), freedom, periods })
}

/// Averages every signal of a recording on a grid.
pub(super) fn average(recording: &mut Recording, period: f64) -> Result<Vec<Done>, InputError> {
    let span = recording.duration();
    let bad = || InputError::Period { recording: recording.name.clone(), period, duration: span };
    let dt = if recording.len() > 1 { span / (recording.len() - 1) as f64 } else { return Err(bad()) };
    let mut found = Vec::new();
    for (name, signal) in &recording.signals {
        found.push((name.clone(), averaged(signal, dt, period).ok_or_else(bad)?));
    }
    let mut done = Vec::new();
    for (name, a) in &found {
        let numbers = [("periods", a.periods as f64), ("noise_sd", a.pure_error.sqrt()), ("freedom", a.freedom)];
        done.push(Done::new(recording, "period average", name, &numbers));
    }
    let start = recording.time[0];
    let n = found.first().map_or(0, |(_, a)| a.mean.len());
    recording.time = (0..n).map(|i| start + period * i as f64 / n as f64).collect();
    recording.signals = found.into_iter().map(|(name, a)| (name, a.mean)).collect();
    Ok(done)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_dyn::math;

    /// Numbers that look random: a linear congruence, summed to be near normal.
    fn noise(n: usize) -> Vec<f64> {
        let mut x = 12345_u64;
        let mut unit = || {
            x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (x >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..n).map(|_| (0..12).map(|_| unit()).sum::<f64>() - 6.0).collect()
    }

    #[test]
    fn the_mean_is_the_motion_and_the_pure_error_the_noise() {
        for (period, tolerance) in [(2.0, 0.03), (1.9937, 0.05)] {
            let x: Vec<f64> = noise(4000)
                .iter()
                .enumerate()
                .map(|(i, e)| math::sin(2.0 * core::f64::consts::PI * 0.01 * i as f64 / period) + 0.1 * e)
                .collect();
            let a = averaged(&x, 0.01, period).unwrap();
            assert_eq!(a.periods, 20);
            let n = a.mean.len();
            let error = a.mean.iter().enumerate().map(|(i, m)| m - math::sin(2.0 * core::f64::consts::PI * i as f64 / n as f64));
            let rms = (error.map(|e| e * e).sum::<f64>() / n as f64).sqrt();
            assert!(rms < 0.1 / 20.0_f64.sqrt() * 1.2, "{rms}");
            // Interpolated noise is smaller; on the grid it is what it was.
            if tolerance < 0.04 {
                assert!((a.pure_error.sqrt() / 0.1 - 1.0).abs() < tolerance, "{}", a.pure_error.sqrt());
            }
        }
        assert!(averaged(&[0.0; 100], 0.01, 0.7).is_none() && averaged(&[0.0; 100], 0.01, f64::NAN).is_none());
    }
}
