//! Backends that need nothing of the workspace but this crate.

#[cfg(feature = "iceoryx2")]
pub mod iceoryx2;
mod loopback;

pub use loopback::Loopback;
