//! Controllers: no allocation, no clock, no I/O, and a [`Controller::step`] that cannot fail.
//!
//! A controller's numbers live in it and never change; what changes from step to step lives in its state, outside. Numbers that are
//! not finite, and loops of the model that do not close, latch a fault and the command becomes the safe one. Controllers without a model
//! of the robot take what one says as a feed-forward effort; those with one ([`computed_torque`]) keep its pose in their state, and find
//! velocities by an [`observer`].
//!
//! Motion: [`pd_gravity`]. Contact: [`force`], and [`exercise`] for what a patient does with it. Around any of them: [`limits`].
//!
//! Of a number of drives that is known at run time only: [`running`]. Feature `config`: controllers from files, with std. Feature `design`: work on the desk (discretisation, gains, margins, structured singular value), with std.
#![no_std]

extern crate alloc;
#[cfg(any(feature = "design", feature = "config"))]
extern crate std;

pub mod adrc;
pub mod catalogue;
pub mod computed_torque;
pub mod computed_torque_dae;
#[cfg(feature = "config")]
pub mod config;
pub mod controller;
#[cfg(feature = "design")]
pub mod design;
mod drive_model;
pub mod error_dynamics;
pub mod exercise;
pub mod fault;
pub mod filter;
pub mod force;
pub mod limits;
mod linear_system;
pub mod observer;
pub mod pd_gravity;
pub mod pd_model;
pub mod pid;
mod pose_walk;
pub mod running;
pub mod tracking_differentiator;

#[cfg(test)]
mod computed_torque_tests;

pub use adrc::{Adrc, AdrcConfig, AdrcState};
pub use computed_torque::{ComputedTorque, ComputedTorqueConfig, ComputedTorqueState, FrictionVelocity};
pub use computed_torque_dae::{ComputedTorqueDae, ComputedTorqueDaeConfig, ComputedTorqueDaeState};
pub use controller::{Command, ConfigError, Controller, Health, Input};
pub use error_dynamics::ErrorGains;
pub use fault::{Acted, Fault, FaultCode, Limit};
pub use limits::Limited;
pub use pd_gravity::{PdGravity, PdGravityConfig, PdGravityState};
pub use pd_model::{PdModel, PdModelConfig, PdModelState};
pub use pid::{AntiWindup, Pid, PidConfig, PidState};
pub use running::{About, Numbers, Running, Runs, Signals};
