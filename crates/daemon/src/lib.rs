//! The loop on the robot's computer: a controller from a file on a robot behind a [`pkm_hal::Backend`], in real time.
//!
//! [`machine::Machine`] is one period: read, check, decide, limit, command, record. It neither waits, allocates, locks nor prints, and knows time
//! only as it is told: a test drives it by a scripted clock. [`runner`] lets it run on a grid of absolute times, [`supervisor`] gives it
//! orders from outside and keeps what it recorded. Robots, motions and files are given to this crate by who starts it.
//!
//! Nothing moves until somebody orders it: [`pkm_hal::Phase`] says what is being done, and every change of it has a cause.

extern crate alloc;

pub mod black_box;
pub mod blend;
pub mod config;
pub mod control;
pub mod gate;
pub mod grid;
pub mod histogram;
pub mod machine;
pub mod motion;
pub mod order;
pub mod owners;
pub mod realtime;
pub mod runner;
pub mod status;
pub mod supervisor;
pub mod weigher;

pub use config::{ConfigError, DaemonConfig};
pub use grid::Grid;
pub use machine::{Limits, Machine, Parts, Tick};
pub use motion::{Motion, Wanted};
pub use order::{Order, OrderKind, Refusal};
