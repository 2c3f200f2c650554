//! Zero-phase low-pass filter and derivatives on a uniform grid.

use core::f64::consts::PI;

use pkm_dyn::math;

/// One second-order section, direct form II transposed.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Section {
    b: [f64; 3],
    a: [f64; 2],
}

/// Butterworth low-pass of order four, run forwards and backwards: no phase, half the power twice over at the cut-off.
///
/// What it does to noise: white noise of standard deviation `s` leaves with about `s·sqrt(0.9·cutoff·2·dt)`, correlated over
/// `1/(2·cutoff)`. The same filter must run over every column of a regression and over the effort.
#[derive(Debug, Clone, PartialEq)]
pub struct LowPass {
    sections: [Section; 2],
    pad: usize,
}

impl LowPass {
    /// For a cut-off `[Hz]` at the sample period `dt` `[s]`; a cut-off at or above 0.9 of the Nyquist frequency is brought down to it.
    #[must_use]
    pub fn new(cutoff_hz: f64, dt: f64) -> Self {
        let ratio = (cutoff_hz * 2.0 * dt).clamp(1e-6, 0.9);
        // Bilinear transform with the cut-off prewarped: the digital filter has its half-power point where it was asked for.
        let k = math::tan(0.5 * PI * ratio);
        let section = |angle: f64| {
            let damping = 2.0 * math::cos(angle);
            let norm = 1.0 / (1.0 + damping * k + k * k);
            let b0 = k * k * norm;
            Section { b: [b0, 2.0 * b0, b0], a: [2.0 * (k * k - 1.0) * norm, (1.0 - damping * k + k * k) * norm] }
        };
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a positive number of samples below 1e7")]
        let pad = ((3.0 / ratio) as usize).max(12);
        Self { sections: [section(PI / 8.0), section(3.0 * PI / 8.0)], pad }
    }

    /// Samples over which a disturbance spreads to each side.
    #[must_use]
    pub fn reach(&self) -> usize {
        self.pad
    }

    /// The filtered signal, as long as `x`; ends are extended by odd reflection.
    #[must_use]
    pub fn apply(&self, x: &[f64]) -> Vec<f64> {
        self.apply_each([x]).into_iter().map(|[y]| y).collect()
    }

    /// Signals of one length filtered side by side, sample by sample; each comes out as by [`Self::apply`], to the bit.
    ///
    /// A section waits for its own last output, so several at once take hardly longer than one.
    ///
    /// # Panics
    /// With signals of different lengths.
    #[must_use]
    pub fn apply_each<const N: usize>(&self, x: [&[f64]; N]) -> Vec<[f64; N]> {
        let n = x.first().map_or(0, |x| x.len());
        assert!(x.iter().all(|x| x.len() == n), "signals of one length");
        let at = |i: usize| x.map(|x| x[i]);
        if n < 2 {
            return (0..n).map(at).collect();
        }
        let pad = self.pad.min(n - 1);
        let mirrored = |end: usize, i: usize| x.map(|x| 2.0 * x[end] - x[i]);
        let mut y = Vec::with_capacity(n + 2 * pad);
        y.extend((1..=pad).rev().map(|i| mirrored(0, i)));
        y.extend((0..n).map(at));
        y.extend((1..=pad).map(|i| mirrored(n - 1, n - 1 - i)));
        for s in &self.sections {
            s.run(y.iter_mut());
        }
        for s in &self.sections {
            s.run(y.iter_mut().rev());
        }
        y[pad..pad + n].to_vec()
    }
}

impl Section {
    fn run<'y, const N: usize>(&self, mut y: impl Iterator<Item = &'y mut [f64; N]>) {
        let Some(first) = y.next() else { return };
        // Start in the steady state of the first value, else the start-up transient would look like motion.
        let mut z1 = first.map(|x| x * (1.0 - self.b[0]));
        let mut z2 = first.map(|x| x * (self.b[2] - self.a[1]));
        let mut step = |values: &mut [f64; N]| {
            for ((value, z1), z2) in values.iter_mut().zip(&mut z1).zip(&mut z2) {
                let x = *value;
                let out = self.b[0] * x + *z1;
                *z1 = self.b[1] * x - self.a[0] * out + *z2;
                *z2 = self.b[2] * x - self.a[1] * out;
                *value = out;
            }
        };
        step(first);
        y.for_each(step);
    }
}

/// Central difference of second order, one-sided at the ends; unit of `x` per second.
#[must_use]
pub fn derivative(x: &[f64], dt: f64) -> Vec<f64> {
    let n = x.len();
    if n < 2 {
        return vec![0.0; n];
    }
    let mut d: Vec<f64> = (0..n).map(|i| if i > 0 && i + 1 < n { (x[i + 1] - x[i - 1]) / (2.0 * dt) } else { 0.0 }).collect();
    d[0] = (x[1] - x[0]) / dt;
    d[n - 1] = (x[n - 1] - x[n - 2]) / dt;
    d
}

/// A series behind a first-order lag with the time constant `lag` `[s]`, sampled at the period `dt` `[s]`, by the trapezoidal rule: it starts
/// settled at its first value.
#[must_use]
pub fn lagged(x: &[f64], lag: f64, dt: f64) -> Vec<f64> {
    let (stay, go) = ((2.0 * lag - dt) / (2.0 * lag + dt), dt / (2.0 * lag + dt));
    let first = x.first().copied().unwrap_or(0.0);
    let (mut last, mut state) = (first, first);
    let step = |x: &f64| {
        state = stay * state + go * (*x + last);
        last = *x;
        state
    };
    x.iter().map(step).collect()
}

/// The signal `shift` seconds later, by cubic interpolation; held at the ends.
#[must_use]
pub fn advanced(x: &[f64], shift: f64, dt: f64) -> Vec<f64> {
    let n = x.len();
    let steps = shift / dt;
    let whole = steps.floor();
    let u = steps - whole;
    // Lagrange weights of the four neighbours.
    let w = [
        -u * (u - 1.0) * (u - 2.0) / 6.0,
        (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0,
        -(u + 1.0) * u * (u - 2.0) / 2.0,
        (u + 1.0) * u * (u - 1.0) / 6.0,
    ];
    // The ends are held once, so that the inner loop needs no clamping.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the signal's length")]
    let (ahead, behind) = (whole.clamp(0.0, n as f64) as usize, (-whole).clamp(0.0, n as f64) as usize);
    let (Some(&first), Some(&last)) = (x.first(), x.last()) else { return Vec::new() };
    let mut held = Vec::with_capacity(n + ahead + behind + 3);
    held.resize(behind + 1, first);
    held.extend_from_slice(x);
    held.resize(n + ahead + behind + 3, last);
    held[ahead..].windows(4).take(n).map(|h| w[0] * h[0] + w[1] * h[1] + w[2] * h[2] + w[3] * h[3]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine(f: f64, dt: f64, n: usize) -> Vec<f64> {
        (0..n).map(|i| math::sin(2.0 * PI * f * dt * i as f64)).collect()
    }

    #[test]
    fn zero_phase_gain_is_butterworth_squared() {
        let dt = 1e-3;
        for (f, fc) in [(5.0, 20.0), (20.0, 20.0), (60.0, 20.0), (100.0, 150.0)] {
            let y = LowPass::new(fc, dt).apply(&sine(f, dt, 8000));
            let (mut dot, mut own) = (0.0, 0.0);
            for (x, y) in sine(f, dt, 8000).iter().zip(&y).take(7000).skip(1000) {
                dot += x * y;
                own += x * x;
            }
            // The bilinear transform bends the frequency axis: |H|² of order 4 is 1/(1 + (tan f / tan fc)^8).
            let ratio = math::tan(PI * f * dt) / math::tan(PI * fc * dt);
            let gain = 1.0 / (1.0 + math::powf(ratio, 8.0));
            assert!((dot / own - gain).abs() < 2e-4, "{f} Hz through {fc} Hz: {} instead of {gain}", dot / own);
        }
    }

    #[test]
    fn a_ramp_passes_unchanged() {
        let x: Vec<f64> = (0..500).map(|i| 3.0 + 0.01 * f64::from(i)).collect();
        // Away from the ends, where the odd reflection of a ramp is a ramp again only up to the start-up of the filter.
        for (a, b) in x.iter().zip(LowPass::new(5.0, 0.01).apply(&x)).skip(60).take(380) {
            assert!((a - b).abs() < 1e-6, "{a} {b}");
        }
    }

    #[test]
    fn advancing_a_sine_turns_its_phase() {
        let (f, dt) = (5.0, 2e-3);
        let x = sine(f, dt, 1000);
        let later = advanced(&x, 3.3e-3, dt);
        for (i, x) in later.iter().enumerate().take(980).skip(10) {
            let want = math::sin(2.0 * PI * f * (dt * i as f64 + 3.3e-3));
            assert!((x - want).abs() < 1e-5);
        }
    }
}
