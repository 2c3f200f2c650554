//! Backends that need nothing but this crate.

mod loopback;

pub use loopback::Loopback;
