//! Instrumental variables: estimates that noise in the columns does not pull towards zero.
//!
//! Columns are made from measured positions, so their noise is correlated with that of the equation: least squares is then biased however
//! long the recording. Columns along the motion that a simulation foretells have none of that noise; with them as instruments `Z` the
//! estimate is `(ZᵀW)⁻¹·Zᵀz` \[Janot2014\]. Whether it was needed is what the revised test of Durbin, Wu and Hausman tells \[Janot2016\]:
//! what the instruments leave of the columns, `V = W − Z·Π`, is put beside the columns, and must not explain anything more.

use faer::Mat;
use faer::linalg::solvers::{Solve, SolveLstsq};

use crate::distributions::f_tail;
use crate::error::InputError;
use crate::observation::{Observation, Rows};

/// A column of `V` shorter than this share of its column of `W`, or dependent on the others to this share, says nothing.
const NOTHING_LEFT: f64 = 1e-7;

/// Share of the tests that call columns exogenous wrongly noisy.
pub const LEVEL: f64 = 0.05;

/// Instruments that explain less than this share of a column are weak.
pub const WEAK: f64 = 0.5;

/// Columns, instruments and targets of all rows of all drives, over the drives' noise.
#[derive(Debug, Clone)]
pub struct Stacked {
    /// Columns; rows × kept.
    pub w: Mat<f64>,
    /// Instruments; rows × kept.
    pub z: Mat<f64>,
    /// Targets less the effort of the fixed parameters.
    pub target: Mat<f64>,
    /// Drive of each row.
    pub drive: Vec<usize>,
}

/// Whether the columns are free of noise that matters.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Exogeneity {
    /// Smallest share of a column that the instruments explain, about zero.
    pub relevance: f64,
    /// Place among the kept columns of the one they explain least.
    pub weakest: usize,
    /// Independent columns of `V` that were tested.
    pub tested: usize,
    /// Degrees of freedom of what is left, counted down for colour.
    pub freedom: f64,
    /// F statistic of `V` beside the columns, for colour counted down; 0 when nothing was left to test.
    pub f: f64,
    /// How often exogenous columns would give that much or more.
    pub p: f64,
    /// Whether least squares would have been unbiased, as far as these rows can tell.
    pub is_exogenous: bool,
}

/// Rows of the fit with the same rows of the instruments, both over `noise` (infinite: the drive does not take part).
///
/// # Errors
/// Loops that do not close along a motion.
pub fn stacked(
    observation: &Observation<'_>,
    instruments: &Observation<'_>,
    kept: &[usize],
    fixed: &[f64],
    noise: &[f64],
) -> Result<Stacked, InputError> {
    let used: Vec<usize> = (0..noise.len()).filter(|&k| noise[k].is_finite()).collect();
    // Rows of the instruments by recording and time; both lie on the grid of the same stamps.
    let mut said: alloc::collections::BTreeMap<(usize, u64), Vec<Vec<f64>>> = alloc::collections::BTreeMap::new();
    instruments.each(
        Rows::Fitted,
        &mut |block| {
            for i in 0..block.len() {
                let row = |k: &usize| kept.iter().map(|&j| block.row(*k, i)[j] / noise[*k]).collect::<Vec<_>>();
                said.insert((block.recording, block.time[i].to_bits()), used.iter().map(row).collect());
            }
        },
        &mut |_| {},
    )?;
    let (mut w, mut z, mut target, mut drive) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    observation.each(
        Rows::Fitted,
        &mut |block| {
            for i in 0..block.len() {
                let Some(rows) = said.get(&(block.recording, block.time[i].to_bits())) else { continue };
                for (at, &k) in used.iter().enumerate().filter(|(_, k)| block.is_active(**k, i)) {
                    let row = block.row(k, i);
                    w.extend(kept.iter().map(|&j| row[j] / noise[k]));
                    z.extend_from_slice(&rows[at]);
                    target.push((block.target(k, i) - crate::estimate::robust::dot(row, fixed)) / noise[k]);
                    drive.push(k);
                }
            }
        },
        &mut |_| {},
    )?;
    let (n, p) = (target.len(), kept.len());
    Ok(Stacked {
        w: Mat::from_fn(n, p, |i, j| w[i * p + j]),
        z: Mat::from_fn(n, p, |i, j| z[i * p + j]),
        target: Mat::from_fn(n, 1, |i, _| target[i]),
        drive,
    })
}

fn least_squares(a: &Mat<f64>, b: &Mat<f64>) -> Mat<f64> {
    a.qr().solve_lstsq(b).subrows(0, a.ncols()).to_owned()
}

fn lengths(m: &Mat<f64>) -> Vec<f64> {
    (0..m.ncols()).map(|j| m.col(j).norm_l2().max(f64::MIN_POSITIVE)).collect()
}

fn divided(m: &Mat<f64>, lengths: &[f64]) -> Mat<f64> {
    Mat::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] / lengths[j])
}

/// `(ZᵀW)⁻¹·Zᵀz`: one value per kept column; `None` when the instruments do not determine them.
#[must_use]
pub fn instrumental(rows: &Stacked) -> Option<Vec<f64>> {
    let (lw, lz) = (lengths(&rows.w), lengths(&rows.z));
    let (w, z) = (divided(&rows.w, &lw), divided(&rows.z, &lz));
    if w.nrows() <= w.ncols() {
        return None;
    }
    let x = (z.transpose() * &w).full_piv_lu().solve(z.transpose() * &rows.target);
    let out: Vec<f64> = lw.iter().enumerate().map(|(j, l)| x[(j, 0)] / l).collect();
    out.iter().all(|x| x.is_finite()).then_some(out)
}

/// The revised test of Durbin, Wu and Hausman. `colour` is the variance of a sum of residuals over that of as many white ones, 1 or more:
/// coloured rows are fewer than they seem.
#[must_use]
pub fn exogeneity(rows: &Stacked, colour: f64) -> Exogeneity {
    let p = rows.w.ncols();
    let (lw, lz) = (lengths(&rows.w), lengths(&rows.z));
    let (w, z) = (divided(&rows.w, &lw), divided(&rows.z, &lz));
    let v = &w - &z * least_squares(&z, &w);
    let explained: Vec<f64> = (0..p).map(|j| 1.0 - v.col(j).squared_norm_l2()).map(|x| if x.is_finite() { x } else { 0.0 }).collect();
    let weakest = (0..p).min_by(|&a, &b| explained[a].total_cmp(&explained[b])).unwrap_or(0);
    // Columns of the augmented matrix that are independent: those of W first, then what pivots leave of V.
    let rest = &v - &w * least_squares(&w, &v);
    let pivoted = rest.col_piv_qr();
    let r = pivoted.R();
    let tested = (0..p.min(r.nrows())).take_while(|&i| r[(i, i)].abs() > NOTHING_LEFT).count();
    let order = pivoted.P().arrays().0.to_vec();
    let e = &rows.target - &w * least_squares(&w, &rows.target);
    let n = rows.target.nrows() as f64;
    let freedom = n / colour.max(1.0) - (p + tested) as f64;
    let mut out = Exogeneity {
        relevance: explained.get(weakest).copied().unwrap_or(0.0),
        weakest,
        tested,
        freedom,
        f: 0.0,
        p: 1.0,
        is_exogenous: true,
    };
    if tested == 0 || freedom < 1.0 {
        return out;
    }
    let chosen = Mat::from_fn(rest.nrows(), tested, |i, j| rest[(i, order[j])]);
    // The rest is at right angles to W: what it explains of the residual adds up.
    let left = &e - &chosen * least_squares(&chosen, &e);
    let gained = e.squared_norm_l2() - left.squared_norm_l2();
    let m = tested as f64;
    let variance = left.squared_norm_l2() / (n - p as f64 - m).max(1.0);
    out.f = gained / m / variance.max(f64::MIN_POSITIVE) / colour.max(1.0);
    out.p = f_tail(out.f, m, freedom);
    out.is_exogenous = out.p > LEVEL;
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows `z = 2·x1 − 3·x2 + e` with the columns measured with noise of standard deviation `spoil`; instruments are the true columns.
    fn rows(spoil: f64, seed: u64) -> Stacked {
        let mut state = seed;
        let mut normal = || {
            let mut unit = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1_u64 << 53) as f64
            };
            (0..12).map(|_| unit()).sum::<f64>() - 6.0
        };
        let n = 2000;
        let truth = Mat::from_fn(n, 2, |i, j| {
            let t = i as f64 * 0.01;
            if j == 0 { pkm_dyn::math::sin(t) } else { pkm_dyn::math::cos(1.7 * t) }
        });
        let target = Mat::from_fn(n, 1, |i, _| 2.0 * truth[(i, 0)] - 3.0 * truth[(i, 1)] + 0.05 * normal());
        let w = Mat::from_fn(n, 2, |i, j| truth[(i, j)] + spoil * normal());
        Stacked { w, z: truth, target, drive: vec![0; n] }
    }

    fn ordinary(r: &Stacked) -> Vec<f64> {
        let x = r.w.qr().solve_lstsq(&r.target);
        vec![x[(0, 0)], x[(1, 0)]]
    }

    #[test]
    fn noise_in_the_columns_biases_least_squares_and_not_instruments() {
        let r = rows(0.4, 5);
        let (ls, iv) = (ordinary(&r), instrumental(&r).unwrap());
        assert!((ls[0] - 2.0).abs() > 0.3 && (ls[1] + 3.0).abs() > 0.4, "{ls:?}");
        assert!((iv[0] - 2.0).abs() < 0.1 && (iv[1] + 3.0).abs() < 0.1, "{iv:?}");
        let test = exogeneity(&r, 1.0);
        assert!(!test.is_exogenous && test.p < 1e-6 && test.tested == 2 && test.relevance > 0.5, "{test:?}");
    }

    #[test]
    fn clean_columns_are_called_exogenous_nineteen_times_in_twenty() {
        // Noise of the columns that the target does not share: V explains nothing.
        let mut refused = 0;
        for seed in 0..200 {
            let mut r = rows(0.0, 1000 + seed);
            let other = rows(0.3, 7000 + seed);
            // Instruments are now the noisy ones, columns the true ones.
            r.z = other.w;
            refused += u32::from(!exogeneity(&r, 1.0).is_exogenous);
        }
        assert!((2..=22).contains(&refused), "{refused} of 200");
    }

    #[test]
    fn columns_that_are_the_instruments_leave_nothing_to_test() {
        let test = exogeneity(&rows(0.0, 3), 1.0);
        assert!(test.is_exogenous && test.tested == 0 && (test.relevance - 1.0).abs() < 1e-12, "{test:?}");
        let mut unrelated = rows(0.0, 3);
        unrelated.z = Mat::from_fn(2000, 2, |i, j| if (i / (j + 1)) % 2 == 0 { 1.0 } else { -1.0 });
        assert!(exogeneity(&unrelated, 1.0).relevance < WEAK);
    }
}
