//! What travels as bytes when Python pickles: CBOR, which keeps every bit of a number and the names of fields.

use pyo3::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error;

/// The bytes of a state.
pub(crate) fn to_bytes<T: Serialize>(state: &T) -> PyResult<Vec<u8>> {
    let mut bytes = Vec::new();
    ciborium::into_writer(state, &mut bytes).map_err(|e| error::value(format!("pickle: {e}")))?;
    Ok(bytes)
}

/// The state behind the bytes; `what` is for the message.
pub(crate) fn from_bytes<T: DeserializeOwned>(what: &str, bytes: &[u8]) -> PyResult<T> {
    ciborium::from_reader(bytes).map_err(|e| error::value(format!("pickle of {what}: {e} (written by another version of pkm?)")))
}
