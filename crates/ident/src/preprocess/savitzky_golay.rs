//! Least-squares polynomials over a sliding window \[Savitzky1964\]: smoothing and derivatives in one.

use faer::Mat;

/// A filter of one window and order.
#[derive(Debug, Clone, PartialEq)]
pub struct SavitzkyGolay {
    half: usize,
    order: usize,
    /// `[derivative][place in the window]` of the polynomial's coefficients at the centre.
    weights: Vec<Vec<f64>>,
}

impl SavitzkyGolay {
    /// Over `2·half + 1` samples with polynomials of an order below that many.
    #[must_use]
    pub fn new(half: usize, order: usize) -> Self {
        let order = order.min(2 * half);
        let n = 2 * half + 1;
        // Places from −1 to 1 keep the powers of one size.
        let place = |i: usize| if half == 0 { 0.0 } else { (i as f64 - half as f64) / half as f64 };
        let powers = Mat::from_fn(n, order + 1, |i, k| (0..k).fold(1.0, |p, _| p * place(i)));
        // The pseudo-inverse by the small square factor: one row per power, one column per place.
        let factor = powers.qr();
        let (q, r) = (factor.compute_thin_Q(), factor.thin_R().to_owned());
        let mut inverse = q.transpose().to_owned();
        r.as_ref().solve_upper_triangular_in_place(inverse.as_mut());
        let unit = |k: usize| (0..k).fold(1.0, |p, _| p / (half.max(1) as f64));
        let weights = (0..=order).map(|k| (0..n).map(|i| inverse[(k, i)] * unit(k)).collect()).collect();
        Self { half, order, weights }
    }

    /// The window whose half-power frequency is `cutoff_hz` \[Schafer2011, eq. 12\], at the sample period `dt` `[s]`.
    #[must_use]
    pub fn with_cutoff(cutoff_hz: f64, order: usize, dt: f64) -> Self {
        let ratio = (2.0 * cutoff_hz * dt).clamp(1e-6, 0.9);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a positive number of samples below 1e7")]
        let half = (((order as f64 + 1.0) / ratio + 4.6) / 3.2).round() as usize;
        Self::new(half.max(order / 2 + 1), order)
    }

    /// Samples to each side.
    #[must_use]
    pub fn half(&self) -> usize {
        self.half
    }

    /// The smoothed signal (`derivative` 0) or its derivatives per second; the first and last window's polynomials serve the ends.
    ///
    /// What it does to noise: the derivative of white noise of standard deviation `s` has `s` times the length of the weights.
    #[must_use]
    pub fn apply(&self, x: &[f64], derivative: usize, dt: f64) -> Vec<f64> {
        let (n, window) = (x.len(), 2 * self.half + 1);
        if derivative > self.order || n == 0 {
            return vec![0.0; n];
        }
        if n < window {
            // A recording shorter than the window: the widest that fits.
            let half = (n - 1) / 2;
            return Self::new(half, self.order.min(2 * half)).apply(x, derivative, dt);
        }
        let scale = (1..=derivative).fold(1.0, |s, k| s * k as f64 / dt);
        let coefficient = |k: usize, from: usize| -> f64 { self.weights[k].iter().zip(&x[from..]).map(|(w, x)| w * x).sum() };
        let mut out = vec![0.0; n];
        for (i, out) in out.iter_mut().enumerate() {
            let centre = i.clamp(self.half, n - 1 - self.half);
            let from = centre - self.half;
            let u = i as f64 - centre as f64;
            // Derivative of Σ c_k·u^k at u, over `derivative` factorial.
            let mut sum = 0.0;
            for k in (derivative..=self.order).rev() {
                if centre == i && k > derivative {
                    continue;
                }
                let choose = (0..derivative).fold(1.0, |c, j| c * (k - j) as f64 / (j + 1) as f64);
                sum += choose * coefficient(k, from) * (0..k - derivative).fold(1.0, |p, _| p * u);
            }
            *out = scale * sum;
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_classic_weights_come_out() {
        // Table of the original: quadratic, five points: (−3 12 17 12 −3)/35; derivative (−2 −1 0 1 2)/10.
        let f = SavitzkyGolay::new(2, 2);
        let impulse = |at: usize| (0..9).map(|i| f64::from(u8::from(i == at))).collect::<Vec<_>>();
        for (at, smooth, slope) in [(2, -3.0, 2.0), (3, 12.0, 1.0), (4, 17.0, 0.0), (5, 12.0, -1.0), (6, -3.0, -2.0)] {
            let x = impulse(at);
            assert!((f.apply(&x, 0, 1.0)[4] - smooth / 35.0).abs() < 1e-14);
            assert!((f.apply(&x, 1, 1.0)[4] + slope / 10.0).abs() < 1e-14, "{at}");
        }
    }

    #[test]
    fn polynomials_pass_unchanged_to_the_very_ends() {
        let dt = 0.02;
        let x: Vec<f64> = (0..60).map(|i| dt * f64::from(i)).map(|t| 1.0 - 2.0 * t + 3.0 * t * t - t * t * t).collect();
        let f = SavitzkyGolay::new(7, 3);
        for (i, (v, a)) in f.apply(&x, 1, dt).iter().zip(f.apply(&x, 2, dt)).enumerate() {
            let t = dt * i as f64;
            assert!((v - (-2.0 + 6.0 * t - 3.0 * t * t)).abs() < 1e-9 && (a - (6.0 - 6.0 * t)).abs() < 1e-7, "{i}: {v} {a}");
        }
        assert_eq!(f.apply(&x[..5], 0, dt).len(), 5);
    }
}
