//! The shipped robots.

use pkm_dyn::urdf;
use pyo3::prelude::*;

use crate::dynamics::Robot;
use crate::error;

/// Names of the shipped robots.
#[pyfunction]
pub(crate) fn shipped_names() -> Vec<&'static str> {
    pkm_robots::ALL.iter().map(|r| r.name).collect()
}

/// The shipped robot of that name; `ValueError` when there is none.
#[pyfunction]
pub(crate) fn load_shipped(name: &str) -> PyResult<Robot> {
    let shipped = pkm_robots::find(name)
        .ok_or_else(|| error::value(format!("no shipped robot {name:?} (there are: {})", shipped_names().join(", "))))?;
    let description = urdf::parse(shipped.toml, shipped.urdf, [shipped.toml_name, shipped.urdf_name]).map_err(|e| error::load(&e))?;
    Ok(Robot::new(description))
}
