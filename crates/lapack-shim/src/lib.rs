//! The eleven BLAS and LAPACK routines that the semidefinite solver (clarabel's feature `sdp`) links, over faer.
//!
//! So the solver needs no Fortran, no system library and no download, and the Python wheel stays self-contained. Only what clarabel calls
//! is here, for the arguments it calls them with: matrices by columns, real and double; the single-precision twins that it links and
//! never calls end the process. Workspace queries (`lwork = -1`) answer 1, because nothing here needs workspace.
//!
//! The symbols are global: a program that links this crate must not link another LAPACK statically.

#![expect(unsafe_code, reason = "Fortran's interface is pointers")]
#![expect(
    clippy::missing_safety_doc,
    reason = "one contract for all, in `view`: valid pointers to the sizes stated, as in the reference LAPACK"
)]

pub mod blas;
pub mod lapack;
pub mod single;
mod view;

/// Keeps the symbols in the program: a crate that uses them only through the linker must call something here.
#[inline(never)]
pub fn link() {}
