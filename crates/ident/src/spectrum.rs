//! Spectra: where a motion ends and noise begins, and surrogates that keep a spectrum and lose everything else.

use core::f64::consts::PI;

use pkm_dyn::math;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex;

/// Frequency below which 99 % of a motion's velocity lies `[Hz]`, after its noise floor is taken off.
///
/// The floor is the median of the position spectrum between 0.35 and 0.48 of the sampling rate, where no robot moves; twenty times that
/// is subtracted everywhere, and the rest is weighted with the frequency squared. 0 when nothing rises above the floor.
#[must_use]
pub fn motion_bandwidth(q: &[f64], dt: f64) -> f64 {
    let n = q.len();
    if n < 16 {
        return 0.0;
    }
    let slope = (q[n - 1] - q[0]) / (n - 1) as f64;
    let mut x: Vec<Complex<f64>> = (0..n)
        .map(|i| {
            // Blackman window on the detrended position: its sidelobes (-58 dB) stay below the floor of any encoder.
            let u = 2.0 * PI * i as f64 / (n - 1) as f64;
            let window = 0.42 - 0.5 * math::cos(u) + 0.08 * math::cos(2.0 * u);
            Complex::new(window * (q[i] - q[0] - slope * i as f64), 0.0)
        })
        .collect();
    FftPlanner::new().plan_fft_forward(n).process(&mut x);
    let power: Vec<f64> = (0..n / 2).map(|k| x[k].norm_sqr()).collect();
    let share = |s: f64| {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of the spectrum's length")]
        let k = (s * n as f64) as usize;
        k.min(power.len())
    };
    let mut top: Vec<f64> = power[share(0.35)..share(0.48)].to_vec();
    top.sort_by(f64::total_cmp);
    // White noise exceeds 20 medians of its periodogram once in a million bins.
    let floor = 20.0 * top.get(top.len() / 2).copied().unwrap_or(0.0);
    let velocity: Vec<f64> = power.iter().enumerate().map(|(k, p)| (p - floor).max(0.0) * (k * k) as f64).collect();
    let total: f64 = velocity.iter().sum();
    let mut sum = 0.0;
    for (k, v) in velocity.iter().enumerate() {
        sum += v;
        if sum >= 0.99 * total && total > 0.0 {
            return k as f64 / (n as f64 * dt);
        }
    }
    0.0
}

/// A signal with the same power spectrum and random phases; `phases` must give at least `x.len() / 2` angles `[rad]`.
///
/// Whatever is a function of the robot's state in `x` is gone, what is merely coloured stays: the null hypothesis of a diagnosis.
#[must_use]
pub fn phase_randomised(x: &[f64], phases: &[f64]) -> Vec<f64> {
    let n = x.len();
    if n < 4 {
        return x.to_vec();
    }
    let mut planner = FftPlanner::new();
    let mut z: Vec<Complex<f64>> = x.iter().map(|&v| Complex::new(v, 0.0)).collect();
    planner.plan_fft_forward(n).process(&mut z);
    for k in 1..n.div_ceil(2) {
        let (s, c) = math::sin_cos(phases[k - 1]);
        z[k] *= Complex::new(c, s);
        z[n - k] = z[k].conj();
    }
    planner.plan_fft_inverse(n).process(&mut z);
    z.iter().map(|v| v.re / n as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bandwidth_of_two_sines_is_the_upper_one() {
        let dt = 0.01;
        let q: Vec<f64> = (0..4000)
            .map(|i| {
                let t = dt * f64::from(i);
                let x = math::sin(2.0 * PI * 0.2 * t) + 0.3 * math::sin(2.0 * PI * 0.7 * t);
                // a 20 µm encoder on a 50 mm motion
                (0.05 * x / 2e-5).round() * 2e-5
            })
            .collect();
        let f = motion_bandwidth(&q, dt);
        assert!((0.6..0.9).contains(&f), "{f}");
    }

    #[test]
    fn surrogates_keep_the_power_and_lose_the_shape() {
        let x: Vec<f64> = (0..500).map(|i| math::sin(0.1 * f64::from(i)) + 0.01 * f64::from(i % 7)).collect();
        let phases: Vec<f64> = (0..250).map(|i| f64::from(i * 37 % 100) * 0.0628).collect();
        let y = phase_randomised(&x, &phases);
        let power = |x: &[f64]| x.iter().map(|v| v * v).sum::<f64>();
        assert!((power(&x) - power(&y)).abs() < 1e-9 * power(&x));
        let dot: f64 = x.iter().zip(&y).map(|(a, b)| a * b).sum();
        assert!(dot.abs() < 0.95 * power(&x));
    }
}
