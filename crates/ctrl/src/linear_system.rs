//! Square systems of as many unknowns as there are drives, on the stack.

/// Solves `m·x = b` for the leading `n` unknowns by Gaussian elimination with partial pivoting; whether `m` had a usable pivot throughout.
///
/// `b` becomes `x`; entries beyond `n` stay as they are.
#[must_use]
pub(crate) fn solve<const N: usize>(mut m: [[f64; N]; N], n: usize, b: &mut [f64; N]) -> bool {
    for column in 0..n {
        let pivot = (column..n).fold(column, |best, row| if m[row][column].abs() > m[best][column].abs() { row } else { best });
        m.swap(column, pivot);
        b.swap(column, pivot);
        let top = m[column];
        if top[column].is_nan() || top[column].abs() <= f64::MIN_POSITIVE {
            return false;
        }
        for row in column + 1..n {
            let factor = m[row][column] / top[column];
            for (below, above) in m[row][column..n].iter_mut().zip(&top[column..n]) {
                *below -= factor * above;
            }
            b[row] -= factor * b[column];
        }
    }
    for row in (0..n).rev() {
        let sum = (row + 1..n).fold(b[row], |sum, k| sum - m[row][k] * b[k]);
        b[row] = sum / m[row][row];
    }
    b[..n].iter().all(|x| x.is_finite())
}

/// The inverse of `m`, where it has one.
#[must_use]
pub(crate) fn inverse<const N: usize>(m: &[[f64; N]; N]) -> Option<[[f64; N]; N]> {
    let mut out = [[0.0; N]; N];
    for column in 0..N {
        let mut unit = [0.0; N];
        unit[column] = 1.0;
        if !solve(*m, N, &mut unit) {
            return None;
        }
        for (row, value) in unit.into_iter().enumerate() {
            out[row][column] = value;
        }
    }
    Some(out)
}

/// `m·x`.
#[must_use]
pub(crate) fn product<const N: usize>(m: &[[f64; N]; N], x: &[f64; N]) -> [f64; N] {
    core::array::from_fn(|row| m[row].iter().zip(x).map(|(m, x)| m * x).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_system_that_needs_its_rows_exchanged_is_solved() {
        let m = [[0.0, 2.0, 1.0], [4.0, 1.0, -1.0], [1.0, 0.5, 3.0]];
        let x = [0.3, -1.2, 0.7];
        let mut b = product(&m, &x);
        assert!(solve(m, 3, &mut b));
        for k in 0..3 {
            assert!((b[k] - x[k]).abs() < 1e-14, "{b:?}");
        }
        let round = product(&m, &product(&inverse(&m).expect("it has one"), &x));
        assert!(round.iter().zip(x).all(|(got, want)| (got - want).abs() < 1e-14), "{round:?}");
    }

    #[test]
    fn a_singular_matrix_and_one_that_holds_no_number_are_noticed() {
        assert!(!solve([[1.0, 2.0], [2.0, 4.0]], 2, &mut [1.0, 1.0]));
        assert!(!solve([[f64::NAN, 2.0], [2.0, 4.0]], 2, &mut [1.0, 1.0]));
        assert!(inverse(&[[0.0]]).is_none());
    }
}
