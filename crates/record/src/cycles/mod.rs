//! What a control loop leaves: every period of it, through a ring, on a thread of its own, into MCAP files that survive a crash.
//!
//! The loop pushes a plain record into a lock-free ring and never waits; [`spawn`] starts the thread that empties it. A file is cut into
//! chunks that are complete on disk at least every half second ([`Options::flush_ns`]): after a kill what was flushed can be read
//! ([`crate::ReadOptions::recover`]). Files are rotated by size and time. When the disk refuses, recording pauses and goes on in a new
//! file; the loop does not notice. The last seconds are always in memory, and go into a file of their own, the black box, when asked for
//! or when a fault flag comes up.

mod control;
mod file;
mod messages;
mod recorder;
mod store;
mod thread;

pub use control::{Control, ControlStep};
pub use recorder::{Options, Recorder, Tally};
pub use store::{Folder, Store, Stored};
pub use thread::{Handle, Progress, Tap, spawn};

use crate::error::WriteError;
use crate::mcap::columns::{self, Slot};

/// One period of a loop, as it is written.
#[derive(Debug, Clone, Copy)]
pub struct Cycle<'a> {
    /// Number of the period, skipped ones included.
    pub number: u64,
    /// The loop's monotonic clock at the sample `[ns]`.
    pub stamp_ns: u64,
    /// Bits whose meaning the [`Layout`] tells.
    pub flags: u32,
    /// Periods that were skipped before this one.
    pub skipped: u32,
    /// How late the loop woke up `[ns]`.
    pub late_ns: u64,
    /// How long it computed `[ns]`.
    pub compute_ns: u64,
    /// Measured positions `[m | rad]`, velocities and efforts, one per joint; NaN where nothing was measured.
    pub q: &'a [f64],
    /// See `q`.
    pub v: &'a [f64],
    /// See `q`.
    pub tau: &'a [f64],
    /// Further sensors, one per entry of [`Layout::sensors`].
    pub sensor: &'a [f64],
    /// Wanted positions `[m | rad]`.
    pub q_ref: &'a [f64],
    /// Wanted velocities.
    pub v_ref: &'a [f64],
    /// Wanted accelerations.
    pub a_ref: &'a [f64],
    /// Efforts that were sent `[N | N·m]`.
    pub tau_cmd: &'a [f64],
    /// The step of the controller, where one was made.
    pub control: Option<Control<'a>>,
}

/// A record that says what happened in a period.
pub trait AsCycle {
    /// The period.
    fn cycle(&self) -> Cycle<'_>;
}

/// What the numbers of a [`Cycle`] are, and what every file carries besides.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Layout {
    /// Names of the joints, in the order of the numbers.
    pub joints: Vec<String>,
    /// Columns of the further sensors, as in CSV: `q_link.<joint>`, `wrench.<sensor>.fx`, or any name.
    pub sensors: Vec<String>,
    /// What the bits of [`Cycle::flags`] mean, from bit 0.
    pub flags: Vec<String>,
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
