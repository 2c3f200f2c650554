//! What makes a motion good, as a function of the Gram matrix of the columns it shows, with its derivative.
//!
//! All criteria are to be made small. The Gram matrix is `M = WᵀW/rows`; `N` is the same of columns at length one, so kilograms and
//! kilogram square metres count alike.

use faer::{Mat, Side};
use pkm_dyn::math;

/// What is made small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Criterion {
    /// Condition number of the columns at length one: the worst amplification of errors \[Armas, sec. 2.1.5\].
    Condition,
    /// Minus the logarithm of the determinant of the information matrix, D-optimality: the volume of the confidence ellipsoid
    /// \[Swevers1997\].
    Determinant,
    /// Cosine of the angle between the columns of two effects, what the base parameters explain of both taken off.
    Angle,
    /// Minus the effort of each of two effects that neither the base parameters nor the other effect explain: whether they are told apart
    /// in noise \[Hunter1965\].
    Power,
}

impl Criterion {
    /// Every criterion.
    pub const ALL: [Self; 4] = [Self::Condition, Self::Determinant, Self::Angle, Self::Power];

    /// Name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Condition => "condition",
            Self::Determinant => "determinant",
            Self::Angle => "angle",
            Self::Power => "power",
        }
    }

    /// Whether it is about two effects.
    #[must_use]
    pub fn separates(self) -> bool {
        matches!(self, Self::Angle | Self::Power)
    }
}

/// Two effects after the base parameters have explained what they can.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Separation {
    /// Cosine of the angle between what is left of both.
    pub cosine: f64,
    /// Share of each effect's square that is left, `kappa`.
    pub left: [f64; 2],
    /// Effort of each effect, rms over drives and samples `[N | N·m]`.
    pub effort: [f64; 2],
    /// Effort of each effect that neither the base parameters nor any size of the other effect explain, rms `[N | N·m]`.
    pub alone: [f64; 2],
}

impl Separation {
    /// Angle between the two `[deg]`, 0 to 90.
    #[must_use]
    pub fn angle_deg(&self) -> f64 {
        math::acos(self.cosine.abs().min(1.0)).to_degrees()
    }
}

/// Eigenvalues of the scaled Gram matrix below this share of the largest are rounding.
const ROUNDING: f64 = 1e-13;

/// Weight of the power beside the angle: where the angle is right already, the motion must not dwindle.
const SIZE: f64 = 0.05;

/// An effect of which less than this share is left lies in the span of the base parameters.
pub(super) const IN_SPAN: f64 = 1e-8;

/// A criterion at one motion.
#[derive(Debug, Clone)]
pub(super) struct Judged {
    /// The criterion: the logarithm of the condition number, minus half the log-determinant per parameter, minus the logarithm of the sine,
    /// minus the logarithm of the effort alone.
    pub(super) value: f64,
    /// What is made small in its place, a smooth upper bound for the condition number and the same for the others.
    pub(super) smooth: f64,
    /// Derivative of `smooth` with respect to the Gram matrix, symmetric.
    pub(super) slope: Mat<f64>,
}

/// The Gram matrix at columns of length one, and the lengths; none with a column of length zero.
fn scaled(gram: &Mat<f64>) -> Option<(Mat<f64>, Vec<f64>)> {
    let lengths: Vec<f64> = (0..gram.nrows()).map(|i| math::sqrt(gram[(i, i)])).collect();
    let is_sound = lengths.iter().all(|l| *l > 0.0 && l.is_finite());
    is_sound.then(|| (Mat::from_fn(gram.nrows(), gram.ncols(), |i, j| gram[(i, j)] / (lengths[i] * lengths[j])), lengths))
}

/// Eigenvalues, ascending, and eigenvectors.
fn eigen(m: &Mat<f64>) -> Option<(Vec<f64>, Mat<f64>)> {
    let all = m.self_adjoint_eigen(Side::Lower).ok()?;
    let values: Vec<f64> = all.S().column_vector().iter().copied().collect();
    let top = values.last().copied()?;
    let floor = ROUNDING * top;
    (top > 0.0 && top.is_finite()).then(|| (values.into_iter().map(|x| x.max(floor)).collect(), all.U().to_owned()))
}

/// `U·diag(d)·Uᵀ`.
fn composed(u: &Mat<f64>, d: &[f64]) -> Mat<f64> {
    let half = Mat::from_fn(u.nrows(), u.ncols(), |i, j| u[(i, j)] * d[j]);
    half * u.transpose()
}

/// Judges the Gram matrix; with an effects' criterion its last two columns are the effects'. `sharpness` says how closely the smooth
/// condition number follows the true one: it is at most `ln(columns)/sharpness` above. None for columns of length zero or effects in the
/// span of the base parameters.
pub(super) fn judge(criterion: Criterion, gram: &Mat<f64>, sharpness: f64) -> Option<Judged> {
    let (n, lengths) = scaled(gram)?;
    match criterion {
        Criterion::Condition => condition(&n, &lengths, sharpness),
        Criterion::Determinant => determinant(&n, &lengths),
        Criterion::Angle | Criterion::Power => separate(criterion, &n, &lengths),
    }
}

/// `[ln Σλ^s + ln Σλ^(−s)]/2s`, which falls towards `ln(λ_max/λ_min)/2 = ln cond(W)` as `s` grows and has a derivative where eigenvalues
/// meet.
fn condition(n: &Mat<f64>, lengths: &[f64], s: f64) -> Option<Judged> {
    let (values, u) = eigen(n)?;
    let (low, top) = (values[0], values[values.len() - 1]);
    let up: Vec<f64> = values.iter().map(|x| math::powf(x / top, s)).collect();
    let down: Vec<f64> = values.iter().map(|x| math::powf(low / x, s)).collect();
    let (sum_up, sum_down) = (up.iter().sum::<f64>(), down.iter().sum::<f64>());
    let value = 0.5 * math::ln(top / low);
    // Weights of the eigenvalues' relative changes.
    let relative: Vec<f64> = up.iter().zip(&down).map(|(a, b)| 0.5 * (a / sum_up - b / sum_down)).collect();
    let absolute: Vec<f64> = relative.iter().zip(&values).map(|(w, x)| w / x).collect();
    let (g, gn) = (composed(&u, &absolute), composed(&u, &relative));
    // Lengths change with the motion too: N = D⁻¹·M·D⁻¹.
    let slope = Mat::from_fn(n.nrows(), n.nrows(), |i, j| {
        let own = if i == j { gn[(i, i)] } else { 0.0 };
        (g[(i, j)] - own) / (lengths[i] * lengths[j])
    });
    Some(Judged { value, smooth: value + 0.5 * math::ln(sum_up * sum_down) / s, slope })
}

/// `−ln det(M)/2p`.
fn determinant(n: &Mat<f64>, lengths: &[f64]) -> Option<Judged> {
    let (values, u) = eigen(n)?;
    let p = values.len() as f64;
    let sum: f64 = values.iter().map(|x| math::ln(*x)).sum::<f64>() + lengths.iter().map(|l| 2.0 * math::ln(*l)).sum::<f64>();
    let inverse: Vec<f64> = values.iter().map(|x| -0.5 / (p * x)).collect();
    let g = composed(&u, &inverse);
    let slope = Mat::from_fn(n.nrows(), n.nrows(), |i, j| g[(i, j)] / (lengths[i] * lengths[j]));
    let value = -0.5 * sum / p;
    Some(Judged { value, smooth: value, slope })
}

/// What the base parameters leave of the two effects: `S = C − BᵀA⁻¹B` at columns of length one, and `A⁻¹B`.
fn left_over(n: &Mat<f64>) -> Option<([f64; 3], Mat<f64>)> {
    let p = n.nrows().checked_sub(2)?;
    let b = n.submatrix(0, p, p, 2);
    let x = if p == 0 {
        Mat::zeros(0, 2)
    } else {
        let (values, u) = eigen(&n.submatrix(0, 0, p, p).to_owned())?;
        let inverse: Vec<f64> = values.iter().map(|x| 1.0 / x).collect();
        composed(&u, &inverse) * b
    };
    let s = n.submatrix(p, p, 2, 2).to_owned() - b.transpose() * &x;
    let [s11, s12, s22] = [s[(0, 0)], s[(0, 1)], s[(1, 1)]];
    (s11 > IN_SPAN && s22 > IN_SPAN).then_some(([s11, s12, s22], x))
}

/// The angle: `−ln sin`, with `sin² = det S/(S₁₁·S₂₂)`. The power: minus the mean logarithm of `√(S_ii)·sin` in units of effort.
fn separate(criterion: Criterion, n: &Mat<f64>, lengths: &[f64]) -> Option<Judged> {
    let ([s11, s12, s22], x) = left_over(n)?;
    let p = n.nrows() - 2;
    let (l1, l2) = (lengths[p], lengths[p + 1]);
    let [s11, s12, s22] = [s11 * l1 * l1, s12 * l1 * l2, s22 * l2 * l2];
    let determinant = s11 * s22 - s12 * s12;
    if determinant <= ROUNDING * s11 * s22 {
        return None;
    }
    let inverse = [s22 / determinant, -s12 / determinant, s11 / determinant];
    // Shares of ln det S and of ln S₁₁S₂₂ in the criterion, and in what is made small in its place.
    let [exact, smooth] = match criterion {
        Criterion::Angle => [[1.0, -1.0], [1.0 + SIZE, -1.0 - 0.5 * SIZE]],
        _ => [[1.0, -0.5]; 2],
    };
    let worth = |[a, b]: [f64; 2]| -0.5 * (a * math::ln(determinant) + b * math::ln(s11 * s22));
    let h = |i: usize, own: f64| -0.5 * (smooth[0] * inverse[i] + smooth[1] * own);
    let h = [h(0, 1.0 / s11), h(1, 0.0), h(2, 1.0 / s22)];
    // dS = Tᵀ·dM·T with T = [−A⁻¹B; 1].
    let t = Mat::from_fn(p + 2, 2, |i, j| if i < p { -x[(i, j)] * lengths[p + j] / lengths[i] } else { f64::from(u8::from(i - p == j)) });
    let h = Mat::from_fn(2, 2, |i, j| h[i + j]);
    let slope = &t * h * t.transpose();
    Some(Judged { value: worth(exact), smooth: worth(smooth), slope })
}

/// What the last two columns of a Gram matrix have left beside the others; none where an effect acts not at all or lies in their span.
pub(super) fn separation(gram: &Mat<f64>) -> Option<Separation> {
    let (n, lengths) = scaled(gram)?;
    let ([s11, s12, s22], _) = left_over(&n)?;
    let p = n.nrows() - 2;
    let cosine = s12 / math::sqrt(s11 * s22);
    let sine = math::sqrt((1.0 - cosine * cosine).max(0.0));
    let effort = [lengths[p], lengths[p + 1]];
    let alone = [effort[0] * math::sqrt(s11) * sine, effort[1] * math::sqrt(s22) * sine];
    Some(Separation { cosine, left: [s11, s22], effort, alone })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows that are no multiples of each other, with columns of very different size.
    fn rows(shift: f64) -> Mat<f64> {
        Mat::from_fn(30, 5, |i, j| math::sin(1.3 * (i * (j + 2)) as f64 + shift) * math::powf(10.0, j as f64 - 2.0) + 0.1 * j as f64)
    }

    fn gram(w: &Mat<f64>) -> Mat<f64> {
        w.transpose() * w * (1.0 / w.nrows() as f64)
    }

    #[test]
    fn slopes_are_those_of_finite_differences() {
        let w = rows(0.2);
        for criterion in Criterion::ALL {
            let m = gram(&w);
            let judged = judge(criterion, &m, 4.0).unwrap();
            for (i, j) in [(0, 0), (1, 1), (4, 4), (0, 3), (2, 4), (3, 4)] {
                let h = 1e-6 * math::sqrt(m[(i, i)] * m[(j, j)]);
                let moved = |by: f64| {
                    let mut m = m.clone();
                    m[(i, j)] += by;
                    if i != j {
                        m[(j, i)] += by;
                    }
                    judge(criterion, &m, 4.0).unwrap().smooth
                };
                let want = (moved(h) - moved(-h)) / (2.0 * h);
                let got = judged.slope[(i, j)] * if i == j { 1.0 } else { 2.0 };
                let size = 1.0 / math::sqrt(m[(i, i)] * m[(j, j)]);
                assert!((got - want).abs() < 1e-5 * (size + want.abs()), "{criterion:?} {i} {j}: {got} {want}");
            }
        }
    }

    #[test]
    fn the_condition_is_that_of_the_columns_at_length_one_and_the_smooth_one_bounds_it() {
        let w = rows(0.0);
        let m = gram(&w);
        let unit = Mat::from_fn(30, 5, |i, j| w[(i, j)] / w.col(j).norm_l2());
        let s = unit.singular_values().unwrap();
        for sharpness in [1.0, 4.0, 16.0] {
            let judged = judge(Criterion::Condition, &m, sharpness).unwrap();
            assert!((math::exp(judged.value) / (s[0] / s[4]) - 1.0).abs() < 1e-9);
            assert!(judged.smooth >= judged.value && judged.smooth <= judged.value + math::ln(5.0) / sharpness);
        }
    }

    #[test]
    fn separation_is_that_of_residuals() {
        let w = rows(0.4);
        let m = gram(&w);
        let found = separation(&m).unwrap();
        // Least squares on the three base columns, by hand of QR.
        let q = w.subcols(0, 3).to_owned().qr().compute_thin_Q();
        let z = w.subcols(3, 2).to_owned() - &q * (q.transpose() * w.subcols(3, 2));
        let (a, b) = (z.col(0), z.col(1));
        let cosine = (0..30).map(|i| z[(i, 0)] * z[(i, 1)]).sum::<f64>() / (a.norm_l2() * b.norm_l2());
        assert!((found.cosine - cosine).abs() < 1e-10);
        let kappa = a.norm_l2() / w.col(3).norm_l2();
        assert!((found.left[0] - kappa * kappa).abs() < 1e-10);
        let alone = a.norm_l2() * math::sqrt(1.0 - cosine * cosine) / math::sqrt(30.0);
        assert!((found.alone[0] / alone - 1.0).abs() < 1e-9);
        // A column of the base is in the span; so is a sum of two.
        let spanned = Mat::from_fn(30, 5, |i, j| if j == 4 { w[(i, 0)] + w[(i, 1)] } else { w[(i, j)] });
        assert!(separation(&gram(&spanned)).is_none() && judge(Criterion::Angle, &gram(&spanned), 1.0).is_none());
    }
}
