//! Small Hermitian matrices: Cholesky factors for the iterations, and a proof of positive definiteness that rounding cannot fake.
//!
//! nalgebra's own Cholesky takes complex square roots and so accepts indefinite matrices; here a pivot must be real and positive.

use alloc::vec;
use alloc::vec::Vec;

use nalgebra::Complex;

use super::CMatrix;

/// Unit roundoff of f64.
const U: f64 = f64::EPSILON / 2.0;

/// Lower factor L with A = L·L*, or nothing when a pivot is not positive. Reads the lower triangle of A.
pub(crate) fn cholesky(A: &CMatrix) -> Option<CMatrix> {
    let n = A.nrows();
    let mut L = CMatrix::zeros(n, n);
    for j in 0..n {
        let mut pivot = A[(j, j)].re;
        for k in 0..j {
            pivot -= L[(j, k)].norm_sqr();
        }
        // Written so that a pivot that is no number is refused as well.
        if !(pivot > 0.0 && pivot.is_finite()) {
            return None;
        }
        let root = pivot.sqrt();
        L[(j, j)] = Complex::new(root, 0.0);
        for i in j + 1..n {
            let mut sum = A[(i, j)];
            for k in 0..j {
                sum -= L[(i, k)] * L[(j, k)].conj();
            }
            L[(i, j)] = sum / root;
        }
    }
    Some(L)
}

/// Natural logarithm of the determinant, from the factor.
pub(crate) fn log_det(L: &CMatrix) -> f64 {
    2.0 * (0..L.nrows()).map(|i| pkm_dyn::math::ln(L[(i, i)].re)).sum::<f64>()
}

/// Inverse of a lower factor.
pub(crate) fn inverse_lower(L: &CMatrix) -> CMatrix {
    let n = L.nrows();
    let mut V = CMatrix::zeros(n, n);
    for j in 0..n {
        V[(j, j)] = Complex::new(1.0 / L[(j, j)].re, 0.0);
        for i in j + 1..n {
            let mut sum = Complex::new(0.0, 0.0);
            for k in j..i {
                sum -= L[(i, k)] * V[(k, j)];
            }
            V[(i, j)] = sum / L[(i, i)].re;
        }
    }
    V
}

/// Whether every Hermitian matrix that differs from `A` entry by entry by at most `radius` (in modulus) is positive definite: a proof.
///
/// The real form [[Re, -Im], [Im, Re]] is scaled by powers of two, which is exact, to a diagonal near one. Its floating-point Cholesky,
/// after a shift by more than its own largest backward error, runs to completion only if the matrix is positive definite
/// [Rump2006, theorem 2.3]; the shift also swallows the radius, through its largest row sum.
pub(crate) fn is_surely_positive(A: &CMatrix, radius: &nalgebra::DMatrix<f64>) -> bool {
    let n = A.nrows();
    if A.iter().any(|c| !(c.re.is_finite() && c.im.is_finite())) || (0..n).any(|i| A[(i, i)].re <= 0.0) {
        return false;
    }
    let s: Vec<f64> = (0..n).map(|i| power_of_two_near(1.0 / A[(i, i)].re.sqrt())).collect();
    let row_sum = |i: usize| (0..n).map(|j| radius[(i, j)] * s[i] * s[j]).sum::<f64>();
    let spread = (0..n).map(row_sum).fold(0.0, f64::max) * (1.0 + 4.0 * n as f64 * U);
    let m = 2 * n;
    let mut R = vec![0.0; m * m];
    for i in 0..n {
        for j in 0..n {
            // The lower triangle decides; it is Hermitian by construction.
            let c = (if i >= j { A[(i, j)] } else { A[(j, i)].conj() }) * (s[i] * s[j]);
            R[i * m + j] = c.re;
            R[(n + i) * m + n + j] = c.re;
            R[(n + i) * m + j] = c.im;
            R[i * m + n + j] = -c.im;
        }
    }
    let trace: f64 = (0..m).map(|i| R[i * m + i]).sum();
    let gamma = (m as f64 + 2.0) * U / (1.0 - (m as f64 + 2.0) * U);
    // Twice gamma/(1 - gamma) of the theorem, and the rounding of the shift itself.
    let shift = (2.0 * gamma * trace + spread) * (1.0 + 8.0 * U) + f64::MIN_POSITIVE * (m * m) as f64;
    for i in 0..m {
        R[i * m + i] = (R[i * m + i] - shift) * (1.0 - 2.0 * U);
    }
    real_cholesky_completes(&mut R, m)
}

fn real_cholesky_completes(R: &mut [f64], m: usize) -> bool {
    for j in 0..m {
        for i in j..m {
            let mut sum = R[i * m + j];
            for k in 0..j {
                sum -= R[i * m + k] * R[j * m + k];
            }
            if i == j {
                if !(sum > 0.0 && sum.is_finite()) {
                    return false;
                }
                R[j * m + j] = sum.sqrt();
            } else {
                R[i * m + j] = sum / R[j * m + j];
            }
        }
    }
    true
}

/// The power of two below `x > 0`, kept to the range in which products of two stay normal numbers.
pub(crate) fn power_of_two_near(x: f64) -> f64 {
    // The exponent field alone: mantissa cleared.
    f64::from_bits(x.clamp(power_of_two(-200), power_of_two(200)).to_bits() & 0xfff0_0000_0000_0000)
}

/// 2^n for -1022 <= n <= 1023.
pub(crate) fn power_of_two(n: i64) -> f64 {
    f64::from_bits((1023 + n).unsigned_abs() << 52)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    fn hermitian(n: usize, shift: f64) -> CMatrix {
        // Not a sine of a sum of the indices alone: that would be of rank two.
        let x = |i: usize, j: usize| pkm_dyn::math::sin((i * 7 + j * 3 + i * i * j * j + 1) as f64);
        let B = CMatrix::from_fn(n, n, |i, j| Complex::new(x(i, j), x(j, i + 5)));
        B.adjoint() * &B + CMatrix::identity(n, n) * Complex::new(shift, 0.0)
    }

    #[test]
    fn the_inverse_inverts() {
        let A = hermitian(5, 0.1);
        let L = cholesky(&A).unwrap();
        assert!((inverse_lower(&L) * &L - CMatrix::identity(5, 5)).norm() < 1e-12);
        assert!((&L * L.adjoint() - &A).norm() < 1e-12);
    }

    #[test]
    fn positive_definiteness_is_proved_up_to_rounding_and_refused_beyond() {
        let A = hermitian(6, 0.0);
        let lowest = A.clone().symmetric_eigenvalues().min();
        let zero = DMatrix::zeros(6, 6);
        let moved = |by: f64| &A - CMatrix::identity(6, 6) * Complex::new(by, 0.0);
        assert!(is_surely_positive(&moved(lowest * (1.0 - 1e-9)), &zero));
        assert!(!is_surely_positive(&moved(lowest * (1.0 + 1e-9)), &zero));
        // A radius as large as the smallest eigenvalue leaves no proof.
        assert!(!is_surely_positive(&A, &DMatrix::from_element(6, 6, lowest)));
        assert!(is_surely_positive(&A, &DMatrix::from_element(6, 6, lowest / 100.0)));
        assert!(!is_surely_positive(&(A * Complex::new(f64::NAN, 0.0)), &zero));
    }

    #[test]
    fn bad_scaling_does_not_spoil_the_proof() {
        let A = hermitian(4, 0.5);
        let s = [1e-9, 1.0, 1e9, 1e3];
        let B = CMatrix::from_fn(4, 4, |i, j| A[(i, j)] * (s[i] * s[j]));
        assert!(is_surely_positive(&B, &DMatrix::zeros(4, 4)));
    }

    #[test]
    fn powers_of_two_are_exact() {
        let got = [1.0, 0.3, 7.9, 1e300].map(|x| power_of_two_near(x).to_bits());
        assert_eq!(got, [1.0, 0.25, 4.0, power_of_two(200)].map(f64::to_bits));
    }
}
