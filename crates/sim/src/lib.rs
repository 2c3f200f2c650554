//! The world a robot is tried in: a plant with physics that the controller does not know, actuators, sensors, and a motion.
//!
//! [`run`] moves a true robot under a controller that knows only the nominal one and returns what a recorder would have written. The
//! same inputs give the same bits on every machine: random numbers come from a seeded generator, transcendental functions from
//! `pkm_dyn::math`.
//!
//! Not in here: files, printing, clocks, estimators. End stops and contacts are not simulated; motions stay inside the limits.

pub mod actuators;
pub mod error;
pub mod hidden;
mod nominal_motion;
pub mod plant;
mod random;
pub mod reference;
pub mod scenario;
pub mod sensors;
mod stick_slip;

pub use error::SimError;
pub use hidden::{describe, draw};
pub use plant::{Plant, ReducedPlant};
pub use reference::{Reference, ReferenceOptions, Sample};
pub use scenario::{Scenario, run};
