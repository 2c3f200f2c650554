//! The world a robot is tried in: a plant with physics that the controller does not know, actuators, sensors, and a motion.
//!
//! [`run`] moves a true robot under a controller that knows only the nominal one and returns what a recorder would have written;
//! [`run_along`] does so along any [`Trajectory`], [`run_with`] under any controller. The
//! same inputs give the same bits on every machine: random numbers come from a seeded generator, transcendental functions from
//! `pkm_dyn::math`.
//!
//! Two plants: [`ReducedPlant`] in the coordinates of the drives, [`ConstrainedPlant`] in those of the whole tree, for effects that have
//! states or freedoms of their own. End stops are simulated by the latter where asked for; motions stay inside the limits.
//!
//! [`SimBackend`] is the same world behind the contract of hardware, [`limb`] the person in it, [`Equipment`] what both are made of;
//! [`run_instrumented`] runs a scenario through it.
//!
//! Not in here: files, printing, clocks, estimators.

extern crate alloc;

pub mod actuators;
pub mod ankle;
pub mod backend;
pub mod consistent;
pub mod dae;
mod dense;
pub mod equipment;
pub mod error;
pub mod hidden;
pub mod laws;
pub mod limb;
mod nominal_motion;
pub mod paced;
pub mod plant;
pub mod playback;
mod random;
#[cfg(feature = "rapier")]
pub mod rapier;
pub mod reference;
pub mod replay;
pub mod rerun;
pub mod scenario;
pub mod sensors;
pub mod shaped;
mod sizes;
mod stick_slip;
pub mod trajectory;
pub mod twin;

pub use ankle::{Ankle, AnkleAngle, AnkleExercise, AnkleMotion};
pub use backend::{SimBackend, SimClock, SimDrive, SimOptions};
pub use consistent::Consistent;
pub use dae::{ConstrainedOptions, ConstrainedPlant, Integrator};
pub use equipment::{DriveEquipment, Equipment, LimbEquipment, LimbPlace};
pub use error::SimError;
pub use hidden::{describe, draw};
pub use laws::ForeignLaw;
pub use paced::Paced;
pub use plant::{Plant, ReducedPlant};
pub use playback::Playback;
#[cfg(feature = "rapier")]
pub use rapier::{RapierOptions, RapierPlant};
pub use reference::{Reference, ReferenceOptions, Sample};
pub use rerun::rerun;
pub use scenario::{
    Instrumented, PlantKind, Scenario, Setup, Step, Watch, needs_states, replay_commands, run, run_along, run_instrumented, run_with,
};
pub use shaped::{Shape, Shaped};
pub use trajectory::{Trajectory, check_limits};
pub use twin::{Follow, Twin, twin, twin_along, twin_with};
