//! The messages of one topic as columns.

use alloc::collections::BTreeMap;

use super::cdr::{self, Fault};
use super::columns::{Kind, POSE_PARTS, WRENCH_PARTS};

/// How many values may be held for a payload of `bytes`.
///
/// A dense topic holds one per eight bytes. Far more only comes of messages that each name joints of their own, where short messages
/// would make long columns.
pub(super) fn cells_allowed(bytes: u64) -> u64 {
    (32 << 20) + 2 * bytes
}

/// One topic.
#[derive(Debug)]
pub(super) struct Series {
    pub(super) topic: String,
    pub(super) kind: Kind,
    /// Stamps in the messages `[ns]`.
    stamps: Vec<i64>,
    /// Times of logging `[ns]`, for messages whose stamps nobody set.
    logged: Vec<i64>,
    names: BTreeMap<String, usize>,
    /// Names of the last message with their columns: they hardly ever change.
    last: Vec<(String, usize)>,
    /// Position, velocity, effort; by column, then by message. A column may be shorter than the rest: NaN from there on.
    fields: [Vec<Vec<f64>>; 3],
    cells: u64,
    /// Bytes of all messages.
    pub(super) payload: u64,
    /// Number of messages, readable or not.
    pub(super) messages: u64,
    /// First message that is not what its schema says, counted from 1, and why.
    pub(super) fault: Option<(u64, Fault)>,
}

impl Series {
    /// A topic without messages.
    pub(super) fn new(topic: &str, kind: Kind) -> Self {
        Self {
            topic: topic.to_string(),
            kind,
            stamps: Vec::new(),
            logged: Vec::new(),
            names: BTreeMap::new(),
            last: Vec::new(),
            fields: [Vec::new(), Vec::new(), Vec::new()],
            cells: 0,
            payload: 0,
            messages: 0,
            fault: None,
        }
    }

    /// Takes one message; a message that cannot be read is left out and noted.
    pub(super) fn push(&mut self, log_time: u64, data: &[u8]) {
        self.messages += 1;
        self.payload += data.len() as u64;
        if let Err(fault) = self.decode(log_time, data)
            && self.fault.is_none()
        {
            self.fault = Some((self.messages, fault));
        }
    }

    fn decode(&mut self, log_time: u64, data: &[u8]) -> Result<(), Fault> {
        let parts: &[&str] = match self.kind {
            Kind::Joints => {
                let state = cdr::joint_state(data)?;
                let [position, velocity, effort] = &state.fields;
                return self.row(state.header, log_time, &state.names, [position, velocity, effort]);
            }
            Kind::Wrench => &WRENCH_PARTS,
            Kind::Pose => &POSE_PARTS,
        };
        let (header, numbers) = cdr::stamped(data, parts.len())?;
        self.row(header, log_time, parts, [&numbers, &[], &[]])
    }

    fn row(&mut self, header: cdr::Header, log_time: u64, names: &[&str], values: [&[f64]; 3]) -> Result<(), Fault> {
        let row = self.stamps.len();
        for (k, name) in names.iter().enumerate() {
            if values.iter().all(|v| v.get(k).is_none()) {
                continue;
            }
            let column = self.column(k, name);
            for (field, list) in self.fields.iter_mut().zip(values) {
                let Some(value) = list.get(k) else { continue };
                if field.len() <= column {
                    field.resize(column + 1, Vec::new());
                }
                let samples = &mut field[column];
                self.cells += (row + 1).saturating_sub(samples.len()) as u64;
                if self.cells > cells_allowed(self.payload) {
                    return Err("its messages name so many joints that the columns would not fit into memory");
                }
                samples.resize(row + 1, f64::NAN);
                // One NaN only, as in CSV.
                samples[row] = if value.is_nan() { f64::NAN } else { *value };
            }
        }
        self.stamps.push(header.stamp_ns);
        self.logged.push(i64::try_from(log_time).unwrap_or(i64::MAX));
        Ok(())
    }

    /// Column of the `k`-th name of a message.
    fn column(&mut self, k: usize, name: &str) -> usize {
        if let Some((last, column)) = self.last.get(k)
            && last == name
        {
            return *column;
        }
        let next = self.names.len();
        let column = match self.names.get(name) {
            Some(column) => *column,
            None => *self.names.entry(name.to_string()).or_insert(next),
        };
        self.last.truncate(k);
        // A gap (names without values) leaves the list short; then it is looked up again, no more.
        if self.last.len() == k {
            self.last.push((name.to_string(), column));
        }
        column
    }

    /// Times `[ns]` and message numbers in order of time; of two messages of one time the first.
    pub(super) fn rows(&self) -> Vec<(i64, usize)> {
        let times = if self.stamps.iter().all(|s| *s == 0) { &self.logged } else { &self.stamps };
        let mut rows: Vec<(i64, usize)> = times.iter().copied().zip(0..).collect();
        rows.sort_by_key(|(time, _)| *time);
        rows.dedup_by_key(|(time, _)| *time);
        rows
    }

    /// Every column: field (0 to 2), name and values by message (NaN behind their end).
    pub(super) fn columns(&self) -> impl Iterator<Item = (usize, &str, &[f64])> {
        self.fields.iter().enumerate().flat_map(move |(field, columns)| {
            self.names.iter().filter_map(move |(name, column)| Some((field, name.as_str(), columns.get(*column)?.as_slice())))
        })
    }
}
