//! Linear-quadratic regulators, sampled and continuous, by the structure-preserving doubling algorithm.

use nalgebra::DMatrix;

use super::error::{DesignError, inverse, must_be};
use super::margin::{spectral_abscissa, spectral_radius};

/// The answer of a linear-quadratic problem.
#[derive(Debug, Clone, PartialEq)]
pub struct Regulator {
    /// K of `u = −K·x`.
    pub gain: DMatrix<f64>,
    /// X of the cost to go `xᵀ·X·x`.
    pub cost: DMatrix<f64>,
    /// Norm of what the Riccati equation leaves, relative to its terms.
    pub residual: f64,
}

/// Doublings; convergence is quadratic, and each is worth twice the time span of the last.
const DOUBLINGS: usize = 60;

/// Relative residual above which an answer is none.
const WRONG: f64 = 1e-7;

/// `B·R⁻¹·Bᵀ` of a problem whose matrices fit.
fn problem([A, B, Q, R]: [&DMatrix<f64>; 4]) -> Result<DMatrix<f64>, DesignError> {
    let (n, m) = (A.nrows(), B.ncols());
    for (what, X, rows, cols) in [("A", A, n, n), ("B", B, n, m), ("Q", Q, n, n), ("R", R, m, m)] {
        must_be(what, X, rows, cols)?;
    }
    for (what, X) in [("Q", Q), ("R", R)] {
        let skew = (X - X.transpose()).norm();
        if skew > 1e-12 * X.norm() {
            return Err(DesignError::Value { what, value: skew, limit: "must be symmetric" });
        }
    }
    let factor = R.clone().cholesky().ok_or(DesignError::Singular { what: "R, or it is not positive definite: it" })?;
    Ok(B * factor.solve(&B.transpose()))
}

/// The stabilising solution of `X = Aᵀ·X·(I + G·X)⁻¹·A + H` \[Chu2004\].
fn doubling(mut A: DMatrix<f64>, mut G: DMatrix<f64>, mut H: DMatrix<f64>) -> Result<DMatrix<f64>, DesignError> {
    let I = DMatrix::identity(A.nrows(), A.nrows());
    for _ in 0..DOUBLINGS {
        let W = inverse("I + G·H", &(&I + &G * &H))?;
        let AW = &A * &W;
        let more = A.transpose() * &H * W * &A;
        G += &AW * &G * A.transpose();
        A = &AW * &A;
        let is_done = more.norm() <= 1e-16 * H.norm();
        H += more;
        // Rounding makes both drift from symmetry, which the iteration would amplify.
        G = (&G + G.transpose()) * 0.5;
        H = (&H + H.transpose()) * 0.5;
        if is_done || !H.iter().all(|h| h.is_finite()) {
            break;
        }
    }
    Ok(H)
}

/// The gain that minimises `Σ xᵀ·Q·x + uᵀ·R·u` along `x⁺ = A·x + B·u`.
///
/// # Errors
/// Dimensions that do not fit, an R that is not positive definite, modes that are unstable and out of reach.
pub fn discrete_regulator(system: [&DMatrix<f64>; 4]) -> Result<Regulator, DesignError> {
    let [A, B, Q, R] = system;
    let G = problem(system)?;
    let X = doubling(A.clone(), G, Q.clone())?;
    let S = R + B.transpose() * &X * B;
    let gain = S.lu().solve(&(B.transpose() * &X * A)).ok_or(DesignError::Singular { what: "R + B'XB" })?;
    let left = A.transpose() * &X * (A - B * &gain) - &X + Q;
    let residual = left.norm() / (X.norm() + Q.norm()).max(f64::MIN_POSITIVE);
    let what = "discrete linear-quadratic regulator";
    if residual < WRONG && spectral_radius(&(A - B * &gain)) < 1.0 {
        return Ok(Regulator { gain, cost: X, residual });
    }
    Err(DesignError::NoSolution { what, residual })
}

/// The Cayley transform of a continuous problem: the stable half plane becomes the unit circle.
fn cayley([A, G, Q]: [&DMatrix<f64>; 3], gamma: f64) -> Result<[DMatrix<f64>; 3], DesignError> {
    let one = DMatrix::identity(A.nrows(), A.nrows());
    let shifted = A - &one * gamma;
    let Ai = inverse("A - γ·I", &shifted)?;
    let W = inverse("the Cayley transform", &(shifted.transpose() + Q * &Ai * G))?;
    Ok([one + W.transpose() * (2.0 * gamma), &Ai * G * &W * (2.0 * gamma), &W * Q * &Ai * (2.0 * gamma)])
}

/// The gain that minimises `∫ xᵀ·Q·x + uᵀ·R·u dt` along `x' = A·x + B·u`.
///
/// # Errors
/// Dimensions that do not fit, an R that is not positive definite, modes that are unstable and out of reach.
pub fn continuous_regulator(system: [&DMatrix<f64>; 4]) -> Result<Regulator, DesignError> {
    let [A, B, Q, R] = system;
    let G = problem(system)?;
    // The scale of the transform should be that of the poles, and beyond them: at a pole there is none.
    let gamma = 1.5 * A.norm().max(pkm_dyn::math::sqrt(G.norm() * Q.norm())).max(1.0);
    let [A0, G0, H0] = cayley([A, &G, Q], gamma).or_else(|_| cayley([A, &G, Q], 2.0 * gamma))?;
    let X = doubling(A0, G0, H0)?;
    let gain = R.clone().lu().solve(&(B.transpose() * &X)).ok_or(DesignError::Singular { what: "R" })?;
    let left = A.transpose() * &X + &X * A - &X * &G * &X + Q;
    let residual = left.norm() / (2.0 * A.norm() * X.norm() + Q.norm()).max(f64::MIN_POSITIVE);
    let what = "continuous linear-quadratic regulator";
    if residual < WRONG && spectral_abscissa(&(A - B * &gain)) < 0.0 {
        return Ok(Regulator { gain, cost: X, residual });
    }
    Err(DesignError::NoSolution { what, residual })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(x: f64) -> DMatrix<f64> {
        DMatrix::from_element(1, 1, x)
    }

    #[test]
    fn first_order_systems_have_their_closed_forms() {
        // x = (b + sqrt(b² + 4qr))/2 for a = 1, unit b: x² = x + 1 with q = r = 1.
        let golden = 0.5 * (1.0 + pkm_dyn::math::sqrt(5.0));
        let found = discrete_regulator([&one(1.0), &one(1.0), &one(1.0), &one(1.0)]).unwrap();
        assert!((found.cost[(0, 0)] - golden).abs() < 1e-14 && (found.gain[(0, 0)] - (golden - 1.0)).abs() < 1e-14);
        // 2ax − x²b²/r + q = 0 with a = 3, b = 2, q = 5, r = 0.5.
        let found = continuous_regulator([&one(3.0), &one(2.0), &one(5.0), &one(0.5)]).unwrap();
        let x = (3.0 + pkm_dyn::math::sqrt(9.0 + 40.0)) / 8.0;
        assert!((found.cost[(0, 0)] - x).abs() < 1e-13, "{found:?}");
    }

    #[test]
    fn a_scale_that_is_a_pole_is_no_obstacle() {
        // x' = a·x + b·u with |a| at least everything else, a = 1 included: x = (a + sqrt(a² + b²·q/r))·r/b².
        for (a, b, q) in [(1.0, 1.0, 1.0), (1.0, 0.5, 0.5), (4.0, 2.0, 4.0), (7.5, 1.0, 1.0)] {
            let found = continuous_regulator([&one(a), &one(b), &one(q), &one(1.0)]).expect("within reach");
            let x = (a + pkm_dyn::math::sqrt(a * a + b * b * q)) / (b * b);
            assert!((found.cost[(0, 0)] / x - 1.0).abs() < 1e-12, "{a}: {found:?} {x}");
        }
    }

    #[test]
    fn what_cannot_be_stabilised_is_refused() {
        let A = DMatrix::from_row_slice(2, 2, &[2.0, 0.0, 0.0, 0.5]);
        let B = DMatrix::from_row_slice(2, 1, &[0.0, 1.0]);
        let (Q, R) = (DMatrix::identity(2, 2), one(1.0));
        assert!(discrete_regulator([&A, &B, &Q, &R]).is_err());
        assert!(continuous_regulator([&A, &B, &Q, &R]).is_err());
        assert!(discrete_regulator([&A, &B, &Q, &one(-1.0)]).is_err());
        assert!(discrete_regulator([&A, &B, &one(1.0), &R]).is_err());
    }
}
