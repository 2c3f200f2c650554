//! The world a robot is tried in: a plant with physics that the controller does not know, actuators, sensors, and a motion.
//!
//! [`run`] moves a true robot under a controller that knows only the nominal one and returns what a recorder would have written;
//! [`run_along`] does so along any [`Trajectory`]. The
//! same inputs give the same bits on every machine: random numbers come from a seeded generator, transcendental functions from
//! `pkm_dyn::math`.
//!
//! Not in here: files, printing, clocks, estimators. End stops and contacts are not simulated; motions stay inside the limits.

pub mod actuators;
pub mod error;
pub mod hidden;
mod nominal_motion;
pub mod plant;
pub mod playback;
mod random;
#[cfg(feature = "rapier")]
pub mod rapier;
pub mod reference;
pub mod scenario;
pub mod sensors;
pub mod shaped;
mod stick_slip;
pub mod trajectory;

pub use error::SimError;
pub use hidden::{describe, draw};
pub use plant::{Plant, ReducedPlant};
pub use playback::Playback;
#[cfg(feature = "rapier")]
pub use rapier::{RapierOptions, RapierPlant};
pub use reference::{Reference, ReferenceOptions, Sample};
pub use scenario::{Scenario, run, run_along};
pub use shaped::{Shape, Shaped};
pub use trajectory::{Trajectory, check_limits};
