//! Fortran's arguments as matrices and flags.
//!
//! The contract of every routine of this crate: each pointer is valid for what the reference BLAS and LAPACK say it points to, and the
//! memory that is written overlaps nothing that is read.

use core::ffi::{c_char, c_int};

use faer::{MatMut, MatRef};

/// A size; negative ones, which Fortran forbids, count as nothing.
pub(crate) fn size(n: c_int) -> usize {
    usize::try_from(n).unwrap_or(0)
}

/// A matrix by columns, `ld` apart.
pub(crate) unsafe fn read<'a>(p: *const f64, rows: usize, columns: usize, ld: c_int) -> MatRef<'a, f64> {
    // SAFETY: the caller states a matrix of this size at `p`.
    unsafe { MatRef::from_raw_parts(p, rows, columns, 1, ld as isize) }
}

/// The same to be written.
pub(crate) unsafe fn write<'a>(p: *mut f64, rows: usize, columns: usize, ld: c_int) -> MatMut<'a, f64> {
    // SAFETY: the caller states a matrix of this size at `p` that nothing else refers to.
    unsafe { MatMut::from_raw_parts_mut(p, rows, columns, 1, ld as isize) }
}

/// Element `i` of a vector whose elements lie `step` apart.
pub(crate) unsafe fn at(p: *const f64, i: usize, step: c_int) -> f64 {
    // SAFETY: the caller states a vector that has this element.
    unsafe { *p.offset(i as isize * step as isize) }
}

/// Whether a flag is one of `letters`, in either case.
pub(crate) unsafe fn is(flag: *const c_char, letters: &[u8]) -> bool {
    // SAFETY: the caller states a character.
    let [letter] = unsafe { *flag }.to_ne_bytes();
    letters.contains(&letter.to_ascii_uppercase())
}

/// Whether a matrix is to be taken transposed.
pub(crate) unsafe fn is_transposed(flag: *const c_char) -> bool {
    // SAFETY: as the caller's.
    unsafe { is(flag, b"TC") }
}

/// Whether the upper triangle is meant.
pub(crate) unsafe fn is_upper(flag: *const c_char) -> bool {
    // SAFETY: as the caller's.
    unsafe { is(flag, b"U") }
}
