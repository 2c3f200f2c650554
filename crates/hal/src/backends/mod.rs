//! Backends that need nothing of the workspace but this crate.

pub mod cia402;
#[cfg(feature = "iceoryx2")]
pub mod iceoryx2;
mod loopback;
pub mod recorded;

pub use loopback::Loopback;
pub use recorded::Recorded;
