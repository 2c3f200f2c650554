//! Products of matrices and vectors.

use core::ffi::{c_char, c_int};

use faer::{Mat, MatMut, MatRef};

use crate::view::{at, is_transposed, is_upper, read, size, write};

/// Which entries of a symmetric result are written.
#[derive(Clone, Copy)]
enum Part {
    All,
    Upper,
    Lower,
}

impl Part {
    unsafe fn of(flag: *const c_char) -> Self {
        // SAFETY: as the caller's.
        if unsafe { is_upper(flag) } { Self::Upper } else { Self::Lower }
    }

    fn has(self, i: usize, j: usize) -> bool {
        match self {
            Self::All => true,
            Self::Upper => i <= j,
            Self::Lower => i >= j,
        }
    }
}

/// `c = alpha·x + beta·c`; a zero `beta` does not read `c`, which may hold anything.
fn scale_and_add(mut c: MatMut<'_, f64>, beta: f64, alpha: f64, x: MatRef<'_, f64>, part: Part) {
    for j in 0..c.ncols() {
        for i in (0..c.nrows()).filter(|&i| part.has(i, j)) {
            c[(i, j)] = scaled(beta, c[(i, j)]) + alpha * x[(i, j)];
        }
    }
}

fn scaled(beta: f64, old: f64) -> f64 {
    if beta.abs() > 0.0 { beta * old } else { 0.0 }
}

/// A matrix of which `op` has `rows` × `columns`: as it lies there, or transposed.
unsafe fn operand<'a>(flag: *const c_char, p: *const f64, rows: usize, columns: usize, ld: c_int) -> MatRef<'a, f64> {
    // SAFETY: as the caller's.
    unsafe { if is_transposed(flag) { read(p, columns, rows, ld).transpose() } else { read(p, rows, columns, ld) } }
}

/// `C = alpha·op(A)·op(B) + beta·C`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dgemm_(
    trans_a: *const c_char,
    trans_b: *const c_char,
    m: *const c_int,
    n: *const c_int,
    k: *const c_int,
    alpha: *const f64,
    a: *const f64,
    lda: *const c_int,
    b: *const f64,
    ldb: *const c_int,
    beta: *const f64,
    c: *mut f64,
    ldc: *const c_int,
) {
    // SAFETY: BLAS's contract.
    unsafe {
        let (m, n, k) = (size(*m), size(*n), size(*k));
        let product = operand(trans_a, a, m, k, *lda) * operand(trans_b, b, k, n, *ldb);
        scale_and_add(write(c, m, n, *ldc), *beta, *alpha, product.as_ref(), Part::All);
    }
}

/// `y = alpha·op(A)·x + beta·y`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dgemv_(
    trans: *const c_char,
    m: *const c_int,
    n: *const c_int,
    alpha: *const f64,
    a: *const f64,
    lda: *const c_int,
    x: *const f64,
    step_x: *const c_int,
    beta: *const f64,
    y: *mut f64,
    step_y: *const c_int,
) {
    // SAFETY: BLAS's contract.
    unsafe {
        let (m, n) = (size(*m), size(*n));
        let (rows, columns) = if is_transposed(trans) { (n, m) } else { (m, n) };
        let a = operand(trans, a, rows, columns, *lda);
        for i in 0..rows {
            let sum: f64 = (0..columns).map(|j| a[(i, j)] * at(x, j, *step_x)).sum();
            let out = y.offset(i as isize * *step_y as isize);
            *out = scaled(*beta, *out) + *alpha * sum;
        }
    }
}

/// `y = alpha·A·x + beta·y` with a symmetric `A`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dsymv_(
    uplo: *const c_char,
    n: *const c_int,
    alpha: *const f64,
    a: *const f64,
    lda: *const c_int,
    x: *const f64,
    step_x: *const c_int,
    beta: *const f64,
    y: *mut f64,
    step_y: *const c_int,
) {
    // SAFETY: BLAS's contract.
    unsafe {
        let (n, part) = (size(*n), Part::of(uplo));
        let a = read(a, n, n, *lda);
        for i in 0..n {
            let entry = |j: usize| if part.has(i, j) { a[(i, j)] } else { a[(j, i)] };
            let sum: f64 = (0..n).map(|j| entry(j) * at(x, j, *step_x)).sum();
            let out = y.offset(i as isize * *step_y as isize);
            *out = scaled(*beta, *out) + *alpha * sum;
        }
    }
}

/// `C = alpha·A·Aᵀ + beta·C` (or `Aᵀ·A`), one triangle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dsyrk_(
    uplo: *const c_char,
    trans: *const c_char,
    n: *const c_int,
    k: *const c_int,
    alpha: *const f64,
    a: *const f64,
    lda: *const c_int,
    beta: *const f64,
    c: *mut f64,
    ldc: *const c_int,
) {
    // SAFETY: BLAS's contract.
    unsafe {
        let (n, k) = (size(*n), size(*k));
        let a = operand(trans, a, n, k, *lda);
        let product = a * a.transpose();
        scale_and_add(write(c, n, n, *ldc), *beta, *alpha, product.as_ref(), Part::of(uplo));
    }
}

/// `C = alpha·(A·Bᵀ + B·Aᵀ) + beta·C` (or with both transposed), one triangle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dsyr2k_(
    uplo: *const c_char,
    trans: *const c_char,
    n: *const c_int,
    k: *const c_int,
    alpha: *const f64,
    a: *const f64,
    lda: *const c_int,
    b: *const f64,
    ldb: *const c_int,
    beta: *const f64,
    c: *mut f64,
    ldc: *const c_int,
) {
    // SAFETY: BLAS's contract.
    unsafe {
        let (n, k) = (size(*n), size(*k));
        let (a, b) = (operand(trans, a, n, k, *lda), operand(trans, b, n, k, *ldb));
        let product: Mat<f64> = a * b.transpose() + b * a.transpose();
        scale_and_add(write(c, n, n, *ldc), *beta, *alpha, product.as_ref(), Part::of(uplo));
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::float_cmp, reason = "small whole numbers, exactly")]

    use super::*;

    const N: c_int = 2;
    // By columns: [1 3; 2 4].
    const A: [f64; 4] = [1.0, 2.0, 3.0, 4.0];
    const B: [f64; 4] = [5.0, 6.0, 7.0, 8.0];

    fn flag(letter: u8) -> c_char {
        c_char::from_ne_bytes([letter])
    }

    #[test]
    fn products_are_those_of_the_textbook() {
        let (n, one, two) = (N, 1.0, 2.0);
        let mut c = [1.0, f64::NAN, 0.0, 0.0];
        // SAFETY: two by two everywhere; beta zero does not read the NaN.
        unsafe { dgemm_(&flag(b'n'), &flag(b'T'), &n, &n, &n, &two, A.as_ptr(), &n, B.as_ptr(), &n, &0.0, c.as_mut_ptr(), &n) };
        // [1 3; 2 4]·[5 6; 7 8] = [26 30; 38 44]
        assert_eq!(c, [52.0, 76.0, 60.0, 88.0]);
        let mut y = [1.0, 1.0];
        // SAFETY: as above.
        unsafe { dgemv_(&flag(b'T'), &n, &n, &one, A.as_ptr(), &n, B.as_ptr(), &1, &two, y.as_mut_ptr(), &1) };
        assert_eq!(y, [1.0 * 5.0 + 2.0 * 6.0 + 2.0, 3.0 * 5.0 + 4.0 * 6.0 + 2.0]);
        let mut y = [0.0; 2];
        // SAFETY: as above. The lower triangle of A: [1 2; 2 4].
        unsafe { dsymv_(&flag(b'L'), &n, &one, A.as_ptr(), &n, B.as_ptr(), &1, &0.0, y.as_mut_ptr(), &1) };
        assert_eq!(y, [17.0, 34.0]);
    }

    #[test]
    fn symmetric_products_write_one_triangle() {
        let (n, one) = (N, 1.0);
        let mut c = [9.0; 4];
        // SAFETY: two by two everywhere. A·Aᵀ = [10 14; 14 20].
        unsafe { dsyrk_(&flag(b'U'), &flag(b'N'), &n, &n, &one, A.as_ptr(), &n, &0.0, c.as_mut_ptr(), &n) };
        assert_eq!(c, [10.0, 9.0, 14.0, 20.0]);
        let mut c = [0.0, 0.0, 9.0, 0.0];
        // SAFETY: as above. AᵀB + BᵀA = [1·5+2·6 1·7+2·8; 3·5+4·6 3·7+4·8] + transposed.
        unsafe { dsyr2k_(&flag(b'L'), &flag(b'T'), &n, &n, &one, A.as_ptr(), &n, B.as_ptr(), &n, &one, c.as_mut_ptr(), &n) };
        assert_eq!(c, [34.0, 62.0, 9.0, 106.0]);
    }
}
