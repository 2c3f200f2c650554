//! How far estimates can be trusted: covariance with coloured residuals, intervals, whiteness.
//!
//! What a model leaves of a recording is not white, so the textbook covariance `(WᵀW)⁻¹` is too small, often several times. Here it is the
//! sandwich `H⁻¹·Ω·H⁻¹` with `H = Σ WᵀW/σ²` and `Ω` from the autocovariance of each drive's residual, tapered to zero at a lag that the
//! residual itself gives. Both need only passes over the rows.

use alloc::collections::VecDeque;

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

use crate::error::InputError;
use crate::estimate::robust::dot;
use crate::observation::{Block, Observation, Rows};

/// Standard deviations to each side of a 95 % interval, where the covariance was estimated with autocovariances over the share `b` of a
/// series \[Kiefer2005\]: 1.96 for long recordings, more for short ones, whose covariance is itself uncertain.
#[must_use]
pub fn critical_95(b: f64) -> f64 {
    let b = b.clamp(0.0, 1.0);
    1.9600 + b * (2.9694 + b * (0.4160 - b * 0.5324))
}

/// Lags that are looked at, at most, and as a share of the rows.
const MOST_LAGS: usize = 200;
const LAG_SHARE: usize = 8;

/// Lags of the whiteness test.
const WHITE_LAGS: usize = 10;

/// The autocovariance counts up to the first run of this many lags within the bounds of white noise.
const QUIET_RUN: usize = 3;

/// A fit that leaves less than this share of the noise is no fit to take a spread from.
const LEAST_FREEDOM: f64 = 0.2;

/// Residual of one drive in the order of time.
#[derive(Debug, Clone, PartialEq)]
pub struct Residual {
    /// Rows.
    pub count: usize,
    /// Standard deviation `[N | N·m]`.
    pub deviation: f64,
    /// Autocovariance from lag 0 to where it vanishes `[N² | (N·m)²]`, tapered.
    pub autocovariance: Vec<f64>,
    /// Correlation of neighbouring rows.
    pub lag_one: f64,
    /// Ljung-Box statistic over ten lags, and what white noise exceeds once in twenty times \[Ljung1978\].
    pub ljung_box: [f64; 2],
    /// Third and fourth standardised moment; 0 and 3 for normal noise.
    pub moments: [f64; 2],
}

impl Residual {
    /// Of uniform series (one per recording), zero where there is no residual; `freedom` is the share of degrees of freedom that the fit left, 0 to 1.
    #[must_use]
    pub fn of(series: &[Vec<f64>], freedom: f64) -> Self {
        let count = series.iter().flatten().filter(|e| e.abs() > 0.0).count();
        let n = count.max(1) as f64;
        let longest = series.iter().map(Vec::len).max().unwrap_or(0);
        let lags = MOST_LAGS.min(longest / LAG_SHARE);
        let product = |s: &Vec<f64>, lag: usize| -> f64 { s.iter().skip(lag).zip(s).map(|(a, b)| a * b).sum() };
        let raw: Vec<f64> = (0..=lags).map(|lag| series.iter().map(|s| product(s, lag)).sum::<f64>() / n).collect();
        let variance = raw[0].max(f64::MIN_POSITIVE);
        let quiet = 2.0 / n.sqrt();
        let is_quiet = |lag: usize| raw[lag].abs() < quiet * variance;
        let end = (1..lags.saturating_sub(QUIET_RUN)).find(|&lag| (lag..lag + QUIET_RUN).all(is_quiet)).unwrap_or(lags);
        // Flat to where the correlation vanishes, then a slope as long: a triangle from lag zero would take a third of what is there.
        let taper = |lag: usize| if lag <= end { 1.0 } else { (1.0 - (lag - end) as f64 / (end + 1) as f64).max(0.0) };
        // Slow noise is taken up by slow columns: the fit has eaten more of it than its share of degrees of freedom.
        let colour = (1.0 + 2.0 * (1..=lags).map(|lag| taper(lag) * raw[lag] / variance).sum::<f64>()).max(1.0);
        let freedom = (1.0 - (1.0 - freedom) * colour).max(LEAST_FREEDOM);
        let autocovariance: Vec<f64> = raw.iter().take(2 * end + 2).enumerate().map(|(lag, c)| c * taper(lag) / freedom).collect();
        let m = WHITE_LAGS.min(lags);
        let q: f64 = (1..=m).map(|lag| (raw[lag] / variance) * (raw[lag] / variance) / (n - lag as f64)).sum();
        Self {
            count,
            deviation: (raw[0] / freedom).sqrt(),
            autocovariance,
            lag_one: raw.get(1).copied().unwrap_or(0.0) / variance,
            ljung_box: [n * (n + 2.0) * q, chi_square_95(m)],
            moments: moments(series),
        }
    }

    /// Of rows that share noise, more drives than freedoms projected onto the freedoms, `by` drives per freedom: the autocovariance is then
    /// that of a drive, of which a row has a part, so that a sum over rows that are taken for independent has the spread it has. Exact where
    /// all drives are alike in noise and in share.
    #[must_use]
    pub fn shared(mut self, by: f64) -> Self {
        self.autocovariance.iter_mut().for_each(|c| *c *= by);
        self
    }

    /// How often normal noise would be as skewed or heavy-tailed as this, by the moments \[Jarque1980\]; coloured rows count as fewer.
    ///
    /// Asymptotic: with fewer than some 200 rows small values are a little too frequent.
    #[must_use]
    pub fn normality(&self) -> f64 {
        let n = self.count as f64 / self.colour();
        let [skewness, kurtosis] = self.moments;
        let excess = kurtosis - 3.0;
        crate::distributions::chi_square_tail(n / 6.0 * (skewness * skewness + 0.25 * excess * excess), 2.0)
    }

    /// Lags of the autocovariance that count, as a share of the rows.
    #[must_use]
    pub fn bandwidth(&self) -> f64 {
        self.autocovariance.len() as f64 / self.count.max(1) as f64
    }

    /// Variance of a sum of residuals over that of as many white ones; at least 1.
    #[must_use]
    pub fn colour(&self) -> f64 {
        let Some(&variance) = self.autocovariance.first().filter(|c| **c > 0.0) else { return 1.0 };
        ((2.0 * self.autocovariance.iter().sum::<f64>() - variance) / variance).max(1.0)
    }

    /// Whether white noise could look like this.
    #[must_use]
    pub fn is_white(&self) -> bool {
        self.ljung_box[0] <= self.ljung_box[1]
    }
}

/// Skewness and kurtosis of everything that is not zero.
fn moments(series: &[Vec<f64>]) -> [f64; 2] {
    let all = || series.iter().flatten().copied().filter(|e| e.abs() > 0.0);
    let n = all().count().max(1) as f64;
    let mean = all().sum::<f64>() / n;
    let (mut second, mut third, mut fourth) = (0.0, 0.0, 0.0);
    for e in all().map(|e| e - mean) {
        let square = e * e;
        second += square / n;
        third += square * e / n;
        fourth += square * square / n;
    }
    if second > 0.0 { [third / (second * second.sqrt()), fourth / (second * second)] } else { [0.0, 3.0] }
}

/// What a χ² variable of `m` degrees of freedom exceeds once in twenty times \[Wilson1931\]; within 1 % from `m = 3` on.
fn chi_square_95(m: usize) -> f64 {
    let m = m.max(1) as f64;
    let a = 2.0 / (9.0 * m);
    let root = 1.0 - a + 1.644_854 * a.sqrt();
    m * root * root * root
}

/// Residual series of every drive with the parameters `theta`: `[drive][recording][row]`; zero where the drive's equation is not used, so
/// that time stays uniform.
///
/// # Errors
/// Loops that do not close along a recording.
pub fn residual_series(observation: &Observation<'_>, rows: Rows, theta: &[f64]) -> Result<Vec<Vec<Vec<f64>>>, InputError> {
    let n_recordings = observation.motions().len();
    let mut out = vec![vec![Vec::new(); n_recordings]; observation.robot().model.n_act()];
    observation.each(
        rows,
        &mut |block| {
            for (k, drive) in out.iter_mut().enumerate() {
                let e = |i: usize| {
                    if block.is_active(k, i) { block.target(k, i) - dot(block.row(k, i), theta) } else { 0.0 }
                };
                drive[block.recording].extend((0..block.len()).map(e));
            }
        },
        &mut |_| {},
    )?;
    Ok(out)
}

/// How much the rows of a drive have to say in an estimate that solves `Σ pull·Wᵀ·ψ = 0`: weighted least squares has `ψ = e` and
/// `pull = bend = 1/σ²`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Say {
    /// Weight of a row in the derivative of that sum with respect to the parameters.
    pub bend: f64,
    /// Weight of a row in the sum.
    pub pull: f64,
}

impl Say {
    /// Of weighted least squares with this standard deviation; none where it is infinite.
    #[must_use]
    pub fn weighted(noise: f64) -> Option<Self> {
        let weight = 1.0 / (noise * noise);
        noise.is_finite().then_some(Self { bend: weight, pull: weight })
    }
}

/// The matrices of the sandwich covariance, over one set of independent columns.
#[derive(Debug, Clone)]
pub struct Sandwich {
    /// `H = Σ bend·WᵀW`.
    information: Mat<f64>,
    /// `Ω`: the covariance of `Σ pull·Wᵀψ`.
    spread: Mat<f64>,
    /// The same of white residuals.
    white: Mat<f64>,
}

impl Sandwich {
    /// Over the columns `kept`, residuals coloured as `residuals` say; drives with infinite `noise` do not take part.
    ///
    /// # Errors
    /// Loops that do not close along a recording.
    pub fn of(observation: &Observation<'_>, kept: &[usize], noise: &[f64], residuals: &[Residual]) -> Result<Self, InputError> {
        let says: Vec<Option<Say>> = noise.iter().map(|s| Say::weighted(*s)).collect();
        Self::with(observation, kept, &says, residuals)
    }

    /// The same for any estimate of the kind of [`Say`], `residuals` being those of its `ψ`; drives without a say do not take part.
    ///
    /// # Errors
    /// Loops that do not close along a recording.
    pub fn with(observation: &Observation<'_>, kept: &[usize], says: &[Option<Say>], residuals: &[Residual]) -> Result<Self, InputError> {
        let p = kept.len();
        let mut out = Self { information: Mat::zeros(p, p), spread: Mat::zeros(p, p), white: Mat::zeros(p, p) };
        let mut past: Vec<VecDeque<Vec<f64>>> = vec![VecDeque::new(); says.len()];
        let mut recording = usize::MAX;
        observation.each(
            Rows::Fitted,
            &mut |block| {
                if block.recording != recording {
                    past.iter_mut().for_each(VecDeque::clear);
                    recording = block.recording;
                }
                for (k, say) in says.iter().enumerate().filter_map(|(k, say)| say.map(|say| (k, say))) {
                    out.add((block, k), kept, &mut past[k], say, &residuals[k].autocovariance);
                }
            },
            &mut |_| {},
        )?;
        Ok(out)
    }

    fn add(&mut self, (block, k): (&Block<'_>, usize), kept: &[usize], past: &mut VecDeque<Vec<f64>>, say: Say, gamma: &[f64]) {
        let p = kept.len();
        let (mut now, mut lagged) = (Mat::<f64>::zeros(block.len(), p), Mat::<f64>::zeros(block.len(), p));
        for i in 0..block.len() {
            let is_active = block.is_active(k, i);
            past.push_front(kept.iter().map(|&j| if is_active { block.row(k, i)[j] } else { 0.0 }).collect());
            past.truncate(gamma.len());
            for (lag, (old, c)) in past.iter().zip(gamma).enumerate() {
                // Each pair of rows once: the other half is the transpose.
                let c = if lag == 0 { 0.5 * c } else { *c };
                for (j, x) in old.iter().enumerate() {
                    lagged[(i, j)] += c * x;
                }
            }
            for (j, x) in past[0].iter().enumerate() {
                now[(i, j)] = *x;
            }
        }
        let gram = now.transpose() * &now;
        self.information += &gram * faer::Scale(say.bend);
        self.white += &gram * faer::Scale(say.pull * say.pull * gamma.first().copied().unwrap_or(0.0));
        let half = now.transpose() * &lagged * faer::Scale(say.pull * say.pull);
        self.spread += &half + half.transpose();
    }

    /// With `diagonal` taken off the information: what total least squares does to it.
    #[must_use]
    pub fn less(mut self, diagonal: &[f64]) -> Self {
        diagonal.iter().enumerate().for_each(|(j, x)| self.information[(j, j)] -= x);
        self
    }

    /// Covariance of an estimate `C·x` that is drawn to a prior with the `precision` of `x`, the prior counted as knowledge:
    /// `K·Ω·K + C·M⁻¹·Λ·M⁻¹·Cᵀ` with `M = Cᵀ·H·C + Λ` and `K = C·M⁻¹·Cᵀ`, which is `(H + Λ)⁻¹` for white residuals and `C = 1`; `None`
    /// when `M` is singular. `slack` is the variance about the prior over the one it states: 1 for a prior that is taken at its word.
    #[must_use]
    pub fn drawn(&self, c: &Mat<f64>, precision: &Mat<f64>, slack: f64) -> Option<Mat<f64>> {
        let m = c.transpose() * &self.information * c + precision;
        let n = m.nrows();
        let length: Vec<f64> = (0..n).map(|j| m[(j, j)].sqrt().max(f64::MIN_POSITIVE)).collect();
        let scaled = Mat::from_fn(n, n, |i, j| m[(i, j)] / (length[i] * length[j]));
        let inverse = scaled.llt(Side::Lower).ok()?.solve(Mat::<f64>::identity(n, n));
        let inverse = Mat::from_fn(n, n, |i, j| inverse[(i, j)] / (length[i] * length[j]));
        let through = c * &inverse;
        let k = &through * c.transpose();
        let mut sandwich = &k * &self.spread * &k;
        at_least_white(&mut sandwich, &(&k * &self.white * &k));
        Some(sandwich + &through * precision * through.transpose() * faer::Scale(slack))
    }

    /// Covariance of the estimate of some of the columns, given by their places among `kept`; `None` when it is singular.
    #[must_use]
    pub fn covariance(&self, of: &[usize]) -> Option<Mat<f64>> {
        let p = of.len();
        // Columns at length one, so that kilograms and kilogram square metres meet at one size.
        let length: Vec<f64> = of.iter().map(|&j| self.information[(j, j)].sqrt().max(f64::MIN_POSITIVE)).collect();
        let scaled = |m: &Mat<f64>| Mat::from_fn(p, p, |i, j| m[(of[i], of[j])] / (length[i] * length[j]));
        let inverse = scaled(&self.information).llt(Side::Lower).ok()?.solve(Mat::<f64>::identity(p, p));
        let mut sandwich = &inverse * scaled(&self.spread) * &inverse;
        at_least_white(&mut sandwich, &(&inverse * scaled(&self.white) * &inverse));
        Some(Mat::from_fn(p, p, |i, j| sandwich[(i, j)] / (length[i] * length[j])))
    }
}

/// Variances of a sandwich that are below those of white noise become those.
///
/// The flat kernel of the autocovariance is not positive semidefinite: against a residual with a line at one frequency, columns at others
/// come out with less than they have, or with less than nothing.
pub(crate) fn at_least_white(sandwich: &mut Mat<f64>, white: &Mat<f64>) {
    for k in 0..sandwich.nrows() {
        sandwich[(k, k)] = sandwich[(k, k)].max(white[(k, k)]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_residual_with_a_line_leaves_no_parameter_without_a_spread() {
        // Columns at one frequency, the residual at another and noise: the cut kernel's sums are negative for some.
        let n = 1500;
        let wave = |cycles: f64, i: usize| pkm_dyn::math::sin(2.0 * core::f64::consts::PI * cycles * i as f64 / n as f64);
        let residual: Vec<f64> = noise(n).iter().enumerate().map(|(i, e)| 0.3 * e + wave(3.0, i)).collect();
        let gamma = Residual::of(core::slice::from_ref(&residual), 1.0).autocovariance;
        let p = 7;
        let columns = Mat::from_fn(n, p, |i, k| wave(2.0 + k as f64, i));
        let mut spread = Mat::<f64>::zeros(p, p);
        for (lag, gamma) in gamma.iter().enumerate().take(n) {
            let (old, new) = (columns.subrows(0, n - lag), columns.subrows(lag, n - lag));
            let part = new.transpose() * old * faer::Scale(if lag == 0 { 0.5 * gamma } else { *gamma });
            spread += &part + part.transpose();
        }
        let gram = columns.transpose() * &columns;
        let sandwich = Sandwich { white: &gram * faer::Scale(gamma[0]), information: gram, spread };
        let places: Vec<usize> = (0..p).collect();
        let covariance = sandwich.covariance(&places).unwrap();
        // Of unit weights and columns of square n/2, that of white noise of the residual's variance.
        let white = 2.0 * gamma[0] / n as f64;
        assert!(places.iter().all(|&k| covariance[(k, k)] > 0.99 * white), "{covariance:?}");
    }

    /// Information `H` of rows in three columns, white residuals of variance `gamma`.
    fn white(columns: &Mat<f64>, gamma: f64) -> Sandwich {
        let gram = columns.transpose() * columns;
        Sandwich { spread: &gram * faer::Scale(gamma), white: &gram * faer::Scale(gamma), information: gram }
    }

    #[test]
    fn a_prior_is_counted_as_knowledge_and_a_face_is_the_rest_of_the_columns() {
        let columns = Mat::from_fn(200, 3, |i, j| pkm_dyn::math::sin(0.1 * (i * (j + 1)) as f64 + j as f64) * (j + 1) as f64);
        let (one, white) = (Mat::<f64>::identity(3, 3), white(&columns, 1.0));
        let precision = Mat::from_fn(3, 3, |i, j| if i == j { 50.0 * (i + 1) as f64 } else { 0.0 });
        // White residuals of unit variance: the posterior is (H + Λ)⁻¹.
        let found = white.drawn(&one, &precision, 1.0).unwrap();
        let product = (&white.information + &precision) * &found;
        assert!((&product - &one).norm_max() < 1e-10, "{product:?}");
        // Without a prior, on the face where the second parameter stays: the covariance of the other two, and none of the second.
        let face = Mat::from_fn(3, 2, |i, j| f64::from(u8::from(i == 2 * j)));
        let (held, rest) = (white.drawn(&face, &Mat::zeros(2, 2), 1.0).unwrap(), white.covariance(&[0, 2]).unwrap());
        for i in 0..3 {
            for j in 0..3 {
                let want = if i == 1 || j == 1 { 0.0 } else { rest[(i / 2, j / 2)] };
                assert!((held[(i, j)] - want).abs() < 1e-12, "{i} {j}: {} {want}", held[(i, j)]);
            }
        }
    }

    #[test]
    fn total_least_squares_holds_the_truth_where_columns_and_target_are_noisy_alike() {
        use crate::estimate::least_squares::total;
        use crate::factor::Factor;
        let (n, runs, truth) = (400, 300, [1.0, -2.0, 0.5]);
        let all = noise(n * 4 * runs);
        let (mut inside, mut below) = (0, 0);
        for run in 0..runs {
            let e = |i: usize, j: usize| all[(run * n + i) * 4 + j];
            let clean = |i: usize, j: usize| 1.4 * pkm_dyn::math::sin((0.31 + 0.4 * j as f64) * i as f64);
            let size = [clean_square(&clean, 0, n), clean_square(&clean, 1, n), clean_square(&clean, 2, n)];
            let target = |i: usize| (0..3).map(|j| truth[j] * clean(i, j)).sum::<f64>();
            let target_size = ((0..n).map(|i| target(i) * target(i)).sum::<f64>() / n as f64).sqrt();
            // A fifth of every column's and of the target's rms.
            let columns = Mat::from_fn(n, 3, |i, j| clean(i, j) + 0.2 * size[j] * e(i, j));
            let mut factor = Factor::new(3);
            let z: Vec<f64> = (0..n).map(|i| target(i) + 0.2 * target_size * e(i, 3)).collect();
            for i in 0..n {
                let row: Vec<f64> = (0..3).map(|j| columns[(i, j)]).collect();
                factor.push(&row, z[i], z[i]);
            }
            let found = total(&factor.triangle(), &[0, 1, 2]).unwrap();
            let left = factor.error_square(&found.values) / (n - 3) as f64;
            let covariance = white(&columns, left).less(&found.noise).covariance(&[0, 1, 2]).unwrap();
            let plain = white(&columns, left).covariance(&[0, 1, 2]).unwrap();
            for (j, want) in truth.iter().enumerate() {
                let miss = (found.values[j] - want).abs() / 1.96;
                inside += usize::from(miss <= covariance[(j, j)].sqrt());
                below += usize::from(miss <= plain[(j, j)].sqrt());
            }
        }
        let share = |count: usize| count as f64 / (3 * runs) as f64;
        assert!((0.92..0.985).contains(&share(inside)), "{}", share(inside));
        // Noise in the columns makes them look longer: intervals that do not take it off are too narrow.
        assert!(share(below) < share(inside), "{} {}", share(below), share(inside));
    }

    fn clean_square(clean: &dyn Fn(usize, usize) -> f64, j: usize, n: usize) -> f64 {
        ((0..n).map(|i| clean(i, j) * clean(i, j)).sum::<f64>() / n as f64).sqrt()
    }

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
    fn white_noise_is_called_white_and_coloured_noise_is_not() {
        let white = Residual::of(&[noise(4000)], 1.0);
        assert!(white.is_white() && (white.deviation - 1.0).abs() < 0.03 && white.autocovariance.len() < 10, "{white:?}");
        let mut last = 0.0;
        let coloured: Vec<f64> = noise(4000)
            .into_iter()
            .map(|e| {
                last = 0.9 * last + e;
                last
            })
            .collect();
        let coloured = Residual::of(&[coloured], 1.0);
        assert!(!coloured.is_white() && (coloured.lag_one - 0.9).abs() < 0.02 && coloured.autocovariance.len() > 20, "{coloured:?}");
    }

    #[test]
    fn normal_noise_passes_for_normal_and_its_square_does_not() {
        let white = Residual::of(&[noise(4000)], 1.0);
        assert!(white.normality() > 0.01 && (white.moments[1] - 3.0).abs() < 0.3, "{white:?}");
        let squared: Vec<f64> = noise(4000).iter().map(|e| e * e - 1.0).collect();
        let squared = Residual::of(&[squared], 1.0);
        // A χ² variable of one degree of freedom: skewness √8, kurtosis 15; the tails of sums of twelve are a little short.
        assert!(squared.normality() < 1e-12 && (squared.moments[0] / 8.0_f64.sqrt() - 1.0).abs() < 0.25, "{squared:?}");
        assert!((white.colour() - 1.0).abs() < 0.2);
    }

    #[test]
    fn the_table_of_chi_square_is_met() {
        for (m, want) in [(5, 11.070), (10, 18.307), (20, 31.410)] {
            assert!((chi_square_95(m) / want - 1.0).abs() < 3e-3, "{m}: {}", chi_square_95(m));
        }
    }
}
