//! Periodic motions as sums of fixed functions of time, linear in their coefficients.

use pkm_dyn::math;

/// Degree of the B-splines: position to jerk are continuous, and what the drives must supply changes smoothly.
const DEGREE: usize = 5;

/// Which functions a motion is the sum of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Basis {
    /// A constant and so many harmonics: `q = q_0 + Σ_k [a_k·sin(k·w·t) − b_k·cos(k·w·t)]/(k·w)` \[Swevers1997\], \[Armas, sec. 2.1.5\]. The
    /// coefficients `q_0, a_1, b_1, a_2, …` are a position and velocities.
    Fourier {
        /// Number of harmonics, at least 3.
        harmonics: usize,
    },
    /// Uniform periodic B-splines of degree five with so many pieces to a period \[Boor1978\]. The coefficients are control points, and the
    /// motion stays between the smallest and the largest of them.
    Spline {
        /// Number of pieces, at least 8.
        pieces: usize,
    },
}

impl Basis {
    /// Number of coefficients per drive.
    #[must_use]
    pub fn len(self) -> usize {
        match self {
            Self::Fourier { harmonics } => 2 * harmonics + 1,
            Self::Spline { pieces } => pieces,
        }
    }

    /// Whether there is no function at all.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// Name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Fourier { .. } => "fourier",
            Self::Spline { .. } => "spline",
        }
    }

    /// The fastest oscillation that the functions can show, in cycles per period.
    #[must_use]
    pub fn cycles(self) -> usize {
        match self {
            Self::Fourier { harmonics } => harmonics,
            Self::Spline { pieces } => pieces.div_ceil(2),
        }
    }

    /// The functions and their first and second derivatives at time `t` `[s]` of a period of `period_s` `[s]`, one entry per coefficient.
    #[must_use]
    pub fn at(self, t: f64, period_s: f64) -> [Vec<f64>; 3] {
        match self {
            Self::Fourier { harmonics } => fourier(harmonics, t, period_s),
            Self::Spline { pieces } => spline(pieces, t, period_s),
        }
    }
}

fn fourier(harmonics: usize, t: f64, period_s: f64) -> [Vec<f64>; 3] {
    let mut out = [vec![1.0], vec![0.0], vec![0.0]];
    for k in 1..=harmonics {
        let w = 2.0 * core::f64::consts::PI * k as f64 / period_s;
        // The phase within the period: whole periods would cost digits.
        let turns = (k as f64 * (t / period_s)).rem_euclid(1.0);
        let (s, c) = math::sin_cos(2.0 * core::f64::consts::PI * turns);
        out[0].extend([s / w, -c / w]);
        out[1].extend([c, s]);
        out[2].extend([-w * s, w * c]);
    }
    out
}

fn spline(pieces: usize, t: f64, period_s: f64) -> [Vec<f64>; 3] {
    let n = pieces as f64;
    let at = (t / period_s).rem_euclid(1.0) * n;
    let (mut q, mut v, mut a) = (vec![0.0; pieces], vec![0.0; pieces], vec![0.0; pieces]);
    for j in 0..pieces {
        let u = (at - j as f64).rem_euclid(n);
        q[j] = cardinal(DEGREE, u);
        // A derivative is a difference of splines of one degree less \[Boor1978, ch. X\].
        let lower = |u: f64| cardinal(DEGREE - 2, u);
        v[j] = (cardinal(DEGREE - 1, u) - cardinal(DEGREE - 1, u - 1.0)) * n / period_s;
        a[j] = (lower(u) - 2.0 * lower(u - 1.0) + lower(u - 2.0)) * n * n / (period_s * period_s);
    }
    [q, v, a]
}

/// The B-spline of that degree on whole knots that begins at 0.
fn cardinal(degree: usize, u: f64) -> f64 {
    if u < 0.0 || u >= (degree + 1) as f64 {
        return 0.0;
    }
    if degree == 0 {
        return 1.0;
    }
    let d = degree as f64;
    (u * cardinal(degree - 1, u) + (d + 1.0 - u) * cardinal(degree - 1, u - 1.0)) / d
}

/// A periodic motion of all drives.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Periodic {
    /// The functions.
    pub basis: Basis,
    /// Period `[s]`.
    pub period_s: f64,
    /// Coefficients of each drive.
    pub coefficients: Vec<Vec<f64>>,
}

/// State of all drives at one time, one entry per drive.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DriveState {
    /// Position `[m | rad]`.
    pub q: Vec<f64>,
    /// Velocity `[m/s | rad/s]`.
    pub v: Vec<f64>,
    /// Acceleration `[m/s² | rad/s²]`.
    pub a: Vec<f64>,
}

impl Periodic {
    /// The motion at time `t` `[s]`.
    #[must_use]
    pub fn at(&self, t: f64) -> DriveState {
        let rows = self.basis.at(t, self.period_s);
        let [q, v, a] = rows.map(|row| self.coefficients.iter().map(|c| dot(&row, c)).collect());
        DriveState { q, v, a }
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOTH: [Basis; 2] = [Basis::Fourier { harmonics: 5 }, Basis::Spline { pieces: 11 }];

    #[test]
    fn derivatives_are_those_of_finite_differences() {
        for basis in BOTH {
            let period = 3.0;
            for i in 0..50 {
                let (t, h) = (0.061 * f64::from(i) + 0.007, 1e-5);
                let [_, v, a] = basis.at(t, period);
                let [before, after] = [basis.at(t - h, period), basis.at(t + h, period)];
                for c in 0..basis.len() {
                    let difference = |order: usize| (after[order][c] - before[order][c]) / (2.0 * h);
                    assert!((difference(0) - v[c]).abs() < 1e-7 * (1.0 + v[c].abs()), "{basis:?} {t} {c}");
                    assert!((difference(1) - a[c]).abs() < 1e-6 * (1.0 + a[c].abs()), "{basis:?} {t} {c}");
                }
            }
        }
    }

    #[test]
    fn periods_are_alike() {
        for basis in BOTH {
            for t in [0.0, 0.3, 1.7, 2.999] {
                for (x, y) in basis.at(t, 3.0).iter().flatten().zip(basis.at(t + 3.0 * 7.0, 3.0).iter().flatten()) {
                    assert!((x - y).abs() < 1e-11 * (1.0 + x.abs()), "{basis:?} {t}");
                }
            }
        }
    }

    #[test]
    fn splines_and_four_derivatives_are_continuous_and_add_up_to_one() {
        let (pieces, period) = (9, 9.0);
        // Knots are whole seconds: one-sided differences of the second derivative on both sides of one.
        let a = |t: f64| spline(pieces, t, period)[2].clone();
        for c in 0..pieces {
            for knot in [1.0, 4.0, 9.0] {
                let h = 1e-4;
                let (left, at, right) = ([a(knot - 2.0 * h)[c], a(knot - h)[c]], a(knot)[c], [a(knot + h)[c], a(knot + 2.0 * h)[c]]);
                let jerk = [(at - left[1]) / h, (right[0] - at) / h];
                let snap = [(at - 2.0 * left[1] + left[0]) / (h * h), (right[1] - 2.0 * right[0] + at) / (h * h)];
                assert!((jerk[0] - jerk[1]).abs() < 1e-3, "{c} {knot} {jerk:?}");
                // The fourth derivative is continuous and has slope at most 10 per piece: it differs by the order of h.
                assert!((snap[0] - snap[1]).abs() < 30.0 * h + 1e-5, "{c} {knot} {snap:?}");
            }
        }
        for t in [0.0, 0.5, 3.3, 8.9] {
            let [q, v, a] = spline(pieces, t, period);
            assert!(
                (q.iter().sum::<f64>() - 1.0).abs() < 1e-14 && v.iter().sum::<f64>().abs() < 1e-13 && a.iter().sum::<f64>().abs() < 1e-13
            );
            assert!(q.iter().all(|x| *x >= 0.0) && q.iter().filter(|x| **x > 0.0).count() <= DEGREE + 1);
        }
        // De Boor's values at a knot: 1, 26, 66, 26, 1 over 120.
        let mut at_knot = spline(pieces, 0.0, period)[0].clone();
        at_knot.retain(|x| *x > 0.0);
        let mut sorted: Vec<f64> = at_knot.iter().map(|x| (120.0 * x).round()).collect();
        sorted.sort_by(f64::total_cmp);
        assert_eq!(sorted, [1.0, 1.0, 26.0, 26.0, 66.0]);
    }
}
