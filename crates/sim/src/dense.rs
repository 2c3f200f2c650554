//! Small dense systems in place, row by row, without allocation: what a step of a plant solves.

use pkm_dyn::math;

/// Lower Cholesky factor of the symmetric `n` × `n` matrix in `m`, in its lower triangle; whether it is positive definite.
pub(crate) fn cholesky(m: &mut [f64], n: usize) -> bool {
    for j in 0..n {
        for i in j..n {
            let sum = (0..j).fold(m[i * n + j], |sum, k| sum - m[i * n + k] * m[j * n + k]);
            if i > j {
                m[i * n + j] = sum / m[j * n + j];
            } else if sum > 0.0 && sum.is_finite() {
                m[j * n + j] = math::sqrt(sum);
            } else {
                return false;
            }
        }
    }
    true
}

/// Solves `L·Lᵀ·x = b` in place with the factor that [`cholesky`] leaves.
pub(crate) fn cholesky_solve(l: &[f64], x: &mut [f64]) {
    let n = x.len();
    for i in 0..n {
        x[i] = (0..i).fold(x[i], |sum, k| sum - l[i * n + k] * x[k]) / l[i * n + i];
    }
    for i in (0..n).rev() {
        x[i] = (i + 1..n).fold(x[i], |sum, k| sum - l[k * n + i] * x[k]) / l[i * n + i];
    }
}

/// Factors the square matrix in `m` with row exchanges, noted in `order`; whether it is regular.
pub(crate) fn lu(m: &mut [f64], order: &mut [usize]) -> bool {
    let n = order.len();
    for k in 0..n {
        let mut best = k;
        for i in k + 1..n {
            if m[i * n + k].abs() > m[best * n + k].abs() {
                best = i;
            }
        }
        order[k] = best;
        if best != k {
            for j in 0..n {
                m.swap(k * n + j, best * n + j);
            }
        }
        let pivot = m[k * n + k];
        if !(pivot.abs() > 0.0 && pivot.is_finite()) {
            return false;
        }
        let (above, below) = m.split_at_mut((k + 1) * n);
        let pivots = &above[k * n..];
        for row in below.chunks_exact_mut(n) {
            if row[k] != 0.0 {
                let factor = row[k] / pivot;
                row[k] = factor;
                for (x, p) in row[k + 1..].iter_mut().zip(&pivots[k + 1..]) {
                    *x -= factor * p;
                }
            }
        }
    }
    true
}

/// Solves with the factors that [`lu`] leaves, in place.
pub(crate) fn lu_solve(m: &[f64], order: &[usize], x: &mut [f64]) {
    let n = order.len();
    for (k, &other) in order.iter().enumerate() {
        x.swap(k, other);
    }
    for i in 0..n {
        x[i] = (0..i).fold(x[i], |sum, j| sum - m[i * n + j] * x[j]);
    }
    for i in (0..n).rev() {
        x[i] = (i + 1..n).fold(x[i], |sum, j| sum - m[i * n + j] * x[j]) / m[i * n + i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(m: &[f64], x: &[f64]) -> Vec<f64> {
        m.chunks_exact(x.len()).map(|row| row.iter().zip(x).map(|(m, x)| m * x).sum()).collect()
    }

    #[test]
    fn both_factorisations_solve_what_they_were_given() {
        let m = [4.0, 1.0, -0.5, 1.0, 3.0, 0.2, -0.5, 0.2, 2.0];
        let x = [0.7, -1.3, 2.1];
        let (mut l, mut got) = (m, [0.0; 3]);
        got.copy_from_slice(&times(&m, &x));
        assert!(cholesky(&mut l, 3));
        cholesky_solve(&l, &mut got);
        assert!(x.iter().zip(&got).all(|(a, b)| (a - b).abs() < 1e-14), "{got:?}");
        // The first pivot is zero: rows must be exchanged.
        let m = [0.0, 2.0, 1.0, 1.0, -1.0, 0.5, 3.0, 0.0, -2.0];
        let (mut factors, mut order) = (m, [0; 3]);
        got.copy_from_slice(&times(&m, &x));
        assert!(lu(&mut factors, &mut order));
        lu_solve(&factors, &order, &mut got);
        assert!(x.iter().zip(&got).all(|(a, b)| (a - b).abs() < 1e-14), "{got:?}");
    }

    #[test]
    fn what_cannot_be_factored_is_told() {
        assert!(!cholesky(&mut [1.0, 2.0, 2.0, 1.0], 2) && !cholesky(&mut [f64::NAN], 1));
        assert!(!lu(&mut [1.0, 2.0, 2.0, 4.0], &mut [0; 2]) && !lu(&mut [f64::NAN], &mut [0]));
    }
}
