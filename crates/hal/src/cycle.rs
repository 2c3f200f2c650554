//! What a loop reports of itself, once a period: fixed layout, SI units, and a seam to whoever records it.
//!
//! The loop hands a [`CycleRecord`] to a [`CycleSink`], which never makes it wait; a recorder takes them from a [`CycleSource`], in order,
//! and is told how many it missed. With the feature `ring` both ends of a lock-free ring are in [`ring`].

mod cause;
#[cfg(feature = "ring")]
pub mod ring;

use crate::frame::{CommandFrame, MAX_AXES, MAX_SENSORS, Mode, StateFrame, words};

pub use cause::{Cause, Phase, Transition, flags};

words! {
    /// One period of a loop: when what happened, what it saw, what it wanted, what it asked for.
    CycleRecord [StateFrame::LAYOUT ^ CommandFrame::LAYOUT.rotate_left(1)] {
        /// [`Self::LAYOUT`] of the program that wrote it.
        layout: u64, "hash";
        /// Number of the period on the loop's grid; periods that were skipped leave a gap.
        cycle: u64, "1";
        /// When the period was to begin, on the monotonic clock `[ns]`.
        planned_ns: u64, "ns";
        /// When the loop woke `[ns]`.
        woken_ns: u64, "ns";
        /// When it had read the state `[ns]`.
        read_ns: u64, "ns";
        /// When it had computed the command `[ns]`.
        computed_ns: u64, "ns";
        /// When it had handed the command over `[ns]`.
        done_ns: u64, "ns";
        /// Periods that were skipped before this one.
        skipped: u64, "1";
        /// Time since the last period that was not skipped, as controllers saw it `[s]`.
        dt: [f64; 1], "s";
        /// Time from the last measured positions to those of this period, by the stamps of both `[s]`; zero where none came.
        q_dt: [f64; 1], "s";
        /// Time into the motion that is played `[s]`; zero where none is.
        motion_time: [f64; 1], "s";
        /// Code of the [`Phase`] after this period.
        phase: u32, "code";
        /// Code of the [`Cause`] of the last transition.
        cause: u32, "code";
        /// Axis, sensor or component that it was about.
        place: u32, "1";
        /// Bits of [`flags`].
        flags: u32, "bits";
        /// Bit `i`: a limit outside the controller changed the command of drive `i`.
        clipped: u32, "bits";
        /// Bit `i`: limit `i` of the controller's own acted somewhere.
        limited: u32, "bits";
        /// Value that the cause was about, in its own unit.
        value: [f64; 1], "SI";
        /// What it should have been, in the same unit.
        limit: [f64; 1], "SI";
        /// Wanted positions `[m | rad]`.
        q_ref: [f64; MAX_AXES], "m | rad";
        /// Wanted velocities `[m/s | rad/s]`.
        v_ref: [f64; MAX_AXES], "m/s | rad/s";
        /// Wanted accelerations `[m/s² | rad/s²]`.
        a_ref: [f64; MAX_AXES], "m/s^2 | rad/s^2";
        /// Efforts that the model asks for `[N | N·m]`.
        tau_ff: [f64; MAX_AXES], "N | N.m";
        /// Positions that the controller was given: measured, or carried on over a gap `[m | rad]`.
        q_given: [f64; MAX_AXES], "m | rad";
        /// What the controller answered, before anything led over from efforts of before `[N | N·m]`.
        tau_answer: [f64; MAX_AXES], "N | N.m";
        /// Efforts that passed the limits outside the controller `[N | N·m]`.
        tau_sent: [f64; MAX_AXES], "N | N.m";
        /// Measured wrench in the root's axes, force first `[N, N·m]`.
        wrench: [f64; 6], "N, N.m";
        /// Wanted wrench, force first `[N, N·m]`.
        wrench_ref: [f64; 6], "N, N.m";
        /// Newest state that was believed.
        state: StateFrame, "frame";
        /// What was asked of the robot; expired where nothing was.
        command: CommandFrame, "frame";
    }
}

impl CycleRecord {
    /// An empty record for a robot of `n_axes` axes and `n_sensors` sensors (at most [`MAX_AXES`] and [`MAX_SENSORS`]).
    #[must_use]
    pub const fn new(n_axes: usize, n_sensors: usize) -> Self {
        let zero = [0.0; MAX_AXES];
        Self {
            layout: Self::LAYOUT,
            cycle: 0,
            planned_ns: 0,
            woken_ns: 0,
            read_ns: 0,
            computed_ns: 0,
            done_ns: 0,
            skipped: 0,
            dt: [0.0],
            q_dt: [0.0],
            motion_time: [0.0],
            phase: Phase::Off.code(),
            cause: Cause::Started.code(),
            place: 0,
            flags: 0,
            clipped: 0,
            limited: 0,
            value: [0.0],
            limit: [0.0],
            q_ref: zero,
            v_ref: zero,
            a_ref: zero,
            tau_ff: zero,
            q_given: zero,
            tau_answer: zero,
            tau_sent: zero,
            wrench: [0.0; 6],
            wrench_ref: [0.0; 6],
            state: StateFrame::new(n_axes, n_sensors),
            command: CommandFrame::new(n_axes, Mode::Off),
        }
    }

    /// How late the loop woke `[ns]`.
    #[must_use]
    pub const fn wake_late_ns(&self) -> u64 {
        self.woken_ns.saturating_sub(self.planned_ns)
    }

    /// How long it took from waking to the command handed over `[ns]`.
    #[must_use]
    pub const fn busy_ns(&self) -> u64 {
        self.done_ns.saturating_sub(self.woken_ns)
    }

    /// How long it took to compute the command `[ns]`.
    #[must_use]
    pub const fn compute_ns(&self) -> u64 {
        self.computed_ns.saturating_sub(self.read_ns)
    }

    /// Age of the state when the command that answers it was handed over `[ns]`: from sensor to drive.
    #[must_use]
    pub const fn end_to_end_ns(&self) -> u64 {
        self.done_ns.saturating_sub(self.state.stamp_ns)
    }
}

const _: () = assert!(MAX_SENSORS <= 32, "validity of sensors is 32 bits");

/// Where a loop leaves its records. It is called in the loop: it neither waits nor allocates.
pub trait CycleSink {
    /// Takes a record, or loses and counts it.
    fn put(&mut self, record: &CycleRecord);
}

/// Nobody records.
impl CycleSink for () {
    fn put(&mut self, _: &CycleRecord) {}
}

/// Somebody may record.
impl<S: CycleSink> CycleSink for Option<S> {
    fn put(&mut self, record: &CycleRecord) {
        if let Some(sink) = self {
            sink.put(record);
        }
    }
}

/// Both get every record.
impl<A: CycleSink, B: CycleSink> CycleSink for (A, B) {
    fn put(&mut self, record: &CycleRecord) {
        self.0.put(record);
        self.1.put(record);
    }
}

impl<S: CycleSink + ?Sized> CycleSink for &mut S {
    fn put(&mut self, record: &CycleRecord) {
        (**self).put(record);
    }
}

/// Where a recorder takes them from.
pub trait CycleSource {
    /// The oldest record that was not taken yet.
    fn take(&mut self) -> Option<CycleRecord>;

    /// Records that were lost so far because nobody took the ones before in time.
    fn lost(&self) -> u64;

    /// Whether the loop has ended: what can be taken now is all there will be.
    fn is_closed(&self) -> bool;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_lead_back_to_the_record_with_its_frames() {
        let mut record = CycleRecord::new(3, 6);
        (record.cycle, record.skipped, record.place, record.wrench[5], record.dt) = (u64::MAX, 2, 7, -1e-300, [0.25]);
        record.state.q[2] = 0.125;
        record.state = record.state.sealed();
        record.command.tau[15] = 3.0;
        let back = CycleRecord::from_bytes(&record.to_bytes());
        assert_eq!(back, record);
        assert_eq!(back.state.check(), Ok(()));
        assert!(CycleRecord::FIELDS.contains("; wrench: [f64; 6] [N, N.m]"));
    }

    #[test]
    fn times_are_differences_that_never_wrap() {
        let mut record = CycleRecord::new(1, 0);
        (record.planned_ns, record.woken_ns, record.read_ns, record.computed_ns, record.done_ns) = (100, 130, 140, 190, 200);
        record.state.stamp_ns = 95;
        let all = |r: &CycleRecord| [r.wake_late_ns(), r.compute_ns(), r.busy_ns(), r.end_to_end_ns()];
        assert_eq!(all(&record), [30, 50, 70, 105]);
        (record.woken_ns, record.computed_ns, record.state.stamp_ns) = (90, 100, 300);
        assert_eq!(all(&record), [0, 0, 110, 0]);
    }
}
