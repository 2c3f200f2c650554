//! Fewer samples, without folding what lies above the new band into it.

use super::Done;
use crate::Recording;
use crate::error::InputError;
use crate::filter::LowPass;

/// Cut-off of the filter before thinning, as a share of the new sampling rate: an amplitude at the new Nyquist frequency is down to 1.6 %.
const CUTOFF: f64 = 0.3;

/// Every `factor`-th sample of a uniform signal behind a zero-phase low-pass at 0.3 of the new rate.
///
/// What it does to noise: white noise loses all but about 0.54 of a share `1/factor` of its variance.
#[must_use]
pub fn decimated(x: &[f64], factor: usize) -> Vec<f64> {
    if factor <= 1 {
        return x.to_vec();
    }
    LowPass::new(CUTOFF / factor as f64, 1.0).apply(x).into_iter().step_by(factor).collect()
}

/// Thins a recording on a grid of period `dt` `[s]` to the rate nearest above `rate_hz`.
pub(super) fn decimate(recording: &mut Recording, dt: f64, rate_hz: f64) -> Result<Done, InputError> {
    let now = 1.0 / dt;
    if !(rate_hz.is_finite() && rate_hz > 0.0) {
        return Err(InputError::Rate { recording: recording.name.clone(), rate: rate_hz, limit: now });
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a positive ratio, clamped to the recording's length")]
    let factor = (now / rate_hz + 1e-9).clamp(1.0, recording.len().max(1) as f64) as usize;
    for signal in recording.signals.values_mut() {
        let unknown: Vec<bool> = signal.iter().map(|x| x.is_nan()).collect();
        let bridged = crate::grid::bridge(&recording.time, signal);
        let mut thin = decimated(&bridged, factor);
        for (i, x) in thin.iter_mut().enumerate() {
            let at = i * factor;
            if unknown[at.saturating_sub(factor - 1)..(at + factor).min(unknown.len())].contains(&true) {
                *x = f64::NAN;
            }
        }
        *signal = thin;
    }
    recording.time = recording.time.iter().copied().step_by(factor).collect();
    Ok(Done::new(recording, "decimation", "all", &[("factor", factor as f64), ("rate_hz", now / factor as f64)]))
}
