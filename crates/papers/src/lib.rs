//! The experiments of the four papers, done again on the shipped robots: their numbers against ours, row by row.
//!
//! Every row says where in the paper it stands, what was printed, what comes out here, what ours is held against, and what follows. Where
//! a paper's equations are misprinted the mended ones are used and the row says so; where a number cannot come out, the row says why.
//!
//! Not in here: files, printing, clocks. The same rows come out on every run.

pub mod arceo2021;
pub mod armas;
mod chance;
mod error;
pub mod mcdaid;
mod refused;
mod robot;
mod row;
mod series;
pub mod valera2017;

pub use error::PaperError;
pub use row::{Gate, Line, Plot, Reproduction, Row, Verdict};

/// Told the share done, 0 to 1.
pub type Progress<'p> = &'p mut dyn FnMut(f64);

/// A paper whose experiments can be done again.
#[derive(Debug, Clone, Copy)]
pub struct Paper {
    /// Key in docs/REFERENCES.md, in small letters.
    pub key: &'static str,
    /// What it is about.
    pub title: &'static str,
    /// Does the experiments.
    ///
    /// # Errors
    /// A robot, controller or estimate that cannot be built: a mistake here, not in the paper.
    pub reproduce: fn(Progress) -> Result<Reproduction, PaperError>,
}

/// Every paper, in the order of their years.
pub const ALL: [Paper; 4] = [
    Paper { key: "valera2017", title: "Controller-observer and identification of a 3-PRS robot", reproduce: valera2017::reproduce },
    Paper { key: "armas", title: "Reduced-order linear dynamic model of a 3UPS+1RPU robot", reproduce: armas::reproduce },
    Paper { key: "arceo2021", title: "Computed torque and active disturbance rejection of motoBOTTE", reproduce: arceo2021::reproduce },
    Paper { key: "mcdaid", title: "Multivariable actuator force control of a 4-UPS ankle robot", reproduce: mcdaid::reproduce },
];

/// The paper of that key.
#[must_use]
pub fn find(key: &str) -> Option<&'static Paper> {
    ALL.iter().find(|paper| paper.key == key)
}
