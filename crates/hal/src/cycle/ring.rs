//! A lock-free ring of records between one loop and one recorder.

extern crate alloc;

use alloc::sync::Arc;
use core::sync::atomic::{AtomicU64, Ordering};

use super::{CycleRecord, CycleSink, CycleSource};

/// The loop's end.
#[derive(Debug)]
pub struct RingSink {
    ring: rtrb::Producer<CycleRecord>,
    lost: Arc<AtomicU64>,
}

/// The recorder's end.
#[derive(Debug)]
pub struct RingSource {
    ring: rtrb::Consumer<CycleRecord>,
    lost: Arc<AtomicU64>,
}

/// A ring of `capacity` records, about 1.7 kB each: eight seconds are enough for a disk that takes its time.
#[must_use]
pub fn ring(capacity: usize) -> (RingSink, RingSource) {
    let (producer, consumer) = rtrb::RingBuffer::new(capacity);
    let lost = Arc::new(AtomicU64::new(0));
    (RingSink { ring: producer, lost: Arc::clone(&lost) }, RingSource { ring: consumer, lost })
}

/// Records that found no room, counted where anybody may look: a recorder that waits for a disk cannot say so itself.
#[derive(Debug, Clone)]
pub struct Lost(Arc<AtomicU64>);

impl Lost {
    /// So many so far.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

impl RingSink {
    /// What finds no room.
    #[must_use]
    pub fn losses(&self) -> Lost {
        Lost(Arc::clone(&self.lost))
    }
}

impl CycleSink for RingSink {
    fn put(&mut self, record: &CycleRecord) {
        if self.ring.push(*record).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl CycleSource for RingSource {
    fn take(&mut self) -> Option<CycleRecord> {
        self.ring.pop().ok()
    }

    fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }

    fn is_closed(&self) -> bool {
        self.ring.is_abandoned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_come_in_order_and_what_finds_no_room_is_counted() {
        let (mut sink, mut source) = ring(4);
        let record = |cycle| CycleRecord { cycle, ..CycleRecord::new(1, 0) };
        (0..6).for_each(|cycle| sink.put(&record(cycle)));
        assert_eq!((source.lost(), source.is_closed()), (2, false));
        assert_eq!(source.take().map(|r| r.cycle), Some(0));
        sink.put(&record(6));
        drop(sink);
        let rest: Vec<u64> = core::iter::from_fn(|| source.take()).map(|r| r.cycle).collect();
        assert_eq!((rest, source.is_closed(), source.lost()), (vec![1, 2, 3, 6], true, 2));
    }

    #[test]
    fn two_threads_lose_nothing_that_is_not_counted() {
        let (mut sink, mut source) = ring(64);
        let writer = std::thread::spawn(move || (0..20_000).for_each(|cycle| sink.put(&CycleRecord { cycle, ..CycleRecord::new(1, 0) })));
        let (mut taken, mut last) = (0_u64, None);
        loop {
            let is_closed = source.is_closed();
            while let Some(record) = source.take() {
                assert!(last.is_none_or(|last| record.cycle > last));
                (taken, last) = (taken + 1, Some(record.cycle));
            }
            if is_closed {
                break;
            }
        }
        writer.join().unwrap();
        assert_eq!(taken + source.lost(), 20_000);
    }
}
