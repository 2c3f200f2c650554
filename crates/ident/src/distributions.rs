//! Tails of the distributions that tests of residuals and of exogeneity need.
//!
//! The incomplete gamma and beta functions come from their series and continued fractions, the latter by Lentz's method.

use pkm_dyn::math;

/// Coefficients of Lanczos's approximation of the gamma function for `g = 7` \[Lanczos1964\]: relative error below 1e-14.
const LANCZOS: [f64; 9] = [
    0.999_999_999_999_809_9,
    676.520_368_121_885_1,
    -1_259.139_216_722_402_8,
    771.323_428_777_653_1,
    -176.615_029_162_140_6,
    12.507_343_278_686_905,
    -0.138_571_095_265_720_12,
    9.984_369_578_019_572e-6,
    1.505_632_735_149_311_6e-7,
];

/// Terms of a series or continued fraction, at most; a few times the square root of the larger parameter are used.
const TERMS: usize = 10_000;

/// Relative change of a term at which it is the last.
const LAST: f64 = 1e-15;

/// Logarithm of the gamma function for `x > 0`.
#[must_use]
pub fn ln_gamma(x: f64) -> f64 {
    let x = x - 1.0;
    let mut sum = LANCZOS[0];
    for (k, c) in LANCZOS.iter().enumerate().skip(1) {
        sum += c / (x + k as f64);
    }
    let t = x + 7.5;
    0.5 * math::ln(2.0 * core::f64::consts::PI) + (x + 0.5) * math::ln(t) - t + math::ln(sum)
}

/// What a χ² variable of `m` degrees of freedom exceeds `x` with; 1 for `x <= 0`.
#[must_use]
pub fn chi_square_tail(x: f64, m: f64) -> f64 {
    if x.is_nan() || x <= 0.0 {
        return 1.0;
    }
    let (a, x) = (0.5 * m, 0.5 * x);
    let front = math::exp(a * math::ln(x) - x - ln_gamma(a));
    if x < a + 1.0 {
        let (mut term, mut sum) = (1.0 / a, 1.0 / a);
        for n in 1..TERMS {
            term *= x / (a + n as f64);
            sum += term;
            if term < LAST * sum {
                break;
            }
        }
        return (1.0 - front * sum).clamp(0.0, 1.0);
    }
    let fraction = continued(x + 1.0 - a, |n| -n * (n - a), |n| x + 2.0 * n + 1.0 - a);
    (front / fraction).clamp(0.0, 1.0)
}

/// What an F variable of `m` and `n` degrees of freedom exceeds `x` with; 1 for `x <= 0`.
#[must_use]
pub fn f_tail(x: f64, m: f64, n: f64) -> f64 {
    if x.is_nan() || x <= 0.0 {
        return 1.0;
    }
    incomplete_beta(n / (n + m * x), 0.5 * n, 0.5 * m)
}

/// What a standard normal variable exceeds in size: `P(|Z| > |z|)`.
#[must_use]
pub fn normal_two_sided(z: f64) -> f64 {
    chi_square_tail(z * z, 1.0)
}

/// The regularised incomplete beta function `I_x(a, b)`.
#[must_use]
pub fn incomplete_beta(x: f64, a: f64, b: f64) -> f64 {
    if x.is_nan() || x <= 0.0 {
        return 0.0;
    }
    if x >= 1.0 {
        return 1.0;
    }
    // The fraction converges fast below the mean; above, the other tail is computed.
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - incomplete_beta(1.0 - x, b, a);
    }
    let front = math::exp(ln_gamma(a + b) - ln_gamma(a) - ln_gamma(b) + a * math::ln(x) + b * math::ln(1.0 - x));
    let numerator = |n: f64| {
        let m = (0.5 * n).floor();
        if (n - 2.0 * m).abs() < 0.5 {
            m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m))
        } else {
            -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0))
        }
    };
    (front / (a * continued(1.0, numerator, |_| 1.0))).clamp(0.0, 1.0)
}

/// `b0 + a(1)/(b(1) + a(2)/(b(2) + …))` by Lentz's method.
fn continued(b0: f64, a: impl Fn(f64) -> f64, b: impl Fn(f64) -> f64) -> f64 {
    let keep = |x: f64| if x.abs() < 1e-300 { 1e-300 } else { x };
    let mut f = keep(b0);
    let (mut c, mut d) = (f, 0.0);
    for n in 1..TERMS {
        let n = n as f64;
        d = 1.0 / keep(b(n) + a(n) * d);
        c = keep(b(n) + a(n) / c);
        let step = c * d;
        f *= step;
        if (step - 1.0).abs() < LAST {
            break;
        }
    }
    f
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_forms_are_met() {
        let near = |got: f64, want: f64| assert!((got - want).abs() <= 1e-12 * want.abs(), "{got} {want}");
        near(ln_gamma(0.5), 0.5 * math::ln(core::f64::consts::PI));
        near(ln_gamma(11.0), math::ln(3_628_800.0));
        // With two degrees of freedom both tails are elementary.
        near(chi_square_tail(5.0, 2.0), math::exp(-2.5));
        near(chi_square_tail(0.3, 2.0), math::exp(-0.15));
        near(f_tail(3.0, 2.0, 10.0), math::powf(1.0 + 0.6, -5.0));
        near(incomplete_beta(0.3, 1.0, 4.0), 1.0 - math::powf(0.7, 4.0));
        assert!((normal_two_sided(-1.959_963_984_540_054) - 0.05).abs() < 1e-14);
        assert!((chi_square_tail(-1.0, 3.0) - 1.0).abs() < 1e-15 && (f_tail(f64::NAN, 2.0, 9.0) - 1.0).abs() < 1e-15);
    }
}
