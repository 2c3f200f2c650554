//! What travels as bytes when Python pickles: TOML, whose numbers keep every bit and may be none, and whose fields have names.

use pyo3::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error;

/// The bytes of a state.
pub(crate) fn to_bytes<T: Serialize>(state: &T) -> PyResult<Vec<u8>> {
    Ok(toml::to_string(state).map_err(|e| error::value(format!("pickle: {e}")))?.into_bytes())
}

/// The state behind the bytes; `what` is for the message.
pub(crate) fn from_bytes<T: DeserializeOwned>(what: &str, bytes: &[u8]) -> PyResult<T> {
    let damaged = |why: &str| error::value(format!("pickle of {what}: {why} (damaged, or written by another version of pkm)"));
    let text = core::str::from_utf8(bytes).map_err(|_| damaged("not UTF-8"))?;
    toml::from_str(text).map_err(|e| damaged(&e.message().split_whitespace().collect::<Vec<_>>().join(" ")))
}
