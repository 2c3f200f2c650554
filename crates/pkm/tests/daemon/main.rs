//! Daemon and driver as processes: killed, stopped, started twice, started over what a killed one has left.
#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on fails, outside #[test] functions too")]

mod exercise;
mod full;
#[cfg(feature = "live")]
mod live;
mod owners;
mod service;
mod signals;
mod site;
mod soak;
mod starts;
mod stops;
mod summaries;
mod watch;
