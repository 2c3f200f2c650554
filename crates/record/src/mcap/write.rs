//! Recording to MCAP. The same recording gives the same bytes: no clock is read.

use alloc::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;

use ::mcap::records::{MessageHeader, Metadata};
use ::mcap::{Compression, McapError, WriteOptions, Writer};
use pkm_ident::Recording;

use super::columns::{self, Kind, Slot};
use super::{cdr, schema};
use crate::Attachments;
use crate::cycles::{ControlStep, encode_control};
use crate::error::WriteError;
use crate::meta::{self, Pair};

/// Bytes of a chunk before compression: what a broken-off file loses at most.
const CHUNK: u64 = 128 << 10;

/// Samples of one column, if the recording has it.
type Column<'a> = Option<&'a [f64]>;

/// One topic about to be written.
enum Topic<'a> {
    Joints {
        names: Vec<&'a str>,
        /// Position, velocity, effort; empty where no joint has it.
        fields: [Vec<Column<'a>>; 3],
    },
    /// Wrench or pose.
    Parts { frame: &'a str, parts: Vec<Column<'a>> },
}

/// Writes the whole file; metadata and carried files come first, so that a broken-off file still has them.
pub(crate) fn write(file: &str, out: &mut File, recording: &Recording, extra: (Vec<Pair>, &Attachments)) -> Result<(), WriteError> {
    let (pairs, carried) = extra;
    let offset = offset_seconds(file, recording)?;
    let stamps = stamps(file, recording, offset)?;
    let mut record: BTreeMap<String, String> = pairs.into_iter().map(|p| (p.key, p.text)).collect();
    record.insert(meta::VERSION.to_string(), carried.version().to_string());
    if offset != 0 {
        record.insert(meta::TIME_OFFSET.to_string(), offset.to_string());
    }
    let failed = |e: McapError| WriteError::Io { file: file.to_string(), detail: e.to_string() };
    let steps = control_stamps(file, &carried.controls, offset)?;
    messages(out, (recording, &stamps), record, (carried, &steps)).map_err(failed)
}

/// Whole seconds that make every stamp of the recording positive when taken away.
fn offset_seconds(file: &str, recording: &Recording) -> Result<i64, WriteError> {
    let t = recording.time.first().copied().unwrap_or(0.0);
    let first = super::stamp_ns(t).ok_or_else(|| WriteError::Stamp { file: file.to_string(), sample: 0, t })?;
    Ok(first.div_euclid(1_000_000_000).min(0))
}

/// The stamp of each sample `[ns]`.
fn stamps(file: &str, recording: &Recording, offset: i64) -> Result<Vec<i64>, WriteError> {
    let mut stamps: Vec<i64> = Vec::with_capacity(recording.len());
    for (sample, &t) in recording.time.iter().enumerate() {
        let stamp = super::stamp_ns(t).map(|s| s - offset * 1_000_000_000);
        let fits = |s: &i64| s.div_euclid(1_000_000_000) <= i64::from(i32::MAX) && stamps.last().is_none_or(|before| s > before);
        stamps.push(stamp.filter(fits).ok_or_else(|| WriteError::Stamp { file: file.to_string(), sample, t })?);
    }
    Ok(stamps)
}

/// The steps of the controller with their stamps `[ns]`.
fn control_stamps<'a>(file: &str, steps: &'a [ControlStep], offset: i64) -> Result<Vec<(i64, &'a ControlStep)>, WriteError> {
    let stamp = |(sample, step): (usize, &'a ControlStep)| {
        let fits = |s: &i64| (0..=i64::from(i32::MAX)).contains(&s.div_euclid(1_000_000_000));
        let found = super::stamp_ns(step.t).map(|s| s - offset * 1_000_000_000).filter(fits);
        found.map(|s| (s, step)).ok_or_else(|| WriteError::Stamp { file: file.to_string(), sample, t: step.t })
    };
    steps.iter().enumerate().map(stamp).collect()
}

fn messages(
    out: &mut File,
    samples: (&Recording, &[i64]),
    record: BTreeMap<String, String>,
    (carried, steps): (&Attachments, &[(i64, &ControlStep)]),
) -> Result<(), McapError> {
    let (recording, stamps) = samples;
    let mut writer = WriteOptions::new()
        .profile("ros2")
        .library(format!("pkm {}", carried.version()))
        .compression(Some(Compression::Lz4))
        .compression_threads(0)
        .chunk_size(Some(CHUNK))
        .create(BufWriter::new(out))?;
    writer.write_metadata(&Metadata { name: super::RECORD.to_string(), metadata: record })?;
    for file in &carried.files {
        let (name, media_type) = (file.name.clone(), file.media_type.clone());
        writer.attach(&::mcap::Attachment { log_time: 0, create_time: 0, name, media_type, data: file.bytes.as_slice().into() })?;
    }
    let mut topics = Vec::new();
    for (name, topic) in topics_of(recording) {
        topics.push((channel(&mut writer, &name, &topic)?, topic));
    }
    let mut controls = Controls { steps, channel: None };
    let mut message = cdr::Writer::default();
    for (k, stamp) in stamps.iter().enumerate() {
        let sequence = u32::try_from(k).unwrap_or(u32::MAX);
        // Stamps were made positive.
        let time = u64::try_from(*stamp).unwrap_or(0);
        for (channel_id, topic) in &topics {
            encode(&mut message, topic, k, *stamp);
            let header = MessageHeader { channel_id: *channel_id, sequence, log_time: time, publish_time: time };
            writer.write_to_known_channel(&header, message.finish())?;
        }
        controls.write(&mut writer, &mut message, *stamp)?;
    }
    controls.write(&mut writer, &mut message, i64::MAX)?;
    writer.finish()?;
    std::io::Write::flush(&mut writer.into_inner())?;
    Ok(())
}

/// Steps of the controller that are still to be written.
struct Controls<'a> {
    steps: &'a [(i64, &'a ControlStep)],
    channel: Option<u16>,
}

impl Controls<'_> {
    /// Writes those up to a stamp.
    fn write<W: std::io::Write + std::io::Seek>(
        &mut self,
        writer: &mut Writer<W>,
        message: &mut cdr::Writer,
        until: i64,
    ) -> Result<(), McapError> {
        while let Some(((stamp, step), rest)) = self.steps.split_first()
            && *stamp <= until
        {
            let channel_id = match self.channel {
                Some(channel) => channel,
                None => {
                    let id = writer.add_schema(schema::CONTROL, schema::ENCODING, schema::CONTROL_TEXT.as_bytes())?;
                    writer.add_channel(id, columns::CONTROLS, schema::MESSAGES, &BTreeMap::new())?
                }
            };
            (self.channel, self.steps) = (Some(channel_id), rest);
            encode_control(message, *stamp, step.number, &step.as_control());
            let time = u64::try_from(*stamp).unwrap_or(0);
            let sequence = u32::try_from(step.number).unwrap_or(u32::MAX);
            writer.write_to_known_channel(&MessageHeader { channel_id, sequence, log_time: time, publish_time: time }, message.finish())?;
        }
        Ok(())
    }
}

fn channel<W: std::io::Write + std::io::Seek>(writer: &mut Writer<W>, name: &str, topic: &Topic<'_>) -> Result<u16, McapError> {
    let (kind, text) = match topic {
        Topic::Joints { .. } => (schema::JOINT_STATE, schema::JOINT_STATE_TEXT),
        Topic::Parts { parts, .. } if parts.len() == columns::WRENCH_PARTS.len() => (schema::WRENCH, schema::WRENCH_TEXT),
        Topic::Parts { .. } => (schema::POSE, schema::POSE_TEXT),
    };
    let id = writer.add_schema(kind, schema::ENCODING, text.as_bytes())?;
    writer.add_channel(id, name, schema::MESSAGES, &BTreeMap::new())
}

/// The topics of a recording; `/joint_states` is always there, as the time base.
fn topics_of(recording: &Recording) -> BTreeMap<String, Topic<'_>> {
    let mut joints: BTreeMap<&str, BTreeMap<&str, [Column<'_>; 3]>> = BTreeMap::from([(columns::STATES, BTreeMap::new())]);
    let mut topics = BTreeMap::new();
    for (column, values) in &recording.signals {
        match columns::slot(column) {
            Slot::Joint { topic, field, joint } => {
                joints.entry(topic).or_default().entry(joint).or_default()[field] = Some(values);
            }
            Slot::Part { kind, sensor, part } => {
                // A wrench is expressed in its sensor's frame; a pose in the root link's, whose name is not known here.
                let (prefix, n, frame) = match kind {
                    Kind::Wrench => (columns::WRENCH, columns::WRENCH_PARTS.len(), sensor),
                    Kind::Pose | Kind::Joints => (columns::POSE, columns::POSE_PARTS.len(), ""),
                };
                let topic = topics.entry(format!("{prefix}{sensor}")).or_insert_with(|| Topic::Parts { frame, parts: vec![None; n] });
                if let Topic::Parts { parts, .. } = topic {
                    parts[part] = Some(values);
                }
            }
        }
    }
    for (topic, joints) in joints {
        let field = |k: usize| -> Vec<Column<'_>> {
            let column = joints.values().map(|fields| fields[k]);
            if column.clone().any(|c| c.is_some()) { column.collect() } else { Vec::new() }
        };
        let fields = [field(0), field(1), field(2)];
        topics.insert(topic.to_string(), Topic::Joints { names: joints.keys().copied().collect(), fields });
    }
    topics
}

fn encode(message: &mut cdr::Writer, topic: &Topic<'_>, k: usize, stamp_ns: i64) {
    let sample = |column: &Column<'_>| column.and_then(|c| c.get(k)).copied().unwrap_or(f64::NAN);
    match topic {
        Topic::Joints { names, fields } => {
            message.start(stamp_ns, "");
            message.count(names.len());
            names.iter().for_each(|name| message.text(name));
            for field in fields {
                message.count(field.len());
                field.iter().for_each(|column| message.f64(sample(column)));
            }
        }
        Topic::Parts { frame, parts } => {
            message.start(stamp_ns, frame);
            parts.iter().for_each(|column| message.f64(sample(column)));
        }
    }
}
