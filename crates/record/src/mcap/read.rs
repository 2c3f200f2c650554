//! MCAP to recording: our own files, and any rosbag2 file with joint states.

use alloc::collections::{BTreeMap, BTreeSet};
use std::io::Read;

use pkm_ident::{EffortKind, Meta, Recording};

use super::columns::{self, Kind};
use super::scan::{Damage, Event, Walk, scan};
use super::series::{Series, cells_allowed};
use super::{align, cdr, schema, seconds};
use crate::error::{ReadError, clip, list};
use crate::{Attachment, Attachments, ControlStep, ReadOptions, meta};

/// Reads the recording; `file` names it in the recording and in errors.
pub(crate) fn read(file: &str, source: impl Read, length: u64, options: &ReadOptions) -> Result<Recording, ReadError> {
    let (collected, damage) = collect(file, source, length, Keep::Messages)?;
    refuse(file, &collected, damage.as_ref(), options)?;
    let chosen = choose(file, &collected, options);
    // A recovered file without the topic: what is missing was in the damaged part.
    let base = match (chosen, &damage) {
        (Err(_), Some(damage)) => return Err(damaged(file, &collected, damage)),
        (chosen, _) => chosen?,
    };
    let (mut meta, offset_ns) = collected.meta(file)?;
    let faults: Vec<&Series> = collected.used(base).filter(|s| s.fault.is_some()).collect();
    if let (Some((series, (number, what))), false) = (faults.iter().find_map(|s| Some((s, s.fault?))), options.recover) {
        return Err(ReadError::Message { file: file.to_string(), topic: clip(&series.topic), number, what });
    }
    if let Some(damage) = damage {
        meta.other.insert("recovered".to_string(), recovered(collected.messages, &damage));
    } else if !faults.is_empty() {
        let topics = list(faults.iter().map(|s| s.topic.as_str()));
        meta.other.insert("recovered".to_string(), format!("{} messages without unreadable ones of {topics}", collected.messages));
    }
    let mut recording = assemble(file, &collected, base, offset_ns)?;
    let has_effort = recording.signals.keys().any(|c| c.starts_with("tau."));
    if !has_effort && meta.tau != Some(EffortKind::Measured) && commands_as_efforts(&mut recording.signals) {
        meta.tau = Some(EffortKind::Commanded);
    }
    recording.meta = meta;
    Ok(recording)
}

/// How much of a damaged file came back, and how much did not.
fn recovered(messages: u64, damage: &Damage) -> String {
    let lost = match damage.promised.map(|promised| promised.saturating_sub(messages)) {
        // No count of the file's covers what it was cut off in.
        Some(0) | None if damage.lost_bytes > 0 => format!("what was in {} bytes lost", damage.lost_bytes),
        Some(lost) if lost > 0 && damage.lost_bytes > 0 => format!("{lost} lost ({} bytes)", damage.lost_bytes),
        Some(lost) => format!("{lost} lost"),
        None => "none lost".to_string(),
    };
    format!("{messages} messages, {lost}; first damage at byte {}: {}", damage.byte, damage.what)
}

/// Reads the carried files.
pub(crate) fn read_attachments(file: &str, source: impl Read, length: u64, options: &ReadOptions) -> Result<Attachments, ReadError> {
    let (collected, damage) = collect(file, source, length, Keep::Files)?;
    refuse(file, &collected, damage.as_ref(), options)?;
    Ok(Attachments { files: collected.files, ..Attachments::default() })
}

/// Hands the steps of the controller to `each`.
pub(crate) fn read_controls(
    file: &str,
    source: impl Read,
    length: u64,
    options: &ReadOptions,
    each: &mut dyn FnMut(ControlStep),
) -> Result<(), ReadError> {
    let (mut channels, mut types, mut messages) = (BTreeSet::new(), BTreeSet::new(), 0_u64);
    let mut offset_ns = 0;
    let mut take = |event: Event<'_>| -> Result<(), String> {
        match event {
            Event::Schema { id, name } if name == schema::CONTROL => {
                types.insert(id);
            }
            Event::Channel { id, schema, topic, encoding }
                if types.contains(&schema) && topic == columns::CONTROLS && encoding == schema::MESSAGES =>
            {
                channels.insert(id);
            }
            Event::Metadata { name, pairs } if name == super::RECORD => {
                let seconds: i32 = pairs.get(meta::TIME_OFFSET).and_then(|text| text.parse().ok()).unwrap_or(0);
                offset_ns = i64::from(seconds) * 1_000_000_000;
            }
            Event::Message { channel, data, .. } => {
                messages += 1;
                if channels.contains(&channel) {
                    let unreadable = |what| format!("a step of the controller cannot be read: {what}");
                    let message = cdr::control(data).map_err(unreadable)?;
                    let t = seconds(message.header.stamp_ns.saturating_add(offset_ns));
                    each(ControlStep::from_message(t, &message).map_err(unreadable)?);
                }
            }
            _ => {}
        }
        Ok(())
    };
    let mut buffered = std::io::BufReader::with_capacity(1 << 16, source);
    match scan(&mut buffered, length, &mut take).map_err(|e| crate::io_error(file, &e))? {
        Walk::NotMcap => Err(ReadError::NotMcap { file: file.to_string() }),
        Walk::Damaged(damage) if !options.recover => {
            Err(ReadError::Damaged { file: file.to_string(), byte: damage.byte, what: damage.what, messages })
        }
        _ => Ok(()),
    }
}

/// What of a file is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Keep {
    Messages,
    Files,
}

#[derive(Debug, Default)]
struct Collected {
    types: BTreeMap<u16, String>,
    /// Series of each channel; none for a topic of no use here.
    channels: BTreeMap<u16, Option<usize>>,
    series: Vec<Series>,
    topics: BTreeSet<String>,
    pairs: BTreeMap<String, String>,
    files: Vec<Attachment>,
    messages: u64,
}

fn collect(file: &str, source: impl Read, length: u64, keep: Keep) -> Result<(Collected, Option<Damage>), ReadError> {
    let mut collected = Collected::default();
    let mut buffered = std::io::BufReader::with_capacity(1 << 16, source);
    let walk = scan(&mut buffered, length, &mut |event| collected.take(event, keep)).map_err(|e| crate::io_error(file, &e))?;
    match walk {
        Walk::NotMcap if length == 0 => Err(ReadError::Empty { file: file.to_string() }),
        Walk::NotMcap => Err(ReadError::NotMcap { file: file.to_string() }),
        Walk::Whole => Ok((collected, None)),
        Walk::Damaged(damage) => Ok((collected, Some(damage))),
    }
}

fn damaged(file: &str, collected: &Collected, damage: &Damage) -> ReadError {
    ReadError::Damaged { file: file.to_string(), byte: damage.byte, what: damage.what.clone(), messages: collected.messages }
}

fn refuse(file: &str, collected: &Collected, damage: Option<&Damage>, options: &ReadOptions) -> Result<(), ReadError> {
    match damage {
        Some(damage) if !options.recover => Err(damaged(file, collected, damage)),
        _ => Ok(()),
    }
}

impl Collected {
    fn take(&mut self, event: Event<'_>, keep: Keep) -> Result<(), String> {
        match event {
            Event::Schema { id, name } => {
                self.types.insert(id, name.to_string());
            }
            Event::Channel { id, schema, topic, encoding } => {
                let series = self.kind(schema, topic, encoding).map(|kind| self.series_of(topic, kind));
                self.topics.insert(topic.to_string());
                self.channels.insert(id, series);
            }
            Event::Message { channel, log_time, data } => {
                let series =
                    self.channels.get(&channel).ok_or_else(|| format!("a message of channel {channel}, which was not declared"))?;
                self.messages += 1;
                if let (Some(series), Keep::Messages) = (series.and_then(|k| self.series.get_mut(k)), keep) {
                    series.push(log_time, data);
                }
            }
            Event::Metadata { name, pairs } => {
                if name == super::RECORD {
                    self.pairs.extend(pairs.into_iter().map(|(k, v)| (k.to_string(), v.to_string())));
                }
            }
            Event::Attachment { name, media_type, data } => {
                if keep == Keep::Files {
                    let (name, media_type) = (name.to_string(), media_type.to_string());
                    self.files.push(Attachment { name, media_type, bytes: data.to_vec() });
                }
            }
        }
        Ok(())
    }

    fn kind(&self, schema: u16, topic: &str, encoding: &str) -> Option<Kind> {
        if encoding != schema::MESSAGES {
            return None;
        }
        match self.types.get(&schema)?.as_str() {
            schema::JOINT_STATE => Some(Kind::Joints),
            schema::WRENCH if topic.starts_with(columns::WRENCH) => Some(Kind::Wrench),
            schema::POSE if topic.starts_with(columns::POSE) => Some(Kind::Pose),
            _ => None,
        }
    }

    /// Two channels of one topic are two publishers of one signal.
    fn series_of(&mut self, topic: &str, kind: Kind) -> usize {
        self.series.iter().position(|s| s.topic == topic && s.kind == kind).unwrap_or_else(|| {
            self.series.push(Series::new(topic, kind));
            self.series.len() - 1
        })
    }

    /// The keys, and what to add to every stamp `[ns]`.
    fn meta(&self, file: &str) -> Result<(Meta, i64), ReadError> {
        let mut meta = Meta::default();
        let mut offset_ns = 0;
        for (key, text) in &self.pairs {
            let bad = |wants: String| {
                let at = format!("{file} metadata {}", super::RECORD);
                ReadError::Metadata { at, key: clip(key), value: clip(text), wants }
            };
            match key.as_str() {
                meta::VERSION => {}
                meta::TIME_OFFSET => {
                    let seconds: i32 = text.parse().map_err(|_| bad("a whole number of seconds".to_string()))?;
                    offset_ns = i64::from(seconds) * 1_000_000_000;
                }
                _ => meta::set(&mut meta, key, text).map_err(bad)?,
            }
        }
        Ok((meta, offset_ns))
    }

    /// The series a recording with that time base is made of, the base first.
    fn used(&self, base: usize) -> impl Iterator<Item = &Series> {
        let others =
            self.series.iter().enumerate().filter(move |(k, s)| *k != base && (s.kind != Kind::Joints || columns::is_auxiliary(&s.topic)));
        self.series.get(base).into_iter().chain(others.map(|(_, s)| s))
    }
}

/// Which series holds the measured joint states.
fn choose(file: &str, collected: &Collected, options: &ReadOptions) -> Result<usize, ReadError> {
    let file = || file.to_string();
    let joints = || collected.series.iter().enumerate().filter(|(_, s)| s.kind == Kind::Joints);
    let find = |topic: &str| joints().find(|(_, s)| s.topic == topic).map(|(k, _)| k);
    if let Some(wanted) = &options.topic {
        let topics = || list(joints().map(|(_, s)| s.topic.as_str()));
        return find(wanted).ok_or_else(|| ReadError::NoTopic { file: file(), wanted: clip(wanted), topics: topics() });
    }
    if let Some(k) = find(columns::STATES) {
        return Ok(k);
    }
    let candidates: Vec<(usize, &Series)> = joints().filter(|(_, s)| !columns::is_auxiliary(&s.topic)).collect();
    match *candidates.as_slice() {
        [] => Err(ReadError::NoJointState { file: file(), topics: list(collected.topics.iter().map(String::as_str)) }),
        [(k, _)] => Ok(k),
        [..] => Err(ReadError::SeveralTopics { file: file(), topics: list(candidates.iter().map(|(_, s)| s.topic.as_str())) }),
    }
}

/// All signals on the time axis of the base.
fn assemble(file: &str, collected: &Collected, base: usize, offset_ns: i64) -> Result<Recording, ReadError> {
    let mut stamps = Vec::new();
    let mut time: Vec<f64> = Vec::new();
    for (stamp, _) in collected.series[base].rows() {
        let t = seconds(stamp.saturating_add(offset_ns));
        // Two stamps may be one f64 when they count from 1970.
        if time.last().is_none_or(|before| t > *before) {
            stamps.push(stamp);
            time.push(t);
        }
    }
    if time.is_empty() {
        return Err(ReadError::NoSamples { file: file.to_string() });
    }
    let reach = align::half_period(&stamps);
    let allowed = cells_allowed(collected.series.iter().map(|s| s.payload).sum());
    let mut signals = BTreeMap::new();
    for (k, series) in collected.used(base).enumerate() {
        let rows = align::nearest(&stamps, &series.rows(), reach);
        let topic = if k == 0 { columns::STATES } else { &series.topic };
        for (field, name, values) in series.columns() {
            let Some(column) = columns::column(topic, field, name) else { continue };
            // Looked at before it is copied: a column of NaN is one nobody recorded.
            let sample = |row: &Option<usize>| row.and_then(|r| values.get(r)).copied().unwrap_or(f64::NAN);
            if signals.contains_key(&column) || rows.iter().all(|row| sample(row).is_nan()) {
                continue;
            }
            if let Some(k) = rows.iter().position(|row| sample(row).is_infinite()) {
                let (t, value) = (time.get(k).copied().unwrap_or(f64::NAN), rows.get(k).map_or(f64::NAN, sample));
                return Err(ReadError::InfiniteSample { file: file.to_string(), t, column: clip(&column), value });
            }
            if (signals.len() as u64 + 1).saturating_mul(time.len() as u64) > allowed {
                return Err(ReadError::TooSparse { file: file.to_string(), columns: signals.len() + 1, samples: time.len() });
            }
            signals.insert(column, rows.iter().map(sample).collect());
        }
    }
    Ok(Recording { name: file.to_string(), time, signals, meta: Meta::default() })
}

/// Where no effort was measured, the commanded ones take its place. False if there are none.
fn commands_as_efforts(signals: &mut BTreeMap<String, Vec<f64>>) -> bool {
    let commands: Vec<String> = signals.keys().filter(|c| c.starts_with("tau_cmd.")).cloned().collect();
    for column in &commands {
        if let (Some(joint), Some(values)) = (column.strip_prefix("tau_cmd."), signals.remove(column)) {
            signals.insert(format!("tau.{joint}"), values);
        }
    }
    !commands.is_empty()
}
