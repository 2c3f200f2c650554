//! The state of a recording: files one after the other, pauses when the disk refuses, the last seconds in memory.

use alloc::collections::{BTreeMap, VecDeque};
use std::io;

use ::mcap::McapError;
use pkm_hal::cycle::{Cause, CycleRecord, Phase};

use super::Layout;
use super::file::CycleFile;
use super::store::Store;
use crate::error::WriteError;

/// Longest a failed disk is left alone before it is tried again `[ns]`.
const RETRY_LONGEST_NS: u64 = 30_000_000_000;

/// Names of files that are tried before a folder counts as full of them.
const NAMES: u32 = 1_000_000;

/// When files are flushed, synced and rotated, and what the black box holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Options {
    /// Name of the files without number and extension.
    pub stem: String,
    /// A chunk is complete in the file after this time at the latest `[ns]`.
    pub flush_ns: u64,
    /// A chunk is complete when it holds so much, before compression `[bytes]`.
    pub flush_bytes: u64,
    /// The medium is asked to keep what it was given this often `[ns]`.
    pub sync_ns: u64,
    /// A new file after this time `[ns]`.
    pub rotate_ns: u64,
    /// A new file after this much, before compression `[bytes]`.
    pub rotate_bytes: u64,
    /// Periods that are kept in memory for the black box.
    pub keep_cycles: usize,
    /// Periods after the trigger that still go into the black box.
    pub after_cycles: usize,
}

impl Default for Options {
    /// Chunks of a quarter second or 4 MiB, synced every second; files of ten minutes or 1 GiB; 5 s of 1 kHz before a fault and half a second after.
    fn default() -> Self {
        Self {
            stem: "cycles".to_string(),
            flush_ns: 250_000_000,
            flush_bytes: 4 << 20,
            sync_ns: 1_000_000_000,
            rotate_ns: 600_000_000_000,
            rotate_bytes: 1 << 30,
            keep_cycles: 5000,
            after_cycles: 500,
        }
    }
}

/// What became of the periods so far.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Tally {
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
    /// What the disk said last.
    pub error: Option<String>,
}

/// A black box that still waits for what happens after its trigger.
struct Pending {
    reason: String,
    left: usize,
}

/// A recording without a thread: give it periods and the time.
pub struct Recorder {
    store: Box<dyn Store>,
    layout: Layout,
    options: Options,
    file: Option<CycleFile>,
    index: u32,
    opened_ns: u64,
    flushed_ns: u64,
    synced_ns: u64,
    file_bytes: u64,
    /// When to try again, and how long to wait after the next failure `[ns]`.
    retry: (u64, u64),
    kept: VecDeque<CycleRecord>,
    pending: Option<Pending>,
    /// Whether the loop had stopped in the last period.
    was_stopped: bool,
    tally: Tally,
}

impl Recorder {
    /// Begins the first file at `now_ns` `[ns]`, of any clock that the later calls use as well.
    ///
    /// # Errors
    /// Names that cannot be columns; a store that refuses: what could not be recorded from the start is told at the start.
    pub fn begin(store: Box<dyn Store>, layout: Layout, options: Options, now_ns: u64) -> Result<Self, WriteError> {
        let mut recorder = Self {
            kept: VecDeque::with_capacity(options.keep_cycles + options.after_cycles),
            store,
            layout,
            options,
            file: None,
            index: 0,
            opened_ns: now_ns,
            flushed_ns: now_ns,
            synced_ns: now_ns,
            file_bytes: 0,
            retry: (now_ns, 0),
            pending: None,
            was_stopped: false,
            tally: Tally::default(),
        };
        recorder.layout.check(&recorder.store.display(&recorder.options.stem))?;
        match recorder.open(now_ns) {
            Ok(()) => Ok(recorder),
            Err((file, e)) => Err(WriteError::Io { file, detail: told(&e) }),
        }
    }

    /// What became of the periods so far.
    #[must_use]
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// What every file carries.
    #[must_use]
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Takes a period.
    pub fn push(&mut self, record: &CycleRecord, now_ns: u64) {
        match self.file.as_mut().map(|file| file.push(record)) {
            None => self.tally.lost += 1,
            Some(Ok(())) => {}
            Some(Err(e)) => self.fail(&told(&e), now_ns),
        }
        self.keep(record);
        if self.file.as_ref().is_some_and(|file| file.pending_bytes >= self.options.flush_bytes) {
            self.flush(now_ns);
        }
    }

    /// Flushes, syncs, rotates and tries again, whatever is due at `now_ns` `[ns]`. Call it at least every tenth of a second.
    pub fn tick(&mut self, now_ns: u64) {
        if self.file.is_none() {
            if now_ns >= self.retry.0
                && let Err((_, e)) = self.open(now_ns)
            {
                self.refused(&told(&e), now_ns);
            }
            return;
        }
        if now_ns.saturating_sub(self.flushed_ns) >= self.options.flush_ns {
            self.flush(now_ns);
        }
        if now_ns.saturating_sub(self.synced_ns) >= self.options.sync_ns {
            self.synced_ns = now_ns;
            if let Some(Err(e)) = self.file.as_mut().map(CycleFile::sync) {
                self.fail(&e.to_string(), now_ns);
            }
        }
        let is_old = now_ns.saturating_sub(self.opened_ns) >= self.options.rotate_ns;
        if self.file.is_some() && (is_old || self.file_bytes >= self.options.rotate_bytes) {
            self.close(now_ns);
            if let Err((_, e)) = self.open(now_ns) {
                self.refused(&told(&e), now_ns);
            }
        }
    }

    /// Writes the last periods into a file of their own when those after now have come, at once when there are none to come.
    pub fn black_box(&mut self, reason: &str) {
        if self.pending.is_none() {
            self.pending = Some(Pending { reason: reason.to_string(), left: self.options.after_cycles });
        }
        if self.options.after_cycles == 0 {
            self.write_black_box();
        }
    }

    /// Ends the recording: the file gets its summary, a black box that waits is written.
    ///
    /// # Errors
    /// What the disk says; what was flushed before can be recovered.
    pub fn finish(mut self, now_ns: u64) -> (Tally, Result<(), WriteError>) {
        self.write_black_box();
        let name = self.name(self.index);
        let had_file = self.file.is_some();
        self.close(now_ns);
        let is_lost = had_file && !self.tally.is_recording && self.tally.error.is_some();
        let outcome = match (&self.tally.error, is_lost) {
            (Some(e), true) => Err(WriteError::Io { file: self.store.display(&name), detail: e.clone() }),
            _ => Ok(()),
        };
        self.tally.is_recording = false;
        (self.tally, outcome)
    }

    fn name(&self, index: u32) -> String {
        format!("{}_{index:04}.mcap", self.options.stem)
    }

    /// Begins the next file whose name is free.
    fn open(&mut self, now_ns: u64) -> Result<(), (String, McapError)> {
        let keys = BTreeMap::from([("file".to_string(), (self.tally.files + 1).to_string())]);
        let (index, file) = self.begin_file("", self.index + 1, &keys)?;
        self.index = index;
        self.file = Some(file);
        (self.opened_ns, self.flushed_ns, self.file_bytes) = (now_ns, now_ns, 0);
        self.tally.files += 1;
        self.tally.is_recording = true;
        Ok(())
    }

    /// A file of the first free name from a number on; a failure comes with the name.
    fn begin_file(&mut self, kind: &str, from: u32, keys: &BTreeMap<String, String>) -> Result<(u32, CycleFile), (String, McapError)> {
        let mut last = String::new();
        for index in from..from.saturating_add(NAMES) {
            let name = format!("{}{kind}_{index:04}.mcap", self.options.stem);
            let shown = self.store.display(&name);
            match self.store.create(&name) {
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => last = shown,
                Err(e) => return Err((shown, e.into())),
                Ok(stored) => {
                    return match CycleFile::begin(stored, &self.layout, keys) {
                        Ok(file) => Ok((index, file)),
                        Err(e) => {
                            self.store.discard(&name);
                            Err((shown, e))
                        }
                    };
                }
            }
        }
        Err((last, McapError::Io(io::ErrorKind::AlreadyExists.into())))
    }

    fn flush(&mut self, now_ns: u64) {
        let Some(file) = self.file.as_mut() else { return };
        self.flushed_ns = now_ns;
        let bytes = file.pending_bytes;
        match file.flush() {
            Ok(periods) => {
                self.tally.written += periods;
                self.file_bytes += bytes;
                if periods > 0 {
                    // The disk takes again: a next failure is a new one.
                    self.retry.1 = 0;
                    self.tally.error = None;
                }
            }
            Err(e) => self.fail(&told(&e), now_ns),
        }
    }

    fn close(&mut self, now_ns: u64) {
        self.flush(now_ns);
        let Some(file) = self.file.as_mut() else { return };
        let finished = file.finish().and_then(|()| Ok(file.sync()?));
        match finished {
            Ok(()) => self.file = None,
            Err(e) => self.fail(&told(&e), now_ns),
        }
    }

    /// The file is given up: the format has no way to go on behind a chunk that is cut.
    fn fail(&mut self, what: &str, now_ns: u64) {
        if let Some(file) = self.file.take() {
            self.tally.lost += file.pending;
        }
        self.refused(what, now_ns);
    }

    fn refused(&mut self, what: &str, now_ns: u64) {
        self.tally.is_recording = false;
        self.tally.error = Some(what.to_string());
        let wait = (self.retry.1 * 2).clamp(1_000_000_000, RETRY_LONGEST_NS);
        self.retry = (now_ns.saturating_add(wait), wait);
    }

    /// Keeps the period in memory, and begins or ends a black box.
    fn keep(&mut self, record: &CycleRecord) {
        let most = self.options.keep_cycles + self.options.after_cycles;
        if most > 0 {
            if self.kept.len() >= most {
                self.kept.pop_front();
            }
            self.kept.push_back(*record);
        }
        let is_due = self.pending.as_mut().is_some_and(|pending| {
            pending.left = pending.left.saturating_sub(1);
            pending.left == 0
        });
        if is_due {
            self.write_black_box();
        }
        let is_stopped = matches!(Phase::of(record.phase), Some(Phase::SafeStop | Phase::Fault));
        if is_stopped && !self.was_stopped {
            self.black_box(&reason(record));
        }
        self.was_stopped = is_stopped;
    }

    fn write_black_box(&mut self) {
        let Some(pending) = self.pending.take() else { return };
        let keys = BTreeMap::from([("reason".to_string(), pending.reason)]);
        let begun = self.begin_file("_blackbox", 1, &keys);
        let written = begun.map_err(|(_, e)| e).and_then(|(_, mut file)| {
            for record in &self.kept {
                file.push(record)?;
            }
            file.finish()?;
            Ok(file.sync()?)
        });
        match written {
            Ok(()) => self.tally.black_boxes += 1,
            Err(e) => self.tally.error = Some(format!("black box: {}", told(&e))),
        }
    }
}

/// What the disk says; the library's own word for it says nothing.
fn told(error: &McapError) -> String {
    match error {
        McapError::Io(e) => e.to_string(),
        other => other.to_string(),
    }
}

/// Why the loop stopped, in words.
fn reason(record: &CycleRecord) -> String {
    let cause = Cause::of(record.cause).map_or_else(|| format!("cause {}", record.cause), |cause| cause.name().to_string());
    format!("{cause} in cycle {}: place {}, value {}, limit {}", record.cycle, record.place, record.value[0], record.limit[0])
}
