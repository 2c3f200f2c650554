//! Errors of the crates below as Python exceptions: `OSError` where the file system refuses, `ValueError` otherwise. The message is
//! the crates' own, one line.

use std::path::Path;

use pkm_diagnose::InputError;
use pkm_dyn::effects::EffectError;
use pkm_dyn::urdf::LoadError;
use pkm_dyn::urdf::export::ExportError;
use pkm_record::{ReadError, WriteError};
use pkm_sim::SimError;
use pyo3::PyErr;
use pyo3::exceptions::{PyFileNotFoundError, PyOSError, PyValueError};

/// The exception for what the file system said of `file`.
fn os(file: &str, message: String) -> PyErr {
    if Path::new(file).exists() { PyOSError::new_err(message) } else { PyFileNotFoundError::new_err(message) }
}

/// Bad input in one line.
pub(crate) fn value(message: impl Into<String>) -> PyErr {
    PyValueError::new_err(message.into())
}

/// A file that is not there, in one line.
pub(crate) fn missing(message: String) -> PyErr {
    PyFileNotFoundError::new_err(message)
}

/// A robot that cannot be read.
pub(crate) fn load(error: &LoadError) -> PyErr {
    match error {
        LoadError::Io { file, .. } => os(file, error.to_string()),
        _ => value(error.to_string()),
    }
}

/// A recording that cannot be read.
pub(crate) fn read(error: &ReadError) -> PyErr {
    match error {
        ReadError::Io { file, .. } => os(file, error.to_string()),
        _ => value(error.to_string()),
    }
}

/// A recording that cannot be written.
pub(crate) fn write(error: &WriteError) -> PyErr {
    match error {
        WriteError::Io { .. } => PyOSError::new_err(error.to_string()),
        _ => value(error.to_string()),
    }
}

/// A diagnosis that cannot start.
pub(crate) fn input(error: &InputError) -> PyErr {
    value(error.to_string())
}

/// A simulation that cannot start or go on.
pub(crate) fn sim(error: &SimError) -> PyErr {
    value(error.to_string())
}

/// A controller that cannot be read or built.
pub(crate) fn controller(path: &Path, error: &pkm_ctrl::config::FileError) -> PyErr {
    if path.is_file() { value(error.to_string()) } else { os(&path.display().to_string(), error.to_string()) }
}

/// An effect that cannot be put there.
pub(crate) fn effect(error: &EffectError) -> PyErr {
    value(error.to_string())
}

/// A robot that another program cannot have.
pub(crate) fn export(error: &ExportError) -> PyErr {
    value(error.to_string())
}
