//! The contract with hardware and time. Knows no dynamics and no controller.
//!
//! Time enters the workspace through [`Clock`] alone, so that a loop can run on a real clock, on a simulated one, or step by step.
#![cfg_attr(not(feature = "std"), no_std)]

pub mod clock;

#[cfg(feature = "std")]
pub use clock::MonotonicClock;
pub use clock::{Clock, ManualClock};
