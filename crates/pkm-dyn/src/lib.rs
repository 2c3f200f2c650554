//! Mechanics of serial and closed-loop robots: a spanning tree of joints, loops that close it, drives on some joints.
//!
//! Equation of motion in tree coordinates, with loop efforts `lambda`:
//! `M(q)·a + nle(q, v) + friction = tau + Jᵀ·lambda`. With `G = dv_tree/dv_independent` the loop efforts drop out (`J·G = 0`) and the
//! drives feel `tau_act = Gᵀ·(M·a + nle + friction)` [Valera2017, eq. 2]. Everything is linear in the ten inertial parameters of each
//! body; [`regressor`] and [`inverse_dynamics::actuated_regressor`] return that linear map.
//!
//! | loops open | | loops closed | |
//! |---|---|---|---|
//! | [`rnea`] | efforts for a motion | [`inverse_dynamics`] | the same of the drives |
//! | [`aba`] | motion for efforts | [`constrained::forward_dynamics`] | the same, with multipliers |
//! | [`crba`] | mass matrix | [`constrained::reduced_mass_matrix`] | the same in independent coordinates |
//! | [`jacobian`], [`kinematics`] | frames | [`loops`] | gaps, reduction, wrenches, singularities |
//!
//! Model and data are split as in Pinocchio: a [`Model`] never changes once built, a [`Data`] holds all results and scratch and is
//! allocated once. Stacking is [linear; angular]; units are SI; the order of inertial parameters is known to [`parameters`] alone.
//!
//! ```
//! use pkm_dyn::constrained::forward_dynamics;
//! use pkm_dyn::inverse_dynamics::inverse_dynamics;
//! use pkm_dyn::loops::assemble;
//! # let urdf = r#"<robot name="r"><link name="base"/><link name="crank"><inertial><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0"
//! # iyy="0.1" iyz="0" izz="0.1"/></inertial></link><link name="slider"><inertial><mass value="2"/><inertia ixx="0.1" ixy="0" ixz="0"
//! # iyy="0.1" iyz="0" izz="0.1"/></inertial></link><link name="rod"/><joint name="turn" type="continuous"><parent link="base"/>
//! # <child link="crank"/><axis xyz="0 0 1"/></joint><joint name="slide" type="prismatic"><parent link="base"/><child link="slider"/>
//! # <axis xyz="1 0 0"/></joint><joint name="swing" type="continuous"><parent link="slider"/><child link="rod"/><axis xyz="0 0 1"/></joint>
//! # </robot>"#;
//! # let toml = r#"
//! # name = "crank"
//! # urdf = "crank.urdf"
//! # assembly = { slide = 0.7 }
//! # loop = [{ name = "pin", a = { link = "crank", xyz = [0.2, 0, 0] }, b = { link = "rod", xyz = [-0.5, 0, 0] }, constrain = ["x", "y"] }]
//! # actuator = [{ joint = "turn" }]
//! # "#;
//! let model = pkm_dyn::urdf::parse(toml, urdf, ["crank.toml", "crank.urdf"])?.bare;
//! let mut data = pkm_dyn::Data::new(&model);
//! assert!(assemble(&model, &mut data).is_closed);
//! // What must the drive supply to turn at 2 rad/s and speed up by 1 rad/s²?
//! assert!(inverse_dynamics(&model, &mut data, &[0.3], &[2.0], &[1.0]).is_closed);
//! // And the other way round: every joint's acceleration for that effort.
//! let (q, v, tau) = (data.q.clone(), data.v.clone(), [data.tau_act[0], 0.0, 0.0]);
//! assert!(forward_dynamics(&model, &mut data, &q, &v, &tau).is_closed);
//! assert!((data.a[0] - 1.0).abs() < 1e-9);
//! # Ok::<(), pkm_dyn::urdf::LoadError>(())
//! ```
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
