//! The thread that empties the ring.

use alloc::sync::Arc;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use core::time::Duration;
use std::sync::{Mutex, PoisonError};
use std::thread::JoinHandle;

use pkm_hal::Clock;
use pkm_hal::cycle::{CycleRecord, CycleSource};

use super::recorder::{Options, Recorder, Tally};
use super::{Layout, Store};
use crate::error::WriteError;

/// How long the thread sleeps when the ring is empty.
const PAUSE: Duration = Duration::from_millis(2);

/// Periods between two looks at the clock while the ring is being emptied.
const AT_ONCE: u64 = 256;

/// Sees every period on the thread of the recording, before it is written: a live view, say. It must not wait.
pub type Tap = Box<dyn FnMut(&CycleRecord) + Send>;

/// What other threads see of a recording.
#[derive(Debug, Default)]
struct Board {
    stop: AtomicBool,
    taken: AtomicU64,
    dropped: AtomicU64,
    tally: Mutex<Tally>,
    black_box: Mutex<Option<String>>,
}

/// State of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Progress {
    /// Periods taken from the ring.
    pub taken: u64,
    /// Periods that found no room in the ring.
    pub dropped: u64,
    /// Periods in complete chunks.
    pub written: u64,
    /// Periods that came while the disk refused, or were in a chunk that failed.
    pub lost: u64,
    /// Files begun.
    pub files: u64,
    /// Black boxes written.
    pub black_boxes: u64,
    /// Whether a file is open.
    pub is_recording: bool,
    /// What the disk said last, if it has not taken anything since.
    pub error: Option<String>,
}

/// A recording that runs; dropping it ends it.
#[derive(Debug)]
pub struct Handle {
    board: Arc<Board>,
    thread: Option<JoinHandle<Result<(), WriteError>>>,
}

/// Starts the thread that empties `ring` into files of `store`; the first is begun before this returns.
///
/// `clock` may be any that runs in real time. The loop should have its ring hold some seconds: so long may a disk take.
///
/// # Errors
/// As [`Recorder::begin`]; a system that gives no thread.
pub fn spawn<R, C>(ring: R, store: Box<dyn Store>, layout: Layout, options: Options, clock: C, taps: Vec<Tap>) -> Result<Handle, WriteError>
where
    R: CycleSource + Send + 'static,
    C: Clock + Send + 'static,
{
    let stem = options.stem.clone();
    let recorder = Recorder::begin(store, layout, options, clock.now_ns())?;
    let board = Arc::new(Board::default());
    let of_thread = Arc::clone(&board);
    let thread = std::thread::Builder::new()
        .name("pkm-record".to_string())
        .spawn(move || empty(ring, recorder, &clock, taps, &of_thread))
        .map_err(|e| WriteError::Io { file: stem, detail: e.to_string() })?;
    Ok(Handle { board, thread: Some(thread) })
}

impl Handle {
    /// How it goes.
    #[must_use]
    pub fn progress(&self) -> Progress {
        let tally = self.board.tally.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let Tally { written, lost, files, black_boxes, is_recording, error } = tally;
        let taken = self.board.taken.load(Ordering::Relaxed);
        let dropped = self.board.dropped.load(Ordering::Relaxed);
        Progress { taken, dropped, written, lost, files, black_boxes, is_recording, error }
    }

    /// Whether the thread still runs.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// Asks for a black box, whose metadata say why.
    pub fn black_box(&self, reason: &str) {
        *self.board.black_box.lock().unwrap_or_else(PoisonError::into_inner) = Some(reason.to_string());
    }

    /// Writes what is in the ring, ends the file, and tells what became of it all.
    ///
    /// # Errors
    /// What the disk said last, if the end of the recording is not on it.
    pub fn finish(mut self) -> (Progress, Result<(), WriteError>) {
        let outcome = self.stop();
        (self.progress(), outcome)
    }

    fn stop(&mut self) -> Result<(), WriteError> {
        self.board.stop.store(true, Ordering::Release);
        let Some(thread) = self.thread.take() else { return Ok(()) };
        thread.join().unwrap_or_else(|_| Err(WriteError::Io { file: "recording".to_string(), detail: "its thread panicked".to_string() }))
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        // Nobody is left to be told.
        let _ = self.stop();
    }
}

fn empty(
    mut ring: impl CycleSource,
    mut recorder: Recorder,
    clock: &dyn Clock,
    mut taps: Vec<Tap>,
    board: &Board,
) -> Result<(), WriteError> {
    loop {
        // Looked at before the ring is: what was put in before the end is then found.
        let is_last = board.stop.load(Ordering::Acquire) || ring.is_closed();
        let now_ns = clock.now_ns();
        let mut taken = 0;
        while taken < AT_ONCE
            && let Some(record) = ring.take()
        {
            taps.iter_mut().for_each(|tap| tap(&record));
            recorder.push(&record, now_ns);
            taken += 1;
        }
        board.taken.fetch_add(taken, Ordering::Relaxed);
        board.dropped.store(ring.lost(), Ordering::Relaxed);
        if let Some(reason) = board.black_box.lock().unwrap_or_else(PoisonError::into_inner).take() {
            recorder.black_box(&reason);
        }
        recorder.tick(now_ns);
        recorder.tally().clone_into(&mut board.tally.lock().unwrap_or_else(PoisonError::into_inner));
        if taken == 0 {
            if is_last {
                break;
            }
            std::thread::sleep(PAUSE);
        }
    }
    let (tally, outcome) = recorder.finish(clock.now_ns());
    *board.tally.lock().unwrap_or_else(PoisonError::into_inner) = tally;
    outcome
}
