//! The last seconds of the loop, always in memory, and kept when something happens.

use alloc::collections::VecDeque;

use pkm_hal::{CycleRecord, Phase, Transition};

/// How long is recorded after the event `[ns]`.
const AFTER_NS: u64 = 500_000_000;

/// A ring of records, made once.
#[derive(Debug)]
pub struct BlackBox {
    records: VecDeque<CycleRecord>,
    room: usize,
    pending: Option<(Transition, u64)>,
}

impl BlackBox {
    /// Room for `seconds` `[s]` of a loop whose period is `period_ns` `[ns]`, and for what follows an event.
    #[must_use]
    pub fn new(seconds: f64, period_ns: u64) -> Self {
        let periods = (seconds * 1e9 + AFTER_NS as f64) / period_ns.max(1) as f64;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to what memory is for")]
        let room = periods.clamp(1.0, 1e6) as usize;
        Self { records: VecDeque::with_capacity(room), room, pending: None }
    }

    /// Takes a period; the oldest makes room.
    pub fn put(&mut self, record: &CycleRecord) {
        if self.records.len() >= self.room {
            self.records.pop_front();
        }
        self.records.push_back(*record);
    }

    /// Notes that something happened; the first of several that follow each other counts.
    pub fn happened(&mut self, transition: &Transition) {
        let is_event = matches!(transition.to, Phase::SafeStop | Phase::Fault);
        if is_event && self.pending.is_none() {
            self.pending = Some((*transition, transition.at_ns.saturating_add(AFTER_NS)));
        }
    }

    /// The event whose time after it has passed at `now_ns` `[ns]`, once; or `is_last`, when there will be no more.
    pub fn due(&mut self, now_ns: u64, is_last: bool) -> Option<Transition> {
        let (transition, at_ns) = self.pending?;
        (is_last || now_ns >= at_ns).then(|| {
            self.pending = None;
            transition
        })
    }

    /// The records, oldest first.
    pub fn records(&self) -> impl ExactSizeIterator<Item = &CycleRecord> {
        self.records.iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_hal::Cause;

    #[test]
    fn the_last_seconds_are_kept_and_an_event_is_told_once_after_its_time() {
        let mut black_box = BlackBox::new(0.5, 100_000_000);
        (0..100).for_each(|cycle| black_box.put(&CycleRecord { cycle, ..CycleRecord::new(1, 0) }));
        let kept: Vec<u64> = black_box.records().map(|r| r.cycle).collect();
        assert_eq!(kept, (90..100).collect::<Vec<_>>());
        let stop = Transition {
            cycle: 95,
            at_ns: 1000,
            from: Phase::Position,
            to: Phase::SafeStop,
            cause: Cause::Stale,
            place: 0,
            value: 0.0,
            limit: 0.0,
        };
        black_box.happened(&Transition { to: Phase::Holding, ..stop });
        assert_eq!(black_box.due(u64::MAX, true), None);
        black_box.happened(&stop);
        black_box.happened(&Transition { cause: Cause::Tripped, to: Phase::Fault, ..stop });
        assert_eq!(black_box.due(1000 + AFTER_NS - 1, false), None);
        assert_eq!(black_box.due(1000 + AFTER_NS, false), Some(stop));
        assert_eq!(black_box.due(u64::MAX, true), None);
    }
}
