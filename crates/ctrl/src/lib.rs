//! Controllers: no allocation, no clock, no I/O, and a [`Controller::step`] that cannot fail.
//!
//! A controller's numbers live in it and never change; what changes from step to step lives in its state, outside. Numbers that are
//! not finite latch a fault and the command becomes the safe one. Models of the robot are the caller's: what they say arrives as a
//! feed-forward effort.
//!
//! Feature `design`: analysis of control loops on the desk (structured singular value), with std.
#![no_std]

#[cfg(feature = "design")]
extern crate alloc;
#[cfg(feature = "design")]
extern crate std;

pub mod controller;
#[cfg(feature = "design")]
pub mod design;
pub mod pd_gravity;

pub use controller::{Command, ConfigError, Controller, Health, Input};
pub use pd_gravity::{PdGravity, PdGravityConfig, PdGravityState};
