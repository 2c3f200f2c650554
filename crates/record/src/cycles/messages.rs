//! A period as messages: which topics a layout has, and what is on each.

use alloc::collections::BTreeMap;
use std::io::{Seek, Write};

use ::mcap::records::MessageHeader;
use ::mcap::{McapError, Writer};

use pkm_hal::cycle::{Cause, CycleRecord, Phase, flags};
use pkm_hal::{MAX_AXES, Signal, StateFrame};

use super::Layout;
use crate::mcap::columns::{self, Kind, Slot};
use crate::mcap::{cdr, schema};

/// Channels of a file.
pub(super) struct Channels {
    states: u16,
    references: u16,
    accelerations: u16,
    commands: u16,
    cycles: u16,
    sensors: Vec<SensorTopic>,
}

/// A topic of further sensors.
struct SensorTopic {
    channel: u16,
    /// Names of joints; empty for wrenches and poses.
    names: Vec<String>,
    frame: String,
    /// Position, velocity, effort, or the components in the first: places among the sensors.
    fields: [Vec<Option<usize>>; 3],
}

/// A topic's message type, names, frame and fields while they are gathered.
#[derive(Default)]
struct Draft<'a> {
    kind: Option<Kind>,
    names: Vec<&'a str>,
    frame: &'a str,
    fields: [Vec<Option<usize>>; 3],
}

impl Channels {
    /// Declares every topic of the layout.
    pub(super) fn declare<W: Write + Seek>(writer: &mut Writer<W>, layout: &Layout) -> Result<Self, McapError> {
        let joints = |writer: &mut Writer<W>, topic: &str| channel(writer, topic, (schema::JOINT_STATE, schema::JOINT_STATE_TEXT));
        let [states, references, accelerations, commands] =
            [columns::STATES, columns::REFERENCES, columns::REFERENCE_ACCELERATIONS, columns::COMMANDS].map(|t| joints(writer, t));
        let cycles = channel(writer, columns::CYCLES, (schema::CYCLE, &definition()))?;
        let mut sensors = Vec::new();
        for (topic, draft) in drafts(layout) {
            let types = match draft.kind {
                Some(Kind::Wrench) => (schema::WRENCH, schema::WRENCH_TEXT),
                Some(Kind::Pose) => (schema::POSE, schema::POSE_TEXT),
                _ => (schema::JOINT_STATE, schema::JOINT_STATE_TEXT),
            };
            let names = draft.names.iter().map(ToString::to_string).collect();
            let frame = draft.frame.to_string();
            sensors.push(SensorTopic { channel: channel(writer, &topic, types)?, names, frame, fields: draft.fields });
        }
        let (states, references, accelerations, commands) = (states?, references?, accelerations?, commands?);
        Ok(Self { states, references, accelerations, commands, cycles, sensors })
    }

    /// Writes a period; `message` is scratch. How many bytes it came to.
    pub(super) fn write<W: Write + Seek>(
        &self,
        writer: &mut Writer<W>,
        message: &mut cdr::Writer,
        layout: &Layout,
        record: &CycleRecord,
    ) -> Result<u64, McapError> {
        let state = &record.state;
        // What answers a sample has the sample's time; a period without one has its own.
        let is_new = record.flags & flags::NEW_STATE != 0;
        let time = layout.epoch_ns.saturating_add(if is_new { state.stamp_ns } else { record.read_ns });
        let stamp = i64::try_from(time).unwrap_or(i64::MAX);
        // The sequence counts periods as far as 32 bits go.
        let sequence = u32::try_from(record.cycle & u64::from(u32::MAX)).unwrap_or(0);
        let mut bytes = 0;
        let mut send = |channel_id: u16, message: &cdr::Writer| {
            bytes += message.finish().len() as u64 + OVERHEAD;
            let header = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
            writer.write_to_known_channel(&header, message.finish())
        };
        let n = layout.joints.len();
        let mut joints = |channel: u16, lists: [Option<&dyn Fn(usize) -> f64>; 3]| {
            message.start(stamp, "");
            message.count(n);
            layout.joints.iter().for_each(|name| message.text(name));
            for list in lists {
                message.count(if list.is_some() { n } else { 0 });
                list.iter().for_each(|value| (0..n).for_each(|i| message.f64(value(i))));
            }
            send(channel, message)
        };
        let at = |list: &[f64; MAX_AXES], i: usize| list.get(i).copied().unwrap_or(f64::NAN);
        if is_new {
            let measured = |signal: Signal, i: usize| state.measured(signal, i).unwrap_or(f64::NAN);
            let [q, v, tau] = [Signal::Position, Signal::Velocity, Signal::Effort].map(|signal| move |i: usize| measured(signal, i));
            joints(self.states, [Some(&q), Some(&v), Some(&tau)])?;
        }
        joints(self.references, [Some(&|i| at(&record.q_ref, i)), Some(&|i| at(&record.v_ref, i)), None])?;
        joints(self.accelerations, [Some(&|i| at(&record.a_ref, i)), None, None])?;
        if record.flags & flags::COMMANDED != 0 {
            joints(self.commands, [None, None, Some(&|i| at(&record.tau_sent, i))])?;
        }
        if is_new {
            for topic in &self.sensors {
                topic.encode(message, stamp, state);
                send(topic.channel, message)?;
            }
        }
        encode(message, stamp, record, n);
        send(self.cycles, message)?;
        Ok(bytes)
    }
}

/// Bytes of a message record besides its data: opcode, length, channel, sequence, two times.
const OVERHEAD: u64 = 31;

/// A record in the order of its definition ([`definition`]).
fn encode(message: &mut cdr::Writer, stamp_ns: i64, record: &CycleRecord, n: usize) {
    let CycleRecord { state, command, .. } = record;
    message.start(stamp_ns, "");
    for word in [
        record.cycle,
        record.planned_ns,
        record.woken_ns,
        record.read_ns,
        record.computed_ns,
        record.done_ns,
        record.skipped,
        state.sequence,
        state.stamp_ns,
        state.command_sequence,
        command.sequence,
        command.valid_until_ns,
    ] {
        message.u64(word);
    }
    for number in [record.dt[0], record.motion_time[0], record.value[0], record.limit[0]] {
        message.f64(number);
    }
    for word in [
        record.phase,
        record.cause,
        record.place,
        record.flags,
        record.clipped,
        record.limited,
        command.mode,
        state.status,
        state.drive_fault,
    ] {
        message.u32(word);
    }
    for list in [&record.tau_ff, &command.tau] {
        message.f64s(list.get(..n).unwrap_or(list));
    }
    message.f64s(&record.wrench);
    message.f64s(&record.wrench_ref);
}

/// Definition of [`schema::CYCLE`], with the codes by name.
fn definition() -> String {
    let mut text = String::from(schema::CYCLE_HEAD);
    let upper = |name: &str| name.to_ascii_uppercase().replace('-', "_");
    for (name, bit) in flags::ALL {
        text += &format!("uint32 FLAG_{}={bit}\n", upper(name));
    }
    for phase in Phase::ALL {
        text += &format!("uint32 PHASE_{}={}\n", upper(phase.name()), phase.code());
    }
    for cause in Cause::ALL {
        text += &format!("uint32 CAUSE_{}={}\n", upper(cause.name()), cause.code());
    }
    text + schema::CYCLE_TAIL
}

impl SensorTopic {
    fn encode(&self, message: &mut cdr::Writer, stamp: i64, state: &StateFrame) {
        let number = |place: &Option<usize>| place.and_then(|i| state.measured(Signal::Sensor, i)).unwrap_or(f64::NAN);
        message.start(stamp, &self.frame);
        if self.names.is_empty() {
            self.fields[0].iter().for_each(|place| message.f64(number(place)));
            return;
        }
        message.count(self.names.len());
        self.names.iter().for_each(|name| message.text(name));
        for field in &self.fields {
            message.count(field.len());
            field.iter().for_each(|place| message.f64(number(place)));
        }
    }
}

/// The topics of the sensors, in order of their names.
fn drafts(layout: &Layout) -> BTreeMap<String, Draft<'_>> {
    let mut out: BTreeMap<String, Draft<'_>> = BTreeMap::new();
    for (slot, place) in layout.topics() {
        match slot {
            Slot::Joint { topic, field, joint } => {
                // Measured states of joints come from the loop; a sensor of that name is a signal of its own.
                let is_taken = topic == columns::STATES || topic == columns::COMMANDS || topic.starts_with(columns::REFERENCES);
                let whole = layout.sensors[place].as_str();
                let (topic, field, joint) = if is_taken { (columns::SIGNALS, 0, whole) } else { (topic, field, joint) };
                let draft = out.entry(topic.to_string()).or_default();
                let k = draft.names.iter().position(|name| *name == joint).unwrap_or_else(|| {
                    draft.names.push(joint);
                    draft.names.len() - 1
                });
                let list = &mut draft.fields[field];
                list.resize(list.len().max(k + 1), None);
                list[k] = Some(place);
            }
            Slot::Part { kind, sensor, part } => {
                let (prefix, parts, frame) = match kind {
                    Kind::Wrench => (columns::WRENCH, columns::WRENCH_PARTS.len(), sensor),
                    Kind::Pose | Kind::Joints => (columns::POSE, columns::POSE_PARTS.len(), ""),
                };
                let draft = out.entry(format!("{prefix}{sensor}")).or_default();
                (draft.kind, draft.frame) = (Some(kind), frame);
                draft.fields[0].resize(parts, None);
                draft.fields[0][part] = Some(place);
            }
        }
    }
    for draft in out.values_mut().filter(|draft| draft.kind.is_none()) {
        // A list is empty, or as long as the names.
        for field in draft.fields.iter_mut().filter(|field| !field.is_empty()) {
            field.resize(draft.names.len(), None);
        }
    }
    out
}

fn channel<W: Write + Seek>(writer: &mut Writer<W>, topic: &str, (name, text): (&str, &str)) -> Result<u16, McapError> {
    let id = writer.add_schema(name, schema::ENCODING, text.as_bytes())?;
    writer.add_channel(id, topic, schema::MESSAGES, &BTreeMap::new())
}
