//! Least-squares splines with uniform knots: smoothing by what the knots can follow, derivatives exact ones of the spline.

/// Degree: acceleration is then smooth twice over.
pub const DEGREE: usize = 5;

/// Basis functions that act at one place.
const ORDER: usize = DEGREE + 1;

/// A spline fitted to uniform samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Spline {
    knots: Vec<f64>,
    coefficients: Vec<f64>,
}

/// The basis functions that act at `t` and the first of them, by Cox and de Boor \[DeBoor1978, chapter X\].
fn basis(knots: &[f64], t: f64, degree: usize) -> (usize, [f64; ORDER]) {
    let last = knots.len() - DEGREE - 2;
    let span = knots.partition_point(|k| *k <= t).clamp(DEGREE + 1, last + 1) - 1;
    let mut b = [0.0; ORDER];
    b[0] = 1.0;
    for d in 1..=degree {
        let mut saved = 0.0;
        for r in 0..d {
            let (right, left) = (knots[span + r + 1], knots[span + 1 + r - d]);
            let share = if right > left { b[r] / (right - left) } else { 0.0 };
            b[r] = saved + (right - t) * share;
            saved = (t - left) * share;
        }
        b[d] = saved;
    }
    (span - degree, b)
}

impl Spline {
    /// Least squares through samples at `dt·i` `[s]` with knots about `spacing` `[s]` apart; at least as many samples as knots are kept.
    /// `None` with fewer samples than a polynomial of the degree needs.
    #[must_use]
    pub fn fit(x: &[f64], dt: f64, spacing: f64) -> Option<Self> {
        let n = x.len();
        if n < ORDER + 1 || spacing.is_nan() || spacing <= 0.0 {
            return None;
        }
        let span = dt * (n - 1) as f64;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a positive ratio, bound by the number of samples")]
        let parts = (span / spacing).round().clamp(1.0, (n - DEGREE - 1) as f64) as usize;
        let mut knots = vec![0.0; DEGREE];
        knots.extend((0..=parts).map(|i| span * i as f64 / parts as f64));
        knots.extend([span; DEGREE]);
        let m = knots.len() - ORDER;
        // Normal equations are banded: row i holds columns i to i + DEGREE.
        let (mut band, mut right) = (vec![[0.0; ORDER]; m], vec![0.0; m]);
        for (i, x) in x.iter().enumerate() {
            let (from, b) = basis(&knots, (dt * i as f64).min(span), DEGREE);
            for r in 0..ORDER {
                right[from + r] += b[r] * x;
                for c in r..ORDER {
                    band[from + r][c - r] += b[r] * b[c];
                }
            }
        }
        let coefficients = solve_banded(band, right)?;
        Some(Self { knots, coefficients })
    }

    /// Number of coefficients.
    #[must_use]
    pub fn len(&self) -> usize {
        self.coefficients.len()
    }

    /// Whether there is no coefficient; never.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.coefficients.is_empty()
    }

    /// The spline (`derivative` 0) or its derivatives per second, at `dt·i` for `n` samples.
    #[must_use]
    pub fn sample(&self, n: usize, dt: f64, derivative: usize) -> Vec<f64> {
        let mut c = self.coefficients.clone();
        // Coefficients of the derivative, over the same knots with the ends taken off.
        for k in 0..derivative.min(DEGREE) {
            let degree = DEGREE - k;
            let next = |i: usize| {
                let width = self.knots[i + 1 + k + degree] - self.knots[i + 1 + k];
                if width > 0.0 { degree as f64 * (c[i + 1] - c[i]) / width } else { 0.0 }
            };
            c = (0..c.len() - 1).map(next).collect();
        }
        if derivative > DEGREE {
            return vec![0.0; n];
        }
        let degree = DEGREE - derivative;
        let last = self.knots[self.knots.len() - 1];
        (0..n)
            .map(|i| {
                let (from, b) = basis(&self.knots, (dt * i as f64).min(last), degree);
                let from = from - derivative;
                (0..=degree).map(|r| b[r] * c[from + r]).sum()
            })
            .collect()
    }
}

/// Solves a symmetric positive definite banded system by Cholesky; `None` when it is singular.
fn solve_banded(mut band: Vec<[f64; ORDER]>, mut x: Vec<f64>) -> Option<Vec<f64>> {
    let n = band.len();
    for i in 0..n {
        let pivot = band[i][0];
        if pivot.is_nan() || pivot <= 1e-14 * band[0][0].abs() {
            return None;
        }
        let row = band[i];
        for c in 1..ORDER.min(n - i) {
            let factor = row[c] / pivot;
            for d in c..ORDER {
                if i + d < n {
                    band[i + c][d - c] -= factor * row[d];
                }
            }
            x[i + c] -= factor * x[i];
        }
    }
    for i in (0..n).rev() {
        let known: f64 = (1..ORDER.min(n - i)).map(|c| band[i][c] * x[i + c]).sum();
        x[i] = (x[i] - known) / band[i][0];
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_dyn::math;

    #[test]
    fn a_polynomial_of_its_degree_is_met_with_all_derivatives() {
        let dt = 0.05;
        let p = |t: f64| [t * t * t * t * t - 2.0 * t * t + 1.0, 5.0 * t * t * t * t - 4.0 * t, 20.0 * t * t * t - 4.0];
        let x: Vec<f64> = (0..41).map(|i| p(dt * f64::from(i))[0]).collect();
        let spline = Spline::fit(&x, dt, 0.3).unwrap();
        for d in 0..3 {
            for (i, y) in spline.sample(41, dt, d).iter().enumerate() {
                assert!((y - p(dt * i as f64)[d]).abs() < 1e-7, "{d} {i}: {y}");
            }
        }
        assert!(Spline::fit(&x[..5], dt, 0.3).is_none());
    }

    #[test]
    fn a_sine_is_followed_and_noise_between_the_knots_is_not() {
        let dt = 0.001;
        let t = |i: usize| dt * i as f64;
        let x: Vec<f64> = (0..5000).map(|i| math::sin(6.0 * t(i)) + 1e-3 * if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let a = Spline::fit(&x, dt, 0.05).unwrap().sample(5000, dt, 2);
        let worst = (50..4950).map(|i| (a[i] + 36.0 * math::sin(6.0 * t(i))).abs()).fold(0.0, f64::max);
        // Differences of neighbours would show 4000 of the noise.
        assert!(worst < 0.1, "{worst}");
    }
}
