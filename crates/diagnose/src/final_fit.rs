//! The final fit: coefficients with block-jackknife intervals, and held-out errors in the verdict's number.

use faer::Mat;
use pkm_dyn::math;

use crate::design::{ColumnId, Design, View};
use crate::rows::Rows;
use crate::screen;
use crate::solve::Over;
use crate::work::Work;

/// Coefficients on all fitted rows and with each fold left out.
pub(crate) struct FinalFit {
    pub(crate) ids: Vec<ColumnId>,
    pub(crate) theta: Mat<f64>,
    pub(crate) replicates: Vec<Mat<f64>>,
}

impl FinalFit {
    /// Fits `ids` with inverse prior variances `prior`.
    pub(crate) fn new(work: &Work, ids: Vec<ColumnId>, prior: &[f64]) -> Self {
        let cross = work.gram.cross(&work.design, &work.real_targets(&[work.softness]));
        let theta = screen::fit(&work.gram, &cross, &ids, prior, Over::All);
        let replicates = (0..work.design.n_folds).map(|f| screen::fit(&work.gram, &cross, &ids, prior, Over::AllBut(f))).collect();
        Self { ids, theta, replicates }
    }

    /// Coefficient of a column; 0 when it is not in the fit.
    pub(crate) fn coefficient(&self, id: ColumnId) -> f64 {
        self.at(&self.theta, id)
    }

    /// The same with fold `f` left out.
    pub(crate) fn replicate(&self, f: usize, id: ColumnId) -> f64 {
        self.at(&self.replicates[f], id)
    }

    fn at(&self, theta: &Mat<f64>, id: ColumnId) -> f64 {
        self.ids.iter().position(|&i| i == id).map_or(0.0, |i| theta[(i, 0)])
    }
}

/// Half the width of a 95 % interval from leave-one-block-out replicates: blocks are long against the residual's correlation, so this
/// needs no noise model.
pub(crate) fn jackknife_half_width(replicates: &[f64]) -> f64 {
    let n = replicates.len() as f64;
    if replicates.len() < 2 {
        return f64::INFINITY;
    }
    let mean = replicates.iter().sum::<f64>() / n;
    let variance = (n - 1.0) / n * replicates.iter().map(|r| (r - mean) * (r - mean)).sum::<f64>();
    student_95(replicates.len() - 1) * math::sqrt(variance)
}

/// Two-sided 95 % quantile of Student's t.
pub(crate) fn student_95(freedom: usize) -> f64 {
    const TABLE: [f64; 10] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228];
    match freedom {
        0 => f64::INFINITY,
        1..=10 => TABLE[freedom - 1],
        // Within 0.3 % of the exact quantile from eleven degrees of freedom on.
        _ => 1.96 + 2.5 / freedom as f64,
    }
}

/// rms values of one joint over the held-out rows, in the joint's unit.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct JointError {
    pub(crate) effort: f64,
    pub(crate) error: f64,
}

/// Errors per joint of what is left, over held-out rows, standstill included.
pub(crate) fn errors(work: &Work, left: &[Vec<Vec<f64>>]) -> Vec<JointError> {
    errors_on(&work.design, left)
}

/// The same before there is anything but rows.
pub(crate) fn errors_on(design: &Design, left: &[Vec<Vec<f64>>]) -> Vec<JointError> {
    errors_in(design, left, View::Judge)
}

/// The same where each joint moves, standstill cut out of what is left: friction of a joint that stands is whatever holds it.
pub(crate) fn errors_in_motion(work: &Work, left: &[Vec<Vec<f64>>]) -> Vec<JointError> {
    errors_in(&work.design, left, View::Fit)
}

fn errors_in(design: &Design, left: &[Vec<Vec<f64>>], view: View) -> Vec<JointError> {
    let rms_of = |j: usize| {
        let (mut e2, mut y2, mut n) = (0.0, 0.0, 0_usize);
        for (s, rows) in design.rows.iter().enumerate() {
            let measured = design.measured_rows(j, s, view);
            let counts = |i: usize| rows.valid[i] && rows.fold[i].is_none() && (view == View::Judge || rows.moving[j][i]);
            for i in (0..rows.time.len()).filter(|&i| counts(i)) {
                e2 += left[j][s][i] * left[j][s][i];
                y2 += measured[i] * measured[i];
                n += 1;
            }
        }
        let rms = |sum: f64| math::sqrt(sum / n.max(1) as f64);
        JointError { effort: rms(y2), error: rms(e2) }
    };
    (0..design.n_drives).map(rms_of).collect()
}

/// The verdict's number: root mean square over joints of error over effort.
pub(crate) fn pooled(errors: &[JointError]) -> f64 {
    let each = errors.iter().filter(|e| e.effort > 0.0);
    let (sum, n) = each.fold((0.0, 0_usize), |(s, n), e| (s + (e.error / e.effort) * (e.error / e.effort), n + 1));
    math::sqrt(sum / n.max(1) as f64)
}

/// What the model as given leaves, its own chain included: [joint][segment][row]. Where the recorded command lacked a share of the
/// controller's that is `missing`, the model's effort is too large by it for the recording as it was.
pub(crate) fn left_as_given(work: &Work, missing: &[f64], view: View) -> Vec<Vec<Vec<f64>>> {
    left_on(&work.design, work.softness, missing, view)
}

/// The same before there is anything but rows.
pub(crate) fn left_on(d: &Design, softness: usize, missing: &[f64], view: View) -> Vec<Vec<Vec<f64>>> {
    (0..d.n_joints)
        .map(|j| {
            (0..d.rows.len())
                .map(|s| {
                    d.measured_rows(j, s, view)
                        .iter()
                        .zip(d.as_given_rows(softness, j, s, view))
                        .map(|(y, m)| y - m / (1.0 - missing.get(j).copied().unwrap_or(0.0)))
                        .collect()
                })
                .collect()
        })
        .collect()
}

/// Noise of the recording in the band, as a share of effort: from second differences of what is left, which a smooth mismatch survives
/// badly and white noise fully.
pub(crate) fn noise_floor(work: &Work, left: &[Vec<Vec<f64>>]) -> f64 {
    let mut out = Vec::new();
    for (j, error) in errors(work, left).iter().enumerate() {
        out.push(JointError { effort: error.effort, error: math::sqrt(white_power(&work.design.rows, &left[j])).min(error.error) });
    }
    pooled(&out)
}

/// Mean square of the part of a series that looks white, from second differences: [segment][row]. Rows in gaps hold what was put there in
/// place of samples, which is smooth and would make the noise small.
pub(crate) fn white_power(rows: &[Rows], x: &[Vec<f64>]) -> f64 {
    white_power_where(rows, x, |rows, i| rows.valid[i])
}

/// The same of rows that count: those of which both neighbours do as well.
pub(crate) fn white_power_where(rows: &[Rows], x: &[Vec<f64>], counts: impl Fn(&Rows, usize) -> bool) -> f64 {
    let (mut sum, mut n) = (0.0, 0_usize);
    for (rows, x) in rows.iter().zip(x) {
        for i in (1..x.len().saturating_sub(1)).filter(|&i| (i - 1..i + 2).all(|i| counts(rows, i))) {
            let d = x[i - 1] - 2.0 * x[i] + x[i + 1];
            sum += d * d / 6.0;
            n += 1;
        }
    }
    sum / n.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jackknife_of_a_mean_is_its_standard_error() {
        // For the mean of n values the jackknife variance equals the textbook one, s²/n.
        let x = [1.0, 2.5, 0.5, 3.0, 1.5];
        let total: f64 = x.iter().sum();
        let replicates: Vec<f64> = x.iter().map(|v| (total - v) / 4.0).collect();
        let mean = total / 5.0;
        let s2 = x.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / 4.0;
        let want = 2.776 * math::sqrt(s2 / 5.0);
        assert!((jackknife_half_width(&replicates) - want).abs() < 1e-12);
    }
}
