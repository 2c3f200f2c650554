//! Pole placement: one input by Ackermann's formula, several by well-conditioned eigenvectors.

use alloc::vec::Vec;

use nalgebra::{Complex, DMatrix, DVector};

use super::error::{DesignError, must_be};
use super::margin::eigenvalues;
use super::mu::CMatrix;

/// A state feedback `u = −K·x` and what it achieves.
#[derive(Debug, Clone, PartialEq)]
pub struct Placement {
    /// K, inputs × states.
    pub gain: DMatrix<f64>,
    /// Eigenvalues of `A − B·K` as computed.
    pub poles: Vec<Complex<f64>>,
    /// Largest distance of a wanted pole from its own among them. Of a pole that is wanted k times, rounding is seen to the k-th root.
    pub error: f64,
}

type C64 = Complex<f64>;

/// Sweeps over all eigenvectors; each makes one as orthogonal to the others as its space allows.
const SWEEPS: usize = 30;

/// Share of the largest wanted pole to which `A − B·K` must meet the poles.
const WRONG: f64 = 1e-3;

/// K such that `A − B·K` has the eigenvalues `poles`, each as often as it is listed.
///
/// With several inputs the freedom that is left makes the eigenvectors as orthogonal as a sweep over them finds \[Kautsky1985, method 0\],
/// so that the poles move little when A and B are a little different; a pole may then be listed as often as there are inputs.
///
/// # Errors
/// Dimensions that do not fit, no states or no inputs, poles without their conjugates, modes out of reach.
pub fn place(A: &DMatrix<f64>, B: &DMatrix<f64>, poles: &[C64]) -> Result<Placement, DesignError> {
    let (n, m) = (A.nrows(), B.ncols());
    must_be("A", A, n, n)?;
    must_be("B", B, n, m)?;
    for (what, count) in [("states", n), ("inputs", m)] {
        if count == 0 {
            return Err(DesignError::Value { what, value: 0.0, limit: "must be at least one" });
        }
    }
    let poles = in_pairs(poles, n)?;
    let gain = if m == 1 { ackermann(A, B, &poles)? } else { by_eigenvectors(A, B, &poles)? };
    let found = eigenvalues(&(A - B * &gain));
    let error = farthest(&poles, found.clone());
    // The size of A says nothing of poles: positions in micrometres would make every answer right. It does where all are to be zero.
    let largest = poles.iter().map(|p| modulus(*p)).fold(0.0, f64::max);
    let scale = if largest > 0.0 { largest } else { A.norm().max(f64::MIN_POSITIVE) };
    if gain.iter().all(|k| k.is_finite()) && error < WRONG * scale {
        return Ok(Placement { gain, poles: found, error });
    }
    Err(DesignError::NoSolution { what: "pole placement", residual: error / scale })
}

/// Largest distance when every wanted pole takes one of those found, the nearest pairs first; infinite when there are not enough.
fn farthest(wanted: &[C64], mut found: Vec<C64>) -> f64 {
    let (mut left, mut worst) = (wanted.to_vec(), 0.0_f64);
    while !left.is_empty() {
        let pairs = (0..left.len()).flat_map(|i| (0..found.len()).map(move |k| (i, k)));
        let nearest = pairs.map(|(i, k)| (modulus(left[i] - found[k]), i, k)).min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((distance, i, k)) = nearest else { return f64::INFINITY };
        left.swap_remove(i);
        found.swap_remove(k);
        worst = worst.max(distance);
    }
    worst
}

fn modulus(z: C64) -> f64 {
    pkm_dyn::math::hypot(z.re, z.im)
}

/// Real poles first, then complex ones, each with a positive imaginary part followed by its conjugate.
fn in_pairs(poles: &[C64], states: usize) -> Result<Vec<C64>, DesignError> {
    let is_real = |p: &&C64| p.im.abs() <= 1e-12 * modulus(**p);
    let mut out: Vec<C64> = poles.iter().filter(is_real).map(|p| Complex::new(p.re, 0.0)).collect();
    let mut below: Vec<C64> = poles.iter().filter(|p| !is_real(p) && p.im < 0.0).copied().collect();
    for p in poles.iter().filter(|p| !is_real(p) && p.im > 0.0) {
        let partner = below.iter().position(|b| modulus(b.conj() - p) <= 1e-9 * modulus(*p));
        if let Some(partner) = partner {
            below.swap_remove(partner);
            out.extend([*p, p.conj()]);
        }
    }
    let is_finite = out.iter().all(|p| p.re.is_finite() && p.im.is_finite());
    if out.len() == states && poles.len() == states && is_finite { Ok(out) } else { Err(DesignError::Poles { found: out.len(), states }) }
}

/// `K = eₙᵀ·C⁻¹·p(A)` with C the controllability matrix and p the wanted characteristic polynomial.
fn ackermann(A: &DMatrix<f64>, B: &DMatrix<f64>, poles: &[C64]) -> Result<DMatrix<f64>, DesignError> {
    let n = A.nrows();
    let mut controllability = DMatrix::zeros(n, n);
    let mut column = B.column(0).into_owned();
    for k in 0..n {
        controllability.set_column(k, &column);
        column = A * column;
    }
    let mut last = DVector::zeros(n);
    if n > 0 {
        last[n - 1] = 1.0;
    }
    let out_of_reach = DesignError::Singular { what: "the controllability matrix" };
    let mut row = controllability.transpose().lu().solve(&last).ok_or(out_of_reach)?.transpose();
    // p(A) factor by factor; the two factors of a pair make one real quadratic.
    let mut rest = poles;
    while let [p, tail @ ..] = rest {
        if p.im > 0.0 {
            let once = &row * A;
            row = &once * A - once * (2.0 * p.re) + &row * (p.re * p.re + p.im * p.im);
            rest = tail.get(1..).unwrap_or_default();
        } else {
            row = &row * A - &row * p.re;
            rest = tail;
        }
    }
    Ok(DMatrix::from_row_slice(1, n, row.as_slice()))
}

/// Orthonormal basis of what A can map a vector to, up to what B can add: the eigenvectors that a pole may have.
fn space_of(A: &DMatrix<f64>, away: &DMatrix<f64>, pole: C64) -> Option<CMatrix> {
    let n = A.nrows();
    let mut shifted = A.map(|a| Complex::new(a, 0.0));
    (0..n).for_each(|i| shifted[(i, i)] -= pole);
    let rows = away.map(|a| Complex::new(a, 0.0)).transpose() * shifted;
    // The smallest right singular vectors; zero rows make the decomposition a full one.
    let mut square = CMatrix::zeros(n, n);
    square.view_mut((0, 0), rows.shape()).copy_from(&rows);
    let svd = square.svd(false, true);
    let V = svd.v_t?;
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| svd.singular_values[a].total_cmp(&svd.singular_values[b]));
    let width = n - rows.nrows();
    Some(CMatrix::from_fn(n, width, |i, j| V[(order[j], i)].conj()))
}

fn by_eigenvectors(A: &DMatrix<f64>, B: &DMatrix<f64>, poles: &[C64]) -> Result<DMatrix<f64>, DesignError> {
    let n = A.nrows();
    let failed = || DesignError::Singular { what: "B, or a decomposition of it," };
    let svd = B.clone().svd(true, true);
    let rank = svd.rank(1e-12 * svd.singular_values.max());
    let U = svd.u.as_ref().ok_or_else(failed)?;
    let mut order: Vec<usize> = (0..svd.singular_values.len()).collect();
    order.sort_by(|&a, &b| svd.singular_values[b].total_cmp(&svd.singular_values[a]));
    let range = DMatrix::from_fn(n, rank, |i, j| U[(i, order[j])]);
    let away = complement(&range);
    let spaces: Vec<CMatrix> = poles.iter().map(|p| space_of(A, &away, *p)).collect::<Option<_>>().ok_or_else(failed)?;
    // Start: of each space the direction that the others have least of, in turn; unit columns in any case.
    let mut X = CMatrix::from_fn(n, n, |i, j| {
        let S = &spaces[j];
        (0..S.ncols()).map(|k| S[(i, k)] * Complex::new(1.0 + ((j * 7 + k * 3) % 5) as f64, 0.0)).sum()
    });
    for (j, p) in poles.iter().enumerate() {
        if p.im < 0.0 {
            let partner = X.column(j - 1).map(|x| x.conj());
            X.set_column(j, &partner);
        }
    }
    let mut best = (f64::INFINITY, X.clone());
    for _ in 0..SWEEPS {
        for j in 0..n {
            if poles[j].im < 0.0 {
                continue;
            }
            let direction = improved(&X, j, &spaces[j]);
            X.set_column(j, &direction);
            if poles[j].im > 0.0 {
                X.set_column(j + 1, &direction.map(|x| x.conj()));
            }
        }
        let condition = X.clone().try_inverse().map_or(f64::INFINITY, |inverse| inverse.norm() * X.norm());
        if condition < best.0 {
            best = (condition, X.clone());
        }
    }
    let X = best.1;
    let Xi = X.clone().try_inverse().ok_or(DesignError::NoSolution { what: "pole placement", residual: 1.0 })?;
    let L = CMatrix::from_diagonal(&DVector::from_column_slice(poles));
    let closed = (X * L * Xi).map(|z| z.re);
    let pinv = B.clone().pseudo_inverse(1e-12 * B.norm()).map_err(|_| failed())?;
    Ok(pinv * (A - closed))
}

/// Orthonormal basis of what is orthogonal to the columns of `range`.
fn complement(range: &DMatrix<f64>) -> DMatrix<f64> {
    let (n, r) = range.shape();
    let eigen = (DMatrix::identity(n, n) - range * range.transpose()).symmetric_eigen();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    DMatrix::from_fn(n, n - r, |i, j| eigen.eigenvectors[(i, order[j])])
}

/// The unit vector of the space `S` that is most orthogonal to all columns of `X` but the `j`-th.
fn improved(X: &CMatrix, j: usize, S: &CMatrix) -> DVector<C64> {
    let n = X.nrows();
    let others = CMatrix::from_fn(n, n - 1, |i, k| X[(i, if k < j { k } else { k + 1 })]);
    // What is orthogonal to n − 1 vectors: the last column of their full Q.
    let mut square = CMatrix::zeros(n, n);
    square.view_mut((0, 0), (n, n - 1)).copy_from(&others);
    let normal = square.svd(true, false).u.map(|U| U.column(n - 1).into_owned());
    let normal = normal.unwrap_or_else(|| X.column(j).into_owned());
    let along = S * (S.adjoint() * normal);
    let length = along.norm();
    if length > 1e-9 { along / Complex::new(length, 0.0) } else { X.column(j) / Complex::new(X.column(j).norm().max(1e-300), 0.0) }
}
