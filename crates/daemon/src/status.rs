//! What a daemon says of itself, as JSON.

use pkm_hal::cycle::flags;
use pkm_hal::{Cause, CycleRecord, Phase, Transition};
use serde::{Deserialize, Serialize};

use crate::histogram::LatencySummary;
use crate::realtime::Grants;

/// Transitions that are remembered.
pub const REMEMBERED: usize = 32;

/// A change of phase, in words.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Told {
    /// Number of the period.
    pub cycle: u64,
    /// When, on the monotonic clock `[s]`.
    pub at_s: f64,
    /// From which phase.
    pub from: String,
    /// To which.
    pub to: String,
    /// Why.
    pub cause: String,
    /// Which axis, sensor or component.
    pub place: u32,
    /// The value, in the unit of its cause.
    pub value: f64,
    /// What it should have been.
    pub limit: f64,
}

impl Told {
    /// `transition` in words.
    #[must_use]
    pub fn new(transition: &Transition) -> Self {
        let Transition { cycle, at_ns, from, to, cause, place, value, limit } = *transition;
        // JSON has no other numbers.
        let finite = |x: f64| if x.is_finite() { x } else { 0.0 };
        let [from, to] = [from, to].map(|phase| phase.name().to_string());
        let (cause, value, limit) = (cause.name().to_string(), finite(value), finite(limit));
        Self { cycle, at_s: at_ns as f64 * 1e-9, from, to, cause, place, value, limit }
    }
}

impl core::fmt::Display for Told {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { cycle, at_s, from, to, cause, place, value, limit } = self;
        write!(f, "{at_s:.6} s, period {cycle}: {from} -> {to}, {cause}")?;
        if *value != 0.0 || *limit != 0.0 {
            write!(f, " at {place}: {value:.6} (limit {limit:.6})")?;
        }
        Ok(())
    }
}

/// A recording that runs.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct RecordingStatus {
    /// Whether a file is open; one that is not is tried again.
    pub is_recording: bool,
    /// Periods in its files.
    pub periods: u64,
    /// Its files.
    pub files: u64,
    /// Periods that are in none: the disk refused them, or was so slow that there was no room for them.
    pub lost: u64,
    /// What the disk said last, if it has not taken anything since.
    pub error: Option<String>,
}

impl core::fmt::Display for RecordingStatus {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { is_recording, periods, files, lost, error } = self;
        let state = if *is_recording { "recording" } else { "recording paused" };
        write!(f, "{state}: {periods} periods in {files} files, {lost} lost")?;
        error.as_ref().map_or(Ok(()), |error| write!(f, "; {error}"))
    }
}

/// Everything that `pkm status` shows.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Status {
    /// Process of the daemon.
    pub pid: u32,
    /// Robot.
    pub robot: String,
    /// Law of the controller that runs or would run.
    pub law: String,
    /// What is being done.
    pub phase: String,
    /// Why.
    pub cause: String,
    /// Whether a session with the robot is open.
    pub is_armed: bool,
    /// Periods of the loop that ran.
    pub periods: u64,
    /// Periods that were skipped.
    pub skipped: u64,
    /// Periods that ended late.
    pub overruns: u64,
    /// Period `[s]`.
    pub period_s: f64,
    /// Time into the motion `[s]`.
    pub motion_time_s: f64,
    /// Age of the newest state when it was last looked at `[s]`.
    pub state_age_s: f64,
    /// Positions `[m | rad]`.
    pub q: Vec<f64>,
    /// Wanted positions `[m | rad]`.
    pub q_ref: Vec<f64>,
    /// Efforts sent `[N | N·m]`.
    pub tau: Vec<f64>,
    /// Records that nobody took in time.
    pub records_lost: u64,
    /// What becomes of the recording, where there is one.
    pub recording: Option<RecordingStatus>,
    /// Black boxes written, the newest last.
    pub black_boxes: Vec<String>,
    /// Latencies.
    pub latency: LatencySummary,
    /// What the operating system gave.
    pub realtime: Grants,
    /// The last changes of phase, the newest last.
    pub transitions: Vec<Told>,
}

impl Status {
    /// Takes over what a record says.
    pub fn note(&mut self, record: &CycleRecord) {
        let n = record.state.n_axes as usize;
        self.phase = Phase::of(record.phase).map_or_else(String::new, |phase| phase.name().to_string());
        self.cause = Cause::of(record.cause).map_or_else(String::new, |cause| cause.name().to_string());
        self.is_armed = record.flags & flags::ARMED != 0;
        self.motion_time_s = record.motion_time[0];
        self.state_age_s = record.read_ns.saturating_sub(record.state.stamp_ns) as f64 * 1e-9;
        let finite = |x: &[f64]| x.iter().take(n).map(|x| if x.is_finite() { *x } else { 0.0 }).collect();
        (self.q, self.q_ref, self.tau) = (finite(&record.state.q), finite(&record.q_ref), finite(&record.tau_sent));
    }

    /// Counts a record.
    pub const fn count(&mut self, record: &CycleRecord) {
        self.periods += 1;
        self.skipped += record.skipped;
        self.overruns += (record.flags & flags::OVERRUN != 0) as u64;
    }
}
