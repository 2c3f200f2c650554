//! A guarded walk over an MCAP file: every length is checked against the file and a limit before a byte is allocated or parsed.
//!
//! The mcap crate's message stream believes lengths and aborts on damaged files. It is used here for one thing: the decompression
//! of a single chunk whose sizes were checked.

use alloc::collections::BTreeMap;
use std::io::{self, Read};

use ::mcap::records::op;
use ::mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::bytes::Bytes;

/// Largest record outside of a chunk `[bytes]`.
const MAX_RECORD: u64 = 64 << 20;
/// Largest chunk, compressed or not `[bytes]`.
const MAX_CHUNK: u64 = 256 << 20;
/// How much may come out of a file in all: this `[bytes]`, and so many times the file's size (lz4 cannot exceed 255).
const MAX_TOTAL: (u64, u64) = (1 << 30, 256);
/// Opcode and length before each record `[bytes]`.
const HEAD: u64 = 9;

/// What a file holds, one record at a time.
#[derive(Debug)]
pub(super) enum Event<'a> {
    /// A message type.
    Schema { id: u16, name: &'a str },
    /// A topic.
    Channel { id: u16, schema: u16, topic: &'a str, encoding: &'a str },
    /// A message.
    Message { channel: u16, log_time: u64, data: &'a [u8] },
    /// A metadata record.
    Metadata { name: &'a str, pairs: BTreeMap<&'a str, &'a str> },
    /// A carried file.
    Attachment { name: &'a str, media_type: &'a str, data: &'a [u8] },
}

/// The first thing found wrong.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Damage {
    /// Place of the record it is in.
    pub(super) byte: u64,
    /// What is wrong.
    pub(super) what: String,
    /// Messages that the file says it has: its statistics, or else the indexes behind its chunks.
    pub(super) promised: Option<u64>,
    /// Bytes of records that could not be read, and bytes behind the last one.
    pub(super) lost_bytes: u64,
}

/// How a walk ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Walk {
    /// The file is something else.
    NotMcap,
    /// All of it was read.
    Whole,
    /// What could be read was.
    Damaged(Damage),
}

/// Receives events; an error is noted as damage of the record, and the walk goes on.
pub(super) type Sink<'a> = dyn FnMut(Event<'_>) -> Result<(), String> + 'a;

/// Walks a file of `length` bytes; whatever is complete goes to `sink` also behind a damaged record.
pub(super) fn scan(source: impl Read, length: u64, sink: &mut Sink<'_>) -> io::Result<Walk> {
    let mut walk = Scanner {
        source,
        length,
        at: 0,
        buffer: Vec::new(),
        sum: crc32fast::Hasher::new(),
        damage: None,
        inflated: 0,
        statistics: None,
        indexed: 0,
        lost_bytes: 0,
    };
    if length < super::MAGIC.len() as u64 || !walk.is_magic()? {
        return Ok(Walk::NotMcap);
    }
    while walk.record(sink)? {}
    let (indexed, lost_bytes) = (walk.indexed, walk.lost_bytes);
    let promised = walk.statistics.or_else(|| (indexed > 0).then_some(indexed));
    Ok(walk.damage.map_or(Walk::Whole, |damage| Walk::Damaged(Damage { promised, lost_bytes, ..damage })))
}

struct Scanner<R> {
    source: R,
    length: u64,
    at: u64,
    buffer: Vec<u8>,
    /// Of everything read so far, for the sum at the end of the data section.
    sum: crc32fast::Hasher,
    damage: Option<Damage>,
    /// Bytes that came out of chunks so far.
    inflated: u64,
    /// Messages by the statistics, and by the indexes.
    statistics: Option<u64>,
    indexed: u64,
    lost_bytes: u64,
}

impl<R: Read> Scanner<R> {
    fn left(&self) -> u64 {
        self.length.saturating_sub(self.at)
    }

    fn note(&mut self, byte: u64, what: impl Into<String>) {
        if self.damage.is_none() {
            self.damage = Some(Damage { byte, what: what.into(), promised: None, lost_bytes: 0 });
        }
    }

    /// Appends `n` bytes to the buffer; the caller has checked `n` against the file and a limit.
    fn load(&mut self, n: u64) -> io::Result<()> {
        let start = self.buffer.len();
        let n_bytes = usize::try_from(n).map_err(io::Error::other)?;
        self.buffer.resize(start + n_bytes, 0);
        self.source.read_exact(&mut self.buffer[start..])?;
        self.sum.update(&self.buffer[start..]);
        self.at += n;
        Ok(())
    }

    /// Passes over `n` bytes, which are summed up but not kept.
    fn skip(&mut self, mut n: u64) -> io::Result<()> {
        const STEP: u64 = 64 << 10;
        while n > 0 {
            self.buffer.clear();
            self.load(n.min(STEP))?;
            n -= n.min(STEP);
        }
        Ok(())
    }

    fn is_magic(&mut self) -> io::Result<bool> {
        self.buffer.clear();
        self.load(super::MAGIC.len() as u64)?;
        Ok(self.buffer == super::MAGIC)
    }

    /// One record; false at the end of what can be walked.
    fn record(&mut self, sink: &mut Sink<'_>) -> io::Result<bool> {
        let start = self.at;
        if self.left() < HEAD {
            let what = format!("the file ends without its end mark ({} of {HEAD} bytes of a record are there)", self.left());
            self.note(start, what);
            self.lost_bytes += self.left();
            return Ok(false);
        }
        let sum = self.sum.clone().finalize();
        self.buffer.clear();
        self.load(HEAD)?;
        let mut head = Bytes(&self.buffer);
        let opcode = head.take(1).and_then(<[u8]>::first).copied().unwrap_or_default();
        let length = head.u64().unwrap_or(u64::MAX);
        if length > self.left() {
            let what = format!("a record (opcode {opcode:#04x}) of {length} bytes, but {} are left in the file", self.left());
            self.note(start, what);
            self.lost_bytes += HEAD + self.left();
            return Ok(false);
        }
        let limit = match opcode {
            op::CHUNK => MAX_CHUNK,
            // An attachment of any size is no damage: it is passed over.
            op::HEADER | op::SCHEMA | op::CHANNEL | op::MESSAGE | op::METADATA | op::DATA_END | op::FOOTER => MAX_RECORD,
            op::ATTACHMENT | op::MESSAGE_INDEX | op::STATISTICS if length <= MAX_RECORD => MAX_RECORD,
            _ => {
                self.skip(length)?;
                return Ok(true);
            }
        };
        if length > limit {
            self.note(start, format!("a record (opcode {opcode:#04x}) of {length} bytes (limit {limit})"));
            self.lost_bytes += HEAD + length;
            self.skip(length)?;
            return Ok(true);
        }
        self.load(length)?;
        match opcode {
            op::CHUNK => self.chunk(start, sink),
            op::MESSAGE_INDEX | op::STATISTICS => self.count(opcode),
            op::DATA_END => self.check_sum(start, sum),
            op::FOOTER => return self.end(),
            _ => {
                let body = self.buffer.get(9..).unwrap_or_default();
                if let Err(what) = emit(opcode, body, sink) {
                    self.note(start, what);
                    self.lost_bytes += HEAD + length;
                }
            }
        }
        Ok(true)
    }

    /// How many messages there were before anything was damaged; believed for a count and for nothing else.
    fn count(&mut self, opcode: u8) {
        let mut body = Bytes(self.buffer.get(9..).unwrap_or_default());
        if opcode == op::STATISTICS {
            self.statistics = body.u64();
        } else if let (Some(_channel), Some(entries)) = (body.u16(), body.block()) {
            // A time and a place each.
            self.indexed = self.indexed.saturating_add(entries.len() as u64 / 16);
        }
    }

    fn check_sum(&mut self, start: u64, sum: u32) {
        let wanted = Bytes(self.buffer.get(9..).unwrap_or_default()).u32();
        match wanted {
            None => self.note(start, "the data end record is too short"),
            // 0 stands for: not calculated.
            Some(wanted) if wanted != 0 && wanted != sum => {
                self.note(start, format!("check sum of the data is {sum:08x}, the file says {wanted:08x}"));
            }
            Some(_) => {}
        }
    }

    /// Behind the footer: the magic once more, and nothing else.
    fn end(&mut self) -> io::Result<bool> {
        let start = self.at;
        let n = super::MAGIC.len() as u64;
        if self.left() < n || !self.is_magic()? {
            self.note(start, "the file ends without its end mark");
        } else if self.left() > 0 {
            self.note(self.at, format!("{} bytes follow the end of the recording", self.left()));
        }
        Ok(false)
    }

    fn chunk(&mut self, start: u64, sink: &mut Sink<'_>) {
        let body = self.buffer.get(9..).unwrap_or_default();
        let length = self.buffer.len() as u64;
        let Some((inflated, packed)) = chunk_sizes(body) else {
            self.lost_bytes += length;
            return self.note(start, "the chunk header does not fit its record");
        };
        let allowed = MAX_TOTAL.0.saturating_add(self.length.saturating_mul(MAX_TOTAL.1));
        self.inflated = self.inflated.saturating_add(inflated.max(packed));
        if inflated > MAX_CHUNK || self.inflated > allowed {
            let what = format!("a chunk claims {inflated} bytes decompressed (limits {MAX_CHUNK} and {allowed} in all)");
            self.lost_bytes += length;
            return self.note(start, what);
        }
        if let Err(what) = inflate(&self.buffer, sink) {
            self.lost_bytes += length;
            self.note(start, what);
        }
    }
}

/// Decompressed and compressed size of a chunk, if its header fits.
fn chunk_sizes(body: &[u8]) -> Option<(u64, u64)> {
    let mut body = Bytes(body);
    body.take(16)?; // start and end time
    let inflated = body.u64()?;
    body.u32()?; // check sum
    body.text()?; // compression
    let packed = body.u64()?;
    (packed <= body.0.len() as u64).then_some((inflated, packed))
}

/// Decompresses one chunk record, header included, and passes on what is in it; the check sum is verified before.
fn inflate(record: &[u8], sink: &mut Sink<'_>) -> Result<(), String> {
    let limit = usize::try_from(MAX_CHUNK).unwrap_or(usize::MAX);
    let mut reader = LinearReader::new_with_options(
        LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(limit),
    );
    reader.insert(record.len()).copy_from_slice(record);
    reader.notify_read(record.len());
    let mut first = Ok(());
    loop {
        match reader.next_event() {
            None => return first,
            // All there is has been given: nothing more means the end, and within a record an error.
            Some(Ok(LinearReadEvent::ReadRequest(_))) => reader.notify_read(0),
            Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                let done = emit(opcode, data, sink);
                first = first.and(done);
            }
            Some(Err(e)) => return first.and(Err(format!("chunk: {e}"))),
        }
    }
}

/// Parses one record and passes it on; records of no interest are left out.
fn emit(opcode: u8, body: &[u8], sink: &mut Sink<'_>) -> Result<(), String> {
    let event = match opcode {
        op::SCHEMA => schema(body),
        op::CHANNEL => channel(body),
        op::MESSAGE => message(body),
        op::METADATA => metadata(body),
        op::ATTACHMENT => attachment(body)?,
        _ => return Ok(()),
    };
    match event {
        Some(event) => sink(event),
        None => Err(format!("the fields of a record (opcode {opcode:#04x}) do not fit its {} bytes", body.len())),
    }
}

fn schema(body: &[u8]) -> Option<Event<'_>> {
    let mut body = Bytes(body);
    Some(Event::Schema { id: body.u16()?, name: body.text()? })
}

fn channel(body: &[u8]) -> Option<Event<'_>> {
    let mut body = Bytes(body);
    Some(Event::Channel { id: body.u16()?, schema: body.u16()?, topic: body.text()?, encoding: body.text()? })
}

fn message(body: &[u8]) -> Option<Event<'_>> {
    let mut body = Bytes(body);
    let (channel, _sequence, log_time, _publish_time) = (body.u16()?, body.u32()?, body.u64()?, body.u64()?);
    Some(Event::Message { channel, log_time, data: body.0 })
}

fn metadata(body: &[u8]) -> Option<Event<'_>> {
    let mut body = Bytes(body);
    let name = body.text()?;
    let mut block = Bytes(body.block()?);
    let mut pairs = BTreeMap::new();
    while !block.0.is_empty() {
        pairs.insert(block.text()?, block.text()?);
    }
    Some(Event::Metadata { name, pairs })
}

fn attachment(body: &[u8]) -> Result<Option<Event<'_>>, String> {
    let mut rest = Bytes(body);
    let mut fields = || {
        rest.take(16)?; // log and creation time
        let (name, media_type) = (rest.text()?, rest.text()?);
        let length = usize::try_from(rest.u64()?).ok()?;
        Some((name, media_type, rest.take(length)?, rest.u32()?))
    };
    let Some((name, media_type, data, wanted)) = fields() else { return Ok(None) };
    let sum = crc32fast::hash(body.get(..body.len().saturating_sub(4)).unwrap_or_default());
    if wanted != 0 && wanted != sum {
        return Err(format!("check sum of attachment {} is {sum:08x}, the file says {wanted:08x}", crate::error::clip(name)));
    }
    Ok(Some(Event::Attachment { name, media_type, data }))
}
