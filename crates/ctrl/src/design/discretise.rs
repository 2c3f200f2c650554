//! From continuous to sampled time: matrix exponential, zero-order hold, Tustin's rule.

use alloc::vec;
use alloc::vec::Vec;

use nalgebra::DMatrix;

use super::error::{DesignError, inverse, must_be, must_be_positive};
use super::mu::StateSpace;

/// What the inputs do between two samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hold {
    /// They are constant: exact at the samples.
    ZeroOrder,
    /// Trapezoidal integration, z = (1 + s·dt/2)/(1 − s·dt/2): keeps stability and the number of inputs, warps frequencies.
    Tustin,
}

/// Coefficients of the Padé approximant of order 13 \[Higham2005, eq. 2.3\].
const PADE: [f64; 14] = [
    64_764_752_532_480_000.0,
    32_382_376_266_240_000.0,
    7_771_770_303_897_600.0,
    1_187_353_796_428_800.0,
    129_060_195_264_000.0,
    10_559_470_521_600.0,
    670_442_572_800.0,
    33_522_128_640.0,
    1_323_241_920.0,
    40_840_800.0,
    960_960.0,
    16_380.0,
    182.0,
    1.0,
];

/// Largest 1-norm for which that approximant is exact to rounding \[Higham2005, table 2.3\].
const THETA: f64 = 5.371_920_351_148_152;

fn one_norm(A: &DMatrix<f64>) -> f64 {
    A.column_iter().map(|c| c.iter().map(|x| x.abs()).sum::<f64>()).fold(0.0, f64::max)
}

/// Passes over all rows; each at least halves a row that is much larger than its column, or the other way round.
const BALANCING: usize = 100;

/// `S⁻¹·A·S` with rows and columns alike in size, and the powers of two in the diagonal of S \[Parlett1969\]: positions beside velocities of
/// stiff parts would otherwise ask for so many squarings that rounding takes half of the digits.
pub(crate) fn balanced(A: &DMatrix<f64>) -> (DMatrix<f64>, Vec<f64>) {
    let n = A.nrows();
    let (mut A, mut scale) = (A.clone(), vec![1.0_f64; n]);
    for _ in 0..BALANCING {
        let mut is_done = true;
        for i in 0..n {
            let size = |along: &dyn Fn(usize) -> f64| (0..n).filter(|&j| j != i).map(|j| along(j).abs()).sum::<f64>();
            let (mut column, row) = (size(&|j| A[(j, i)]), size(&|j| A[(i, j)]));
            if column <= 0.0 || row <= 0.0 {
                continue;
            }
            let (before, mut share) = (column + row, 1.0_f64);
            while column < 0.5 * row {
                (share, column) = (share * 2.0, column * 4.0);
            }
            while column >= 2.0 * row {
                (share, column) = (share * 0.5, column * 0.25);
            }
            if (column + row) / share < 0.95 * before {
                is_done = false;
                scale[i] *= share;
                A.row_mut(i).iter_mut().for_each(|a| *a /= share);
                A.column_mut(i).iter_mut().for_each(|a| *a *= share);
            }
        }
        if is_done {
            break;
        }
    }
    (A, scale)
}

/// `exp(A)` of a square matrix by scaling and squaring \[Higham2005\].
///
/// # Errors
/// A matrix that is not square or not finite, or whose exponential is not.
pub fn exponential(A: &DMatrix<f64>) -> Result<DMatrix<f64>, DesignError> {
    let n = A.nrows();
    must_be("A", A, n, n)?;
    let (mut A, scale) = balanced(A);
    let mut halvings = 0_u32;
    while one_norm(&A) > THETA {
        A *= 0.5;
        halvings += 1;
    }
    let I = DMatrix::identity(n, n);
    let A2 = &A * &A;
    let A4 = &A2 * &A2;
    let A6 = &A2 * &A4;
    let b = PADE;
    let odd = &A6 * (&A6 * b[13] + &A4 * b[11] + &A2 * b[9]) + &A6 * b[7] + &A4 * b[5] + &A2 * b[3] + &I * b[1];
    let even = &A6 * (&A6 * b[12] + &A4 * b[10] + &A2 * b[8]) + &A6 * b[6] + &A4 * b[4] + &A2 * b[2] + &I * b[0];
    let U = A * odd;
    let mut E = (&even - &U).lu().solve(&(even + U)).ok_or(DesignError::Singular { what: "the Padé denominator" })?;
    for _ in 0..halvings {
        E = &E * &E;
    }
    for i in 0..n {
        for j in 0..n {
            E[(i, j)] *= scale[i] / scale[j];
        }
    }
    must_be("exp(A)", &E, n, n)?;
    Ok(E)
}

/// `x(t + dt) = Ad·x + Bd·u` with `u` constant meanwhile: Ad, Bd of `x' = A·x + B·u`; `dt` `[s]`.
///
/// # Errors
/// Dimensions that do not fit, numbers that are none.
pub fn zero_order_hold(A: &DMatrix<f64>, B: &DMatrix<f64>, dt: f64) -> Result<[DMatrix<f64>; 2], DesignError> {
    let (n, m) = (A.nrows(), B.ncols());
    must_be("A", A, n, n)?;
    must_be("B", B, n, m)?;
    must_be_positive("sample time [s]", dt)?;
    let mut both = DMatrix::zeros(n + m, n + m);
    both.view_mut((0, 0), (n, n)).copy_from(A);
    both.view_mut((0, n), (n, m)).copy_from(B);
    let E = exponential(&(both * dt))?;
    Ok([E.view((0, 0), (n, n)).into_owned(), E.view((0, n), (n, m)).into_owned()])
}

/// The sampled system of a continuous one; `dt` `[s]`.
///
/// # Errors
/// A system that is already sampled, a sample time that is none, a pole at `2/dt` under Tustin's rule.
pub fn discretise(system: &StateSpace, dt: f64, hold: Hold) -> Result<StateSpace, DesignError> {
    if let Some(value) = system.dt() {
        return Err(DesignError::Value { what: "sample time of the system [s]", value, limit: "must be continuous" });
    }
    must_be_positive("sample time [s]", dt)?;
    let [A, B, C, D] = system.matrices();
    let parts = match hold {
        Hold::ZeroOrder => {
            let [Ad, Bd] = zero_order_hold(A, B, dt)?;
            [Ad, Bd, C.clone(), D.clone()]
        }
        Hold::Tustin => {
            let I = DMatrix::identity(A.nrows(), A.nrows());
            let left = inverse("I - A·dt/2", &(&I - A * (0.5 * dt)))?;
            let Bd = &left * B * dt;
            let Dd = D + C * &Bd * 0.5;
            [&left * (I + A * (0.5 * dt)), Bd, C * left, Dd]
        }
    };
    Ok(StateSpace::try_new(parts, Some(dt))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponentials_that_are_known() {
        let turn = DMatrix::from_row_slice(2, 2, &[0.0, -40.0, 40.0, 0.0]);
        let E = exponential(&turn).unwrap();
        let (s, c) = pkm_dyn::math::sin_cos(40.0);
        assert!((E[(0, 0)] - c).abs() < 1e-12 && (E[(1, 0)] - s).abs() < 1e-12);
        let nilpotent = DMatrix::from_row_slice(3, 3, &[0.0, 1.0, 5.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0]);
        let want = DMatrix::from_row_slice(3, 3, &[1.0, 1.0, 6.0, 0.0, 1.0, 2.0, 0.0, 0.0, 1.0]);
        assert!((exponential(&nilpotent).unwrap() - want).norm() < 1e-14);
        assert!(exponential(&DMatrix::from_element(1, 1, f64::NAN)).is_err());
        assert!(exponential(&DMatrix::from_element(1, 1, 1e3)).is_err(), "it overflows");
        assert!(exponential(&DMatrix::zeros(1, 2)).is_err());
    }

    #[test]
    fn tustins_rule_keeps_the_response_at_the_warped_frequency() {
        use super::super::mu::Response;
        let A = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -9.0, -0.6]);
        let B = DMatrix::from_row_slice(2, 1, &[0.0, 1.0]);
        let C = DMatrix::from_row_slice(1, 2, &[1.0, 0.2]);
        let system = StateSpace::try_new([A, B, C, DMatrix::from_element(1, 1, 0.3)], None).unwrap();
        let sampled = discretise(&system, 0.05, Hold::Tustin).unwrap();
        for w in [0.5, 3.0, 20.0] {
            let warped = 2.0 / 0.05 * pkm_dyn::math::tan(w * 0.05 / 2.0);
            assert!((sampled.at(w).unwrap() - system.at(warped).unwrap()).norm() < 1e-12);
        }
        assert!(discretise(&sampled, 0.05, Hold::ZeroOrder).is_err());
        assert!(discretise(&system, -1.0, Hold::ZeroOrder).is_err());
    }
}
