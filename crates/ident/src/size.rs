//! Sizes of signals.

use pkm_dyn::math;

/// Root mean square; 0 of nothing.
#[must_use]
pub fn rms(signal: impl Iterator<Item = f64>) -> f64 {
    let (n, sum) = signal.fold((0.0, 0.0), |(n, sum), x| (n + 1.0, sum + x * x));
    if n > 0.0 { math::sqrt(sum / n) } else { 0.0 }
}

/// Work of an effort along its positions, by the trapezoidal rule `[J]`; what is no number is left out.
#[must_use]
pub fn work(tau: &[f64], q: &[f64]) -> f64 {
    tau.windows(2).zip(q.windows(2)).map(|(t, q)| 0.5 * (t[0] + t[1]) * (q[1] - q[0])).filter(|w| w.is_finite()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spring_stores_half_its_stiffness_times_the_square_of_its_stretch() {
        // The trapezoidal rule is exact for an effort that is a straight line.
        let q: Vec<f64> = (0..=10).map(|i| 0.02 * f64::from(i)).collect();
        let tau: Vec<f64> = q.iter().map(|q| 300.0 * q).collect();
        assert!((work(&tau, &q) - 0.5 * 300.0 * 0.2 * 0.2).abs() < 1e-12);
        assert!((work(&[1.0, f64::NAN, 1.0, 1.0], &[0.0, 1.0, 2.0, 3.0]) - 1.0).abs() < 1e-15, "one stretch is known");
        assert!((rms([3.0, -4.0].into_iter()) - math::sqrt(12.5)).abs() < 1e-15 && rms(core::iter::empty()).abs() < 1e-15);
    }
}
