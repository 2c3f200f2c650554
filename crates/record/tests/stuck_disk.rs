//! A disk that takes its time over what it is to keep: the loop does not wait, the ring holds what comes meanwhile, what finds no room is counted.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

extern crate alloc;

use alloc::sync::Arc;
use core::time::Duration;
use std::io::{self, Write};
use std::sync::{Condvar, Mutex};

use pkm_hal::cycle::{CycleRecord, CycleSink, flags, ring::ring};
use pkm_hal::{Clock, MonotonicClock};
use pkm_record::ReadOptions;
use pkm_record::cycles::{Layout, Options, Store, Stored, spawn};

/// Eight seconds of a loop of 1 kHz.
const ROOM: usize = 8000;

/// Longest wait for what must come.
const PATIENCE_NS: u64 = 120_000_000_000;

/// A disk whose sync waits for as long as it is shut.
#[derive(Default)]
struct Disk {
    bytes: Mutex<Vec<u8>>,
    is_shut: Mutex<bool>,
    /// Syncs that had to wait.
    waiting: Mutex<u32>,
    opened: Condvar,
}

#[derive(Clone)]
struct Handle(Arc<Disk>);

impl Write for Handle {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        self.0.bytes.lock().unwrap().extend(buffer);
        Ok(buffer.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Stored for Handle {
    fn sync(&mut self) -> io::Result<()> {
        let shut = self.0.is_shut.lock().unwrap();
        if *shut {
            *self.0.waiting.lock().unwrap() += 1;
            drop(self.0.opened.wait_while(shut, |is_shut| *is_shut).unwrap());
        }
        Ok(())
    }
}

impl Store for Handle {
    fn create(&mut self, _: &str) -> io::Result<Box<dyn Stored>> {
        Ok(Box::new(self.clone()))
    }

    fn discard(&mut self, _: &str) {}

    fn display(&self, name: &str) -> String {
        name.to_string()
    }
}

fn record(cycle: u64) -> CycleRecord {
    let mut out = CycleRecord::new(1, 0);
    (out.cycle, out.planned_ns, out.flags) = (cycle, cycle * 1_000_000, flags::NEW_STATE);
    (out.state.sequence, out.state.stamp_ns, out.state.valid_q, out.state.q[0]) = (cycle, cycle * 1_000_000, 1, cycle as f64);
    out
}

fn until(clock: MonotonicClock, what: &str, mut is_there: impl FnMut() -> bool) {
    while !is_there() {
        assert!(clock.now_ns() < PATIENCE_NS, "{what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_sync_that_hangs_holds_up_nobody_and_what_finds_no_room_is_counted() {
    let clock = MonotonicClock::start();
    let disk = Handle(Arc::new(Disk::default()));
    let (mut sink, source) = ring(ROOM);
    let losses = sink.losses();
    let layout = Layout { joints: vec!["q".into()], ..Layout::default() };
    let options = Options { keep_cycles: 0, after_cycles: 0, sync_ns: 1_000_000, flush_ns: 1_000_000, ..Options::default() };
    let handle = spawn(source, Box::new(disk.clone()), layout, options, clock, Vec::new()).unwrap();
    (0..10).for_each(|cycle| sink.put(&record(cycle)));
    until(clock, "the first periods are taken", || handle.progress().taken == 10);
    *disk.0.is_shut.lock().unwrap() = true;
    until(clock, "a sync waits", || *disk.0.waiting.lock().unwrap() == 1);
    // Five seconds of a loop of 1 kHz: were a put to wait for the disk, it would wait for ever, for nobody opens it meanwhile.
    (10..5010).for_each(|cycle| sink.put(&record(cycle)));
    assert_eq!((losses.count(), handle.progress().taken, handle.is_alive()), (0, 10, true));
    // Another five: there is room for three of them.
    (5010..10_010).for_each(|cycle| sink.put(&record(cycle)));
    assert_eq!((losses.count(), handle.progress().taken), (2000, 10));
    *disk.0.is_shut.lock().unwrap() = false;
    disk.0.opened.notify_all();
    until(clock, "it catches up", || handle.progress().taken == 8010);
    (10_010..10_020).for_each(|cycle| sink.put(&record(cycle)));
    drop(sink);
    let (progress, outcome) = handle.finish();
    outcome.unwrap();
    assert_eq!((progress.written, progress.dropped, progress.lost, progress.error), (8020, 2000, 0, None));
    // The file says the same: everything but what found no room, in order.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("A.mcap");
    std::fs::write(&path, disk.0.bytes.lock().unwrap().as_slice()).unwrap();
    let recording = pkm_record::read(&path, &ReadOptions::default()).unwrap();
    let kept: Vec<f64> = recording.signal("q.q").unwrap().to_vec();
    let wanted: Vec<f64> = (0..8010).chain(10_010..10_020).map(f64::from).collect();
    assert_eq!(kept, wanted);
}
