//! Controllers: no allocation, no clock, no I/O, and a [`Controller::step`] that cannot fail.
//!
//! A controller's numbers live in it and never change; what changes from step to step lives in its state, outside. Numbers that are
//! not finite latch a fault and the command becomes the safe one. Models of the robot are the caller's: what they say arrives as a
//! feed-forward effort.
//!
//! Motion: [`pd_gravity`]. Contact: [`force`], and [`exercise`] for what a patient does with it. Around any of them: [`limits`].
//!
//! Feature `design`: work on the desk (discretisation, gains, margins, structured singular value), with std.
#![no_std]

extern crate alloc;
#[cfg(feature = "design")]
extern crate std;

pub mod controller;
#[cfg(feature = "design")]
pub mod design;
pub mod exercise;
pub mod fault;
pub mod force;
pub mod limits;
pub mod pd_gravity;

pub use controller::{Command, ConfigError, Controller, Health, Input};
pub use fault::{Acted, Fault, FaultCode, Limit};
pub use limits::Limited;
pub use pd_gravity::{PdGravity, PdGravityConfig, PdGravityState};
