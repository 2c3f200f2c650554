//! Discrete Lyapunov equation: the covariance that a stable system settles at, or the energy it still has.

use nalgebra::DMatrix;

use super::error::{DesignError, must_be};
use super::margin::spectral_radius;

/// Doublings: 2⁵⁰ samples are longer than anything that is stable by more than rounding.
const DOUBLINGS: usize = 50;

/// X of `A·X·Aᵀ − X + Q = 0`.
///
/// A stable A is summed by doubling \[Smith1968\]; any other is solved as one system of n² unknowns, which wants no two eigenvalues of
/// product one.
///
/// # Errors
/// Dimensions that do not fit, numbers that are none, an A with eigenvalues of product one.
pub fn discrete_lyapunov(A: &DMatrix<f64>, Q: &DMatrix<f64>) -> Result<DMatrix<f64>, DesignError> {
    let n = A.nrows();
    must_be("A", A, n, n)?;
    must_be("Q", Q, n, n)?;
    let X = if spectral_radius(A) < 1.0 { by_doubling(A, Q) } else { by_elimination(A, Q)? };
    let residual = (A * &X * A.transpose() - &X + Q).norm() / (X.norm() + Q.norm()).max(f64::MIN_POSITIVE);
    if residual < 1e-8 { Ok(X) } else { Err(DesignError::NoSolution { what: "discrete Lyapunov equation", residual }) }
}

/// `Σ Aᵏ·Q·Aᵏᵀ`, twice as many terms in every pass.
fn by_doubling(A: &DMatrix<f64>, Q: &DMatrix<f64>) -> DMatrix<f64> {
    let (mut P, mut X) = (A.clone(), Q.clone());
    for _ in 0..DOUBLINGS {
        let more = &P * &X * P.transpose();
        let is_done = more.norm() <= 1e-17 * X.norm();
        X += more;
        if is_done {
            break;
        }
        P = &P * &P;
    }
    X
}

fn by_elimination(A: &DMatrix<f64>, Q: &DMatrix<f64>) -> Result<DMatrix<f64>, DesignError> {
    let n = A.nrows();
    let big = DMatrix::identity(n * n, n * n) - A.kronecker(A);
    let right = DMatrix::from_column_slice(n * n, 1, Q.as_slice());
    let x = big.lu().solve(&right).ok_or(DesignError::Singular { what: "I - A (x) A" })?;
    Ok(DMatrix::from_column_slice(n, n, x.as_slice()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_first_order_system_settles_at_q_over_one_minus_a_squared() {
        for (a, want) in [(0.9, 2.0 / 0.19), (0.999_999, 2.0 / (1.0 - 0.999_999 * 0.999_999)), (1.5, 2.0 / (1.0 - 2.25))] {
            let one = |x| DMatrix::from_element(1, 1, x);
            let X = discrete_lyapunov(&one(a), &one(2.0)).unwrap();
            assert!((X[(0, 0)] - want).abs() < 1e-9 * want.abs(), "{a}: {X}");
        }
        let one = DMatrix::from_element(1, 1, 1.0);
        assert!(discrete_lyapunov(&one, &one).is_err());
    }
}
