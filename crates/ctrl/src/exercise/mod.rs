//! What a patient does with the robot: phases of moving, being moved, resisting and being helped, one after the other without a jump.
//!
//! A [`Script`] is data; [`Exercise`] runs it around any position controller.

pub mod channel;
mod run;
pub mod script;

pub use channel::{Assistance, Channel, Path, Resistance, Wave};
pub use run::{Exercise, ExerciseConfig, ExerciseState};
pub use script::{MOST_PHASES, Phase, Script};
