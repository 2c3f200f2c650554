//! The Python wheel: names, types and exceptions of Python around the crates of the workspace.
//!
//! Every function here converts, calls, converts; nothing is computed in this crate. The interpreter is released while Rust works.
//! Signatures and documentation for Python's tools are in `pkm/_pkm.pyi`.

extern crate alloc;

mod array;
mod catalogue;
mod controller;
mod diagnosis;
mod dynamics;
mod error;
mod evidence;
mod excitation;
mod identification;
mod learned;
mod long;
mod mechanics;
mod motion;
mod mu;
mod names;
mod plant;
mod recording;
mod reproduction;
mod robots;
mod simulation;
mod state;
mod units;
mod workspace;

use pyo3::prelude::*;

/// The compiled part of the package `pkm`; use `pkm` itself.
#[pymodule]
mod _pkm {
    #[pymodule_export]
    use super::catalogue::effects;
    #[pymodule_export]
    use super::controller::Controller;
    #[pymodule_export]
    use super::diagnosis::{Report, diagnose};
    #[pymodule_export]
    use super::dynamics::{Robot, load};
    #[pymodule_export]
    use super::excitation::{Excitation, excite};
    #[pymodule_export]
    use super::identification::Identification;
    #[pymodule_export]
    use super::mu::{Mu, mu};
    #[pymodule_export]
    use super::plant::Plant;
    #[pymodule_export]
    use super::recording::{Recording, read, write};
    #[pymodule_export]
    use super::reproduction::{papers, reproduce};
    #[pymodule_export]
    use super::robots::{load_shipped, shipped_names};
    #[pymodule_export]
    use super::simulation::simulate;

    /// Version of the package.
    #[expect(non_upper_case_globals, reason = "the name every Python package uses")]
    #[pymodule_export]
    const __version__: &str = env!("CARGO_PKG_VERSION");

    /// What the extension was built from: the version, and the commit where that is known, as `pkm --version` tells it.
    #[expect(non_upper_case_globals, reason = "as above")]
    #[pymodule_export]
    const __build__: &str = env!("PKM_VERSION");
}
