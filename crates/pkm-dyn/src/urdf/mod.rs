//! robot.toml + URDF to a [`Robot`](crate::effects::Robot) and back.
//!
//! A URDF is a tree; robot.toml beside it closes the loops, says what is driven and measured, and adds physics beyond rigid bodies.
//! Everything read here is hostile until checked: sizes first, then syntax, then names, then every number.

mod blame;
pub mod export;
mod read;
mod spec;
mod tree;
mod write;

pub use read::{Description, LoadError, load, parse};
pub use spec::{ActuatorSpec, CouplingSpec, EffectSpec, FrameSpec, LoopSpec, Places, SensorSpec, Spec};
pub use write::{refined_toml, refined_urdf};
