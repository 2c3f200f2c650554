//! One MCAP file being written, chunk by chunk; a chunk reaches the system in one piece.

use alloc::collections::BTreeMap;
use alloc::sync::Arc;
use std::io::{self, BufWriter, Write};
use std::sync::{Mutex, PoisonError};

use ::mcap::records::{MessageHeader, Metadata};
use ::mcap::write::NoSeek;
use ::mcap::{Compression, McapError, WriteOptions, Writer};
use pkm_hal::cycle::CycleRecord;

use super::Layout;
use super::messages::Messages;
use super::store::Stored;
use crate::mcap::{RECORD, schema};
use crate::meta;

/// A file and what it is made of.
pub(super) struct CycleFile {
    writer: Writer<NoSeek<BufWriter<Shared>>>,
    shared: Shared,
    messages: Messages,
    /// Channels of the topics.
    channels: Vec<u16>,
    /// Periods that are not yet on their way to the system.
    pub(super) pending: u64,
    /// Bytes of them, before compression.
    pub(super) pending_bytes: u64,
}

/// The file, held by the writer of records and by who syncs; both are of one thread.
#[derive(Clone)]
struct Shared(Arc<Mutex<Box<dyn Stored>>>);

impl Write for Shared {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).write(buffer)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).flush()
    }
}

impl CycleFile {
    /// Begins a file: head, metadata, carried files, topics; all of it is with the system when this returns.
    pub(super) fn begin(stored: Box<dyn Stored>, layout: &Layout, keys: &BTreeMap<String, String>) -> Result<Self, McapError> {
        let shared = Shared(Arc::new(Mutex::new(stored)));
        let mut writer = WriteOptions::new()
            .profile("ros2")
            .library(format!("pkm {}", layout.carried.version()))
            .compression(Some(Compression::Lz4))
            // Threads of the compressor would take the loop's cores.
            .compression_threads(0)
            // A chunk ends where it is flushed: then what is lost with one is known exactly.
            .chunk_size(None)
            .disable_seeking(true)
            .create(NoSeek::new(BufWriter::new(shared.clone())))?;
        writer.write_metadata(&Metadata { name: RECORD.to_string(), metadata: record(layout, keys) })?;
        for file in &layout.carried.files {
            let (name, media_type) = (file.name.clone(), file.media_type.clone());
            writer.attach(&::mcap::Attachment { log_time: 0, create_time: 0, name, media_type, data: file.bytes.as_slice().into() })?;
        }
        let messages = Messages::new(layout);
        let mut channels = Vec::new();
        for topic in messages.topics() {
            let id = writer.add_schema(topic.schema, schema::ENCODING, topic.definition.as_bytes())?;
            channels.push(writer.add_channel(id, &topic.name, schema::MESSAGES, &BTreeMap::new())?);
        }
        writer.flush()?;
        Ok(Self { writer, shared, messages, channels, pending: 0, pending_bytes: 0 })
    }

    /// Appends a period to the chunk that is open.
    pub(super) fn push(&mut self, record: &CycleRecord) -> Result<(), McapError> {
        let Self { writer, messages, channels, pending, pending_bytes, .. } = self;
        *pending += 1;
        messages.encode(record, &mut |message| {
            *pending_bytes += message.data.len() as u64 + OVERHEAD;
            let channel_id = channels.get(message.topic).copied().unwrap_or_default();
            // The sequence counts periods as far as 32 bits go.
            let sequence = u32::try_from(message.cycle & u64::from(u32::MAX)).unwrap_or(0);
            let time = message.time_ns;
            writer.write_to_known_channel(&MessageHeader { channel_id, sequence, log_time: time, publish_time: time }, message.data)
        })
    }

    /// Ends the chunk and hands it to the system; how many periods that were.
    pub(super) fn flush(&mut self) -> Result<u64, McapError> {
        self.writer.flush()?;
        self.pending_bytes = 0;
        Ok(core::mem::take(&mut self.pending))
    }

    /// Makes sure that what was flushed is on the medium.
    pub(super) fn sync(&mut self) -> io::Result<()> {
        self.shared.0.lock().unwrap_or_else(PoisonError::into_inner).sync()
    }

    /// Ends the file with its summary.
    pub(super) fn finish(&mut self) -> Result<(), McapError> {
        self.flush()?;
        self.writer.finish()?;
        Ok(())
    }
}

/// Bytes of a message record besides its data: opcode, length, channel, sequence, two times.
const OVERHEAD: u64 = 31;

/// The metadata record of a file.
fn record(layout: &Layout, keys: &BTreeMap<String, String>) -> BTreeMap<String, String> {
    let mut record = layout.carried.keys.clone();
    record.extend(keys.clone());
    record.insert(meta::VERSION.to_string(), layout.carried.version().to_string());
    record.insert("clock_offset_ns".to_string(), layout.epoch_ns.to_string());
    if layout.carried.files.iter().any(|file| file.name == "controller.toml") {
        record.entry("controller".to_string()).or_insert_with(|| "controller.toml".to_string());
    }
    record
}
