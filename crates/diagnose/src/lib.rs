//! What the tool is for: when a model and recordings differ, locate the mismatch, name the physics left out, model it, and show on
//! held-out data that the fit improves.
//!
//! Nothing about the robot's true physics may enter here except through the nominal robot and the recordings. The crate knows no simulator
//! and no files, but a temporary one for the series of long recordings where a folder for it is given ([`Settings::scratch`]).

extern crate alloc;

mod alternatives;
mod assemble;
mod chain;
mod channels;
mod columns;
mod commands;
mod confirm;
mod contest;
mod controller;
mod dependence;
mod design;
mod detectable;
mod engine;
mod enough;
mod error;
pub mod evidence;
mod experiments;
mod explain;
mod extents;
mod final_fit;
mod gate;
mod gram;
mod hands;
mod held;
mod idle;
mod integrity;
pub mod isolability;
mod leftover;
mod located;
mod motion;
mod nominal;
mod one_hand;
mod picture;
mod plan;
mod predict;
mod priors;
mod prove;
mod pushed;
mod rank;
mod refine;
mod regimes;
mod repeatable;
mod replay;
mod reversals;
mod rows;
mod screen;
mod search;
mod segment;
mod sensitivity;
mod settings;
mod sharing;
mod shelf;
mod shift;
mod simplify;
mod solve;
#[cfg(test)]
mod testing;
mod thinned;
mod thousands;
mod turning;
mod variety;
pub mod verdict;
mod window;
mod wins;
mod work;
mod worth;

pub use columns::looked_for;
pub use controller::ControllerTwin;
pub use engine::{diagnose, diagnose_watched, diagnose_with_controller};
pub use error::InputError;
pub use evidence::{Diagnosis, Evidence, Refined};
pub use located::{Located, Watch};
pub use plan::{Alias, Belief, Plan, PlanSettings, Required, plan, recorded_noise};
pub use predict::predict;
pub use replay::{Simulation, Twin, replay};
pub use settings::{MIN_SAMPLES, Settings};
pub use verdict::Verdict;
