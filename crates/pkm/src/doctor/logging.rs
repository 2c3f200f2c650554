//! What the disk takes: periods of twelve axes into files as fast as it goes, and at 4 kHz beside a loop that must lose none.

use core::time::Duration;

use pkm_daemon::Grid;
use pkm_daemon::runner::Pace;
use pkm_hal::cycle::ring::ring;
use pkm_hal::cycle::{CycleRecord, CycleSink, flags};
use pkm_hal::frame::first_bits;
use pkm_hal::{Clock, SystemClock};
use pkm_record::cycles::{Folder, Layout, Options, Recorder, spawn};

/// The most that the fastest loops have.
const AXES: usize = 12;

/// Four thousand periods a second `[ns]`.
const PERIOD_NS: u64 = 250_000;

/// What a disk is filled with at the most `[bytes]`, and for how long `[ns]`.
const MOST_BYTES: u64 = 512 << 20;
const LONGEST_NS: u64 = 2_000_000_000;

/// Periods between two looks at the clock, as fast as it goes.
const BATCH: u64 = 256;

/// Periods that wait for the disk: two seconds, as in a daemon.
const ROOM: usize = 8192;

/// What was recorded.
pub(super) struct Logging {
    /// As fast as it goes: periods and bytes a second.
    pub(super) periods_per_s: f64,
    pub(super) bytes_per_s: f64,
    /// At 4 kHz: periods, and those that are in no file.
    pub(super) paced: u64,
    pub(super) lost: u64,
}

/// Both, in a folder of the system's temporary files; the second for `length`.
pub(super) fn measure(length: Duration) -> anyhow::Result<Logging> {
    let length_ns = u64::try_from(length.as_nanos()).unwrap_or(u64::MAX);
    let (periods_per_s, bytes_per_s) = as_fast_as_it_goes(length_ns.min(LONGEST_NS))?;
    let (paced, lost) = beside_a_loop(length_ns)?;
    Ok(Logging { periods_per_s, bytes_per_s, paced, lost })
}

/// A robot whose numbers are no two alike: they pack as those of a real one do, not better.
struct Moving {
    record: CycleRecord,
    phase: f64,
}

impl Moving {
    fn new() -> Self {
        let mut record = CycleRecord::new(AXES, 0);
        record.flags = flags::NEW_STATE | flags::COMMANDED;
        let all = first_bits(AXES);
        (record.state.valid_q, record.state.valid_v, record.state.valid_tau) = (all, all, all);
        Self { record, phase: 0.0 }
    }

    fn next(&mut self) -> &CycleRecord {
        // An irrational part of a turn a period.
        self.phase = (self.phase + 0.001_618_033_988_749_895).fract();
        let CycleRecord { state, q_ref, tau_sent, .. } = &mut self.record;
        for (axis, q) in state.q.iter_mut().enumerate().take(AXES) {
            let wave = (self.phase + 0.083 * axis as f64).fract();
            (*q, state.v[axis], state.tau[axis], q_ref[axis]) = (wave * (1.0 - wave), 1.0 - 2.0 * wave, wave * 7.3, wave * wave);
            tau_sent[axis] = state.tau[axis] / 3.0;
        }
        self.record.cycle += 1;
        self.record.planned_ns = self.record.cycle * PERIOD_NS;
        self.record.state.stamp_ns = self.record.planned_ns;
        &self.record
    }
}

fn layout() -> Layout {
    Layout { joints: (1..=AXES).map(|k| format!("axis{k}")).collect(), ..Layout::default() }
}

fn as_fast_as_it_goes(length_ns: u64) -> anyhow::Result<(f64, f64)> {
    let folder = tempfile::tempdir()?;
    let options = Options { keep_cycles: 0, after_cycles: 0, ..Options::default() };
    let begin_ns = SystemClock.now_ns();
    let mut recorder = Recorder::begin(Box::new(Folder::new(folder.path())), layout(), options, begin_ns)?;
    let (mut robot, mut periods, mut bytes) = (Moving::new(), 0, 0);
    while SystemClock.now_ns().saturating_sub(begin_ns) < length_ns && bytes < MOST_BYTES {
        for _ in 0..BATCH {
            let now_ns = SystemClock.now_ns();
            recorder.push(robot.next(), now_ns);
            recorder.tick(now_ns);
        }
        periods += BATCH;
        bytes = size(folder.path())?;
    }
    let (tally, outcome) = recorder.finish(SystemClock.now_ns());
    outcome?;
    let seconds = SystemClock.now_ns().saturating_sub(begin_ns) as f64 * 1e-9;
    anyhow::ensure!(tally.written == periods, "{} of {periods} periods written", tally.written);
    Ok((periods as f64 / seconds, size(folder.path())? as f64 / seconds))
}

fn beside_a_loop(length_ns: u64) -> anyhow::Result<(u64, u64)> {
    let folder = tempfile::tempdir()?;
    let (mut sink, source) = ring(ROOM);
    let handle = spawn(source, Box::new(Folder::new(folder.path())), layout(), Options::default(), SystemClock, Vec::new())?;
    let (mut robot, begin_ns) = (Moving::new(), SystemClock.now_ns());
    let mut grid = Grid::new(begin_ns, PERIOD_NS);
    while SystemClock.now_ns().saturating_sub(begin_ns) < length_ns {
        // Periods that the machine lets pass are recorded all the same: the disk is asked, not the scheduler.
        SystemClock.sleep_until(grid.beat().planned_ns);
        sink.put(robot.next());
        grid.done(grid.beat().planned_ns);
    }
    let periods = robot.record.cycle;
    drop(sink);
    let (progress, outcome) = handle.finish();
    outcome?;
    Ok((periods, periods - progress.written))
}

fn size(folder: &std::path::Path) -> anyhow::Result<u64> {
    std::fs::read_dir(folder)?.map(|entry| Ok(entry?.metadata()?.len())).sum()
}
