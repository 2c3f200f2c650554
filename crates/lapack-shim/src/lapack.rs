//! Factorisations and what is solved with them. `info` is 0 on success, as in LAPACK.

use core::ffi::{c_char, c_int};

use faer::linalg::solvers::Solve;
use faer::{MatRef, Side};

use crate::view::{is, is_upper, read, size, write};

/// What a workspace query answers.
unsafe fn is_query(lwork: *const c_int, work: *mut f64, info: *mut c_int) -> bool {
    // SAFETY: as the caller's.
    unsafe {
        let asks = *lwork == -1;
        if asks {
            (*work, *info) = (1.0, 0);
        }
        asks
    }
}

/// Cholesky factor in place, of the triangle named; `info` is the first minor that is not positive definite.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dpotrf_(uplo: *const c_char, n: *const c_int, a: *mut f64, lda: *const c_int, info: *mut c_int) {
    // SAFETY: LAPACK's contract.
    unsafe {
        let n = size(*n);
        let a = write(a, n, n, *lda);
        // Both cases are the lower factor, of the matrix or of its transpose.
        let mut l = if is_upper(uplo) { a.transpose_mut() } else { a };
        *info = 0;
        for j in 0..n {
            for i in j..n {
                let sum: f64 = (0..j).map(|k| l[(i, k)] * l[(j, k)]).sum();
                let rest = l[(i, j)] - sum;
                if i > j {
                    l[(i, j)] = rest / l[(j, j)];
                } else if rest > 0.0 {
                    l[(j, j)] = rest.sqrt();
                } else {
                    // Also what is not a number ends here.
                    *info = c_int::try_from(j + 1).unwrap_or(c_int::MAX);
                    return;
                }
            }
        }
    }
}

/// Solves with the factor of [`dpotrf_`], in place of the right-hand sides.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dpotrs_(
    uplo: *const c_char,
    n: *const c_int,
    nrhs: *const c_int,
    a: *const f64,
    lda: *const c_int,
    b: *mut f64,
    ldb: *const c_int,
    info: *mut c_int,
) {
    // SAFETY: LAPACK's contract.
    unsafe {
        let (n, nrhs) = (size(*n), size(*nrhs));
        let a = read(a, n, n, *lda);
        let l: MatRef<'_, f64> = if is_upper(uplo) { a.transpose() } else { a };
        let mut b = write(b, n, nrhs, *ldb);
        for c in 0..nrhs {
            for i in 0..n {
                let sum: f64 = (0..i).map(|k| l[(i, k)] * b[(k, c)]).sum();
                b[(i, c)] = (b[(i, c)] - sum) / l[(i, i)];
            }
            for i in (0..n).rev() {
                let sum: f64 = (i + 1..n).map(|k| l[(k, i)] * b[(k, c)]).sum();
                b[(i, c)] = (b[(i, c)] - sum) / l[(i, i)];
            }
        }
        *info = 0;
    }
}

/// Solves a square system by LU with row pivots, in place of the right-hand sides; `a` and the pivots are left as they were.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dgesv_(
    n: *const c_int,
    nrhs: *const c_int,
    a: *mut f64,
    lda: *const c_int,
    _pivots: *mut c_int,
    b: *mut f64,
    ldb: *const c_int,
    info: *mut c_int,
) {
    // SAFETY: LAPACK's contract.
    unsafe {
        let n = size(*n);
        let factor = read(a, n, n, *lda).partial_piv_lu();
        factor.solve_in_place(write(b, n, size(*nrhs), *ldb));
        // As LAPACK: a pivot of exactly zero has no solution.
        let singular = (0..n).find(|&i| factor.U()[(i, i)].abs() <= 0.0);
        *info = singular.map_or(0, |i| c_int::try_from(i + 1).unwrap_or(c_int::MAX));
    }
}

/// Sizes and places of a compact singular value decomposition.
struct Svd {
    m: usize,
    n: usize,
    s: *mut f64,
    u: (*mut f64, c_int),
    vt: (*mut f64, c_int),
}

impl Svd {
    unsafe fn run(&self, a: *const f64, lda: c_int) -> c_int {
        let k = self.m.min(self.n);
        // SAFETY: LAPACK's contract, job 'S': U is m × k, Vᵀ is k × n.
        unsafe {
            let Ok(svd) = read(a, self.m, self.n, lda).thin_svd() else { return 1 };
            for i in 0..k {
                *self.s.add(i) = svd.S()[i];
            }
            write(self.u.0, self.m, k, self.u.1).copy_from(svd.U());
            write(self.vt.0, k, self.n, self.vt.1).copy_from(svd.V().transpose());
            0
        }
    }
}

/// Compact singular value decomposition (job 'S', the one clarabel asks for).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dgesdd_(
    _job: *const c_char,
    m: *const c_int,
    n: *const c_int,
    a: *mut f64,
    lda: *const c_int,
    s: *mut f64,
    u: *mut f64,
    ldu: *const c_int,
    vt: *mut f64,
    ldvt: *const c_int,
    work: *mut f64,
    lwork: *const c_int,
    _iwork: *mut c_int,
    info: *mut c_int,
) {
    // SAFETY: LAPACK's contract.
    unsafe {
        if !is_query(lwork, work, info) {
            *info = Svd { m: size(*m), n: size(*n), s, u: (u, *ldu), vt: (vt, *ldvt) }.run(a, *lda);
        }
    }
}

/// As [`dgesdd_`]; in LAPACK another algorithm.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dgesvd_(
    _job_u: *const c_char,
    _job_vt: *const c_char,
    m: *const c_int,
    n: *const c_int,
    a: *mut f64,
    lda: *const c_int,
    s: *mut f64,
    u: *mut f64,
    ldu: *const c_int,
    vt: *mut f64,
    ldvt: *const c_int,
    work: *mut f64,
    lwork: *const c_int,
    info: *mut c_int,
) {
    // SAFETY: LAPACK's contract.
    unsafe {
        if !is_query(lwork, work, info) {
            *info = Svd { m: size(*m), n: size(*n), s, u: (u, *ldu), vt: (vt, *ldvt) }.run(a, *lda);
        }
    }
}

/// Eigenvalues (ascending) and, with job 'V', eigenvectors of a symmetric matrix; all of them, whatever the range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn dsyevr_(
    job: *const c_char,
    _range: *const c_char,
    uplo: *const c_char,
    n: *const c_int,
    a: *mut f64,
    lda: *const c_int,
    _lower: *const f64,
    _upper: *const f64,
    _first: *const c_int,
    _last: *const c_int,
    _tolerance: *const f64,
    found: *mut c_int,
    w: *mut f64,
    z: *mut f64,
    ldz: *const c_int,
    _support: *mut c_int,
    work: *mut f64,
    lwork: *const c_int,
    iwork: *mut c_int,
    _liwork: *const c_int,
    info: *mut c_int,
) {
    // SAFETY: LAPACK's contract.
    unsafe {
        if is_query(lwork, work, info) {
            *iwork = 1;
            return;
        }
        *found = *n;
        let n = size(*n);
        let a = read(a, n, n, *lda);
        // Only the named triangle may be read: the upper one is the lower one of the transpose.
        let a = if is_upper(uplo) { a.transpose() } else { a };
        *info = 1;
        if is(job, b"N") {
            if let Ok(values) = a.self_adjoint_eigenvalues(Side::Lower) {
                values.iter().enumerate().for_each(|(i, x)| *w.add(i) = *x);
                *info = 0;
            }
        } else if let Ok(eigen) = a.self_adjoint_eigen(Side::Lower) {
            (0..n).for_each(|i| *w.add(i) = eigen.S()[i]);
            write(z, n, n, *ldz).copy_from(eigen.U());
            *info = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flag(letter: u8) -> c_char {
        c_char::from_ne_bytes([letter])
    }

    #[test]
    fn both_triangles_give_the_cholesky_factor_and_its_solution() {
        // [4 2; 2 10] = L·Lᵀ with L = [2 0; 1 3].
        for (uplo, entry) in [(b'L', 1), (b'U', 2)] {
            let (n, mut info, mut b) = (2, 9, [8.0, 22.0]);
            let mut a = [4.0, f64::NAN, f64::NAN, 10.0];
            a[entry] = 2.0;
            // SAFETY: two by two; the other triangle is not read.
            unsafe { dpotrf_(&flag(uplo), &n, a.as_mut_ptr(), &n, &mut info) };
            assert_eq!((info, a[0], a[entry], a[3]), (0, 2.0, 1.0, 3.0));
            // SAFETY: as above.
            unsafe { dpotrs_(&flag(uplo), &n, &1, a.as_ptr(), &n, b.as_mut_ptr(), &n, &mut info) };
            assert_eq!((info, b), (0, [1.0, 2.0]));
        }
        let mut a = [1.0, 2.0, 2.0, 1.0];
        let mut info = 0;
        // SAFETY: as above.
        unsafe { dpotrf_(&flag(b'L'), &2, a.as_mut_ptr(), &2, &mut info) };
        assert_eq!(info, 2, "the second minor is negative");
    }

    #[test]
    fn a_square_system_is_solved_and_a_singular_one_is_told() {
        let (mut info, mut b) = (9, [7.0, 10.0]);
        // SAFETY: two by two. [1 3; 2 4]·[1; 2] = [7; 10].
        unsafe { dgesv_(&2, &1, [1.0, 2.0, 3.0, 4.0].as_mut_ptr(), &2, core::ptr::null_mut(), b.as_mut_ptr(), &2, &mut info) };
        assert!(info == 0 && (b[0] - 1.0).abs() < 1e-14 && (b[1] - 2.0).abs() < 1e-14, "{b:?}");
        // SAFETY: as above.
        unsafe { dgesv_(&2, &1, [1.0, 1.0, 1.0, 1.0].as_mut_ptr(), &2, core::ptr::null_mut(), b.as_mut_ptr(), &2, &mut info) };
        assert_eq!(info, 2);
    }

    #[test]
    fn a_tall_matrix_is_its_singular_value_decomposition() {
        let a = [1.0, 2.0, 3.0, 4.0, 5.0, 7.0];
        let (mut s, mut u, mut vt, mut work, mut info) = ([0.0; 2], [0.0; 6], [0.0; 4], [0.0; 1], 9);
        let job = flag(b'S');
        let mut call = |lwork: c_int| {
            let mut copy = a;
            // SAFETY: 3 × 2, compact.
            unsafe {
                let (s, u, vt) = (s.as_mut_ptr(), u.as_mut_ptr(), vt.as_mut_ptr());
                let (work, iwork) = (work.as_mut_ptr(), core::ptr::null_mut());
                dgesdd_(&job, &3, &2, copy.as_mut_ptr(), &3, s, u, &3, vt, &2, work, &lwork, iwork, &mut info);
            }
        };
        call(-1);
        call(1);
        assert_eq!((info, work), (0, [1.0]));
        for j in 0..2 {
            for i in 0..3 {
                let back: f64 = (0..2).map(|k| u[i + 3 * k] * s[k] * vt[k + 2 * j]).sum();
                assert!((back - a[i + 3 * j]).abs() < 1e-13);
            }
        }
    }

    #[test]
    fn only_the_named_triangle_of_a_symmetric_matrix_is_read() {
        // [2 1; 1 2]: 1 and 3.
        for (uplo, entry) in [(b'L', 1), (b'U', 2)] {
            let (mut w, mut z, mut work, mut iwork, mut info, mut found) = ([0.0; 2], [0.0; 4], [0.0; 1], [0; 1], 9, 0);
            let mut a = [2.0, 7.0, 7.0, 2.0];
            a[entry] = 1.0;
            let (job, all, uplo) = (flag(b'V'), flag(b'A'), flag(uplo));
            let (zero, none) = (0.0, 0);
            // SAFETY: two by two.
            unsafe {
                let (w, z, work, iwork) = (w.as_mut_ptr(), z.as_mut_ptr(), work.as_mut_ptr(), iwork.as_mut_ptr());
                let support = core::ptr::null_mut();
                let a = a.as_mut_ptr();
                dsyevr_(
                    &job, &all, &uplo, &2, a, &2, &zero, &zero, &none, &none, &zero, &mut found, w, z, &2, support, work, &1, iwork, &1,
                    &mut info,
                );
            }
            assert!(info == 0 && found == 2 && (w[0] - 1.0).abs() < 1e-14 && (w[1] - 3.0).abs() < 1e-14, "{w:?}");
            assert!((z[0] * z[1] + 0.5).abs() < 1e-14 && (z[2] * z[3] - 0.5).abs() < 1e-14, "{z:?}");
        }
    }
}
