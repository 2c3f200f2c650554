//! What a control loop leaves: every period of it, through a ring, on a thread of its own, into MCAP files that survive a crash.
//!
//! The loop puts a [`pkm_hal::cycle::CycleRecord`] into a lock-free ring and never waits; [`spawn`] starts the thread that empties it. A file is cut into
//! chunks that are complete on disk at least every half second ([`Options::flush_ns`]): after a kill what was flushed can be read
//! ([`crate::ReadOptions::recover`]). Files are rotated by size and time. When the disk refuses, recording pauses and goes on in a new
//! file; the loop does not notice. The last seconds are always in memory, and go into a file of their own, the black box, when asked for
//! or when the loop stops because something is wrong.

mod control;
mod file;
mod messages;
mod recorder;
mod store;
mod thread;

pub(crate) use control::encode as encode_control;
pub use control::{Control, ControlStep};
pub use messages::{Message, Messages, Topic};
pub use recorder::{Options, Recorder, Tally};
pub use store::{Folder, Store, Stored};
pub use thread::{Handle, Progress, Tap, spawn};

use crate::error::WriteError;
use crate::mcap::columns::{self, Slot};

/// What the numbers of a record are, and what every file carries besides.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Layout {
    /// Names of the joints, in the order of the axes.
    pub joints: Vec<String>,
    /// Columns of the further sensors, in their order, as in CSV: `q_link.<joint>`, `wrench.<sensor>.fx`, or any name.
    pub sensors: Vec<String>,
    /// What to add to the monotonic clock to have the time of day `[ns]`.
    pub epoch_ns: u64,
    /// robot.toml, URDF, controller.toml, and further metadata keys.
    pub carried: crate::Attachments,
}

impl Layout {
    /// Whether names can be columns.
    ///
    /// # Errors
    /// Names the first that cannot be, or that is there twice.
    fn check(&self, file: &str) -> Result<(), WriteError> {
        let columns: Vec<String> = self.joints.iter().map(|j| format!("q.{j}")).chain(self.sensors.iter().cloned()).collect();
        for (i, column) in columns.iter().enumerate() {
            let is_bad = column.trim() != column || column.is_empty() || column == "q." || column.chars().any(char::is_control);
            if is_bad || columns[..i].contains(column) {
                return Err(WriteError::ColumnName { file: file.to_string(), column: column.clone() });
            }
        }
        Ok(())
    }

    /// Sensors by topic: joints of `JointState` topics and components of wrenches and poses, with the place of each number.
    fn topics(&self) -> Vec<(Slot<'_>, usize)> {
        self.sensors.iter().enumerate().map(|(i, column)| (columns::slot(column), i)).collect()
    }
}
