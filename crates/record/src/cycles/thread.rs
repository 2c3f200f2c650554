//! The thread that empties the ring.

use alloc::sync::Arc;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use core::time::Duration;
use std::sync::{Mutex, PoisonError};
use std::thread::JoinHandle;

use pkm_hal::Clock;
use rtrb::Consumer;

use super::recorder::{Options, Recorder, Tally};
use super::{AsCycle, Cycle, Layout, Store};
use crate::error::WriteError;

/// How long the thread sleeps when the ring is empty.
const PAUSE: Duration = Duration::from_millis(2);

/// Periods between two looks at the clock while the ring is being emptied.
const AT_ONCE: usize = 256;

/// Sees every period on the thread of the recording, before it is written: a live view, say. It must not wait.
pub type Tap = Box<dyn FnMut(&Cycle<'_>) + Send>;

/// What other threads see of a recording.
#[derive(Debug, Default)]
struct Board {
    stop: AtomicBool,
    largest_fill: AtomicU64,
    taken: AtomicU64,
    tally: Mutex<Tally>,
    black_box: Mutex<Option<String>>,
}

/// State of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Progress {
    /// Periods taken from the ring.
    pub taken: u64,
    /// Most periods that were ever in the ring at once.
    pub largest_fill: u64,
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
pub fn spawn<T, C>(
    ring: Consumer<T>,
    store: Box<dyn Store>,
    layout: Layout,
    options: Options,
    clock: C,
    taps: Vec<Tap>,
) -> Result<Handle, WriteError>
where
    T: AsCycle + Clone + Send + 'static,
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
        let largest_fill = self.board.largest_fill.load(Ordering::Relaxed);
        Progress { taken, largest_fill, written, lost, files, black_boxes, is_recording, error }
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

fn empty<T: AsCycle + Clone>(
    mut ring: Consumer<T>,
    mut recorder: Recorder<T>,
    clock: &dyn Clock,
    mut taps: Vec<Tap>,
    board: &Board,
) -> Result<(), WriteError> {
    loop {
        // Looked at before the ring is: what was pushed before the stop is then in it.
        let is_last = board.stop.load(Ordering::Acquire) || ring.is_abandoned();
        let fill = ring.slots();
        board.largest_fill.fetch_max(fill as u64, Ordering::Relaxed);
        let now_ns = clock.now_ns();
        for _ in 0..fill.min(AT_ONCE) {
            let Ok(item) = ring.pop() else { break };
            taps.iter_mut().for_each(|tap| tap(&item.cycle()));
            recorder.push(item, now_ns);
            board.taken.fetch_add(1, Ordering::Relaxed);
        }
        if let Some(reason) = board.black_box.lock().unwrap_or_else(PoisonError::into_inner).take() {
            recorder.black_box(&reason);
        }
        recorder.tick(now_ns);
        recorder.tally().clone_into(&mut board.tally.lock().unwrap_or_else(PoisonError::into_inner));
        if is_last && ring.is_empty() {
            break;
        }
        if fill == 0 {
            std::thread::sleep(PAUSE);
        }
    }
    let (tally, outcome) = recorder.finish(clock.now_ns());
    *board.tally.lock().unwrap_or_else(PoisonError::into_inner) = tally;
    outcome
}
