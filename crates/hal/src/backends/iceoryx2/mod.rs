//! A robot in another process, over shared memory by iceoryx2: states one way, commands the other, neither side ever waiting.
//!
//! Each side owns the service it publishes on and may be the only publisher; the other side only opens it. Both live in a [`Place`], a
//! directory that nobody else may look into, and each holds a lock there while it runs. Frames are written into shared memory as their
//! little-endian bytes and read back with their layout, checksum and numbers checked: what a stranger scribbles is refused and counted.
//! Whether the other side lives is judged by the age of what it sent, never by what the library says of its nodes: a process that is stopped
//! is alive to the library. A command says itself until when it is valid; [`crate::Watchdog`] on the robot's side sees to it.
//!
//! Processes killed while a service was being made can leave it locked for good. `service::own` mends that: dead nodes are cleaned
//! away, then the service is removed where no other process can be using it, then it gets a new number, which the other side finds in the
//! place. Nothing has to be deleted by hand.

mod driver;
mod place;
mod probe;
mod robot;
mod service;

pub use driver::{Served, SharedDriver};
pub use place::{Lock, Place, Role, SharedError};
pub use probe::ping_pong;
pub use robot::{Received, SharedRobot};
pub use service::Mended;

use ::iceoryx2::prelude::{ZeroCopySend, set_log_level};

use crate::frame::{CommandFrame, StateFrame};

/// Samples that wait for a reader who is late; older ones make room.
const BUFFER: usize = 16;

/// A state as it stands in shared memory.
#[derive(Debug, Clone, Copy, ZeroCopySend)]
#[repr(C)]
#[type_name("pkm.StateFrame.1")]
struct StateSlot {
    bytes: [u8; StateFrame::BYTES],
}

/// A command as it stands in shared memory.
#[derive(Debug, Clone, Copy, ZeroCopySend)]
#[repr(C)]
#[type_name("pkm.CommandFrame.1")]
struct CommandSlot {
    bytes: [u8; CommandFrame::BYTES],
}

/// Keeps the library from telling what is told here in one line.
fn silence() {
    set_log_level(::iceoryx2::prelude::LogLevel::Fatal);
}
