//! Mechanics of serial and closed-loop robots: a spanning tree of one-coordinate joints, loops that close it, drives on some joints.
//!
//! Equation of motion in tree coordinates, with loop forces `lambda`:
//! `M(q)·a + nle(q, v) + friction = tau + Jᵀ·lambda`. With `G = dv_tree/dv_independent` the loop forces drop out (`J·G = 0`) and the
//! drives feel `tau_act = Gᵀ·(M·a + nle + friction)` [Valera2017, eq. 2]. Everything is linear in the ten inertial parameters of each
//! body; [`regressor`] returns that linear map.
//!
//! Model and data are split as in Pinocchio: a [`Model`] never changes once built, a [`Data`] holds all results and scratch and is
//! allocated once. Stacking is [linear; angular]; units are SI; the order of inertial parameters is known to [`parameters`] alone.
//!
//! Not in here: files other than robot.toml and URDF (feature `urdf`), clocks, estimators, random numbers.
#![cfg_attr(not(any(test, feature = "urdf")), no_std)]

extern crate alloc;

pub mod aba;
pub mod configuration;
pub mod constrained;
pub mod crba;
pub mod data;
pub mod effects;
pub mod elimination;
pub mod energy;
pub mod inverse_dynamics;
pub mod jacobian;
pub mod kinematics;
pub mod loops;
pub mod math;
pub mod model;
pub mod parameters;
pub mod regressor;
pub mod rnea;
mod small;
pub mod spatial;
pub mod svd;
#[cfg(feature = "urdf")]
pub mod urdf;
pub mod workspace;

pub use data::Data;
pub use model::Model;
pub use parameters::InertialParameters;
