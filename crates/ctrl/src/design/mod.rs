//! Work on the desk: discretisation, gains, stability margins and structured singular values. Allocates, takes its time, and never runs
//! in the loop.
#![expect(non_snake_case, reason = "matrices carry the capital letters of the cited equations")]

pub mod discretise;
mod error;
pub mod force_loop;
pub mod lyapunov;
pub mod margin;
pub mod mu;
pub mod place;
pub mod riccati;
pub mod schedule;

pub use error::DesignError;
