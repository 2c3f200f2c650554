//! A period as messages: which topics a layout has, and what is on each.

use alloc::collections::BTreeMap;
use std::io::{Seek, Write};

use ::mcap::records::MessageHeader;
use ::mcap::{McapError, Writer};

use super::{Cycle, Layout, control};
use crate::mcap::columns::{self, Kind, Slot};
use crate::mcap::{cdr, schema};

/// Channels of a file.
pub(super) struct Channels {
    states: u16,
    references: u16,
    accelerations: u16,
    commands: u16,
    cycles: u16,
    controls: u16,
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
        let cycles = channel(writer, columns::CYCLES, (schema::CYCLE, schema::CYCLE_TEXT))?;
        let controls = channel(writer, columns::CONTROLS, (schema::CONTROL, schema::CONTROL_TEXT))?;
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
        Ok(Self { states, references, accelerations, commands, cycles, controls, sensors })
    }

    /// Writes a period; `message` is scratch. How many bytes it came to.
    pub(super) fn write<W: Write + Seek>(
        &self,
        writer: &mut Writer<W>,
        message: &mut cdr::Writer,
        layout: &Layout,
        cycle: &Cycle<'_>,
    ) -> Result<u64, McapError> {
        let time = layout.epoch_ns.saturating_add(cycle.stamp_ns);
        let stamp = i64::try_from(time).unwrap_or(i64::MAX);
        // The sequence counts periods as far as 32 bits go.
        let sequence = u32::try_from(cycle.number & u64::from(u32::MAX)).unwrap_or(0);
        let mut bytes = 0;
        let mut send = |channel_id: u16, message: &cdr::Writer| {
            bytes += message.finish().len() as u64 + OVERHEAD;
            let header = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
            writer.write_to_known_channel(&header, message.finish())
        };
        let none: &[f64] = &[];
        for (channel, lists) in [
            (self.states, [cycle.q, cycle.v, cycle.tau]),
            (self.references, [cycle.q_ref, cycle.v_ref, none]),
            (self.accelerations, [cycle.a_ref, none, none]),
            (self.commands, [none, none, cycle.tau_cmd]),
        ] {
            if lists.iter().all(|list| list.is_empty()) {
                continue;
            }
            message.start(stamp, "");
            message.count(layout.joints.len());
            layout.joints.iter().for_each(|name| message.text(name));
            lists.iter().for_each(|list| message.f64s(list));
            send(channel, message)?;
        }
        for topic in &self.sensors {
            topic.encode(message, stamp, cycle.sensor);
            send(topic.channel, message)?;
        }
        message.start(stamp, "");
        message.u64(cycle.number);
        message.u64(cycle.stamp_ns);
        message.u32(cycle.flags);
        message.u32(cycle.skipped);
        message.u64(cycle.late_ns);
        message.u64(cycle.compute_ns);
        send(self.cycles, message)?;
        if let Some(step) = &cycle.control {
            control::encode(message, stamp, cycle.number, step);
            send(self.controls, message)?;
        }
        Ok(bytes)
    }
}

/// Bytes of a message record besides its data: opcode, length, channel, sequence, two times.
const OVERHEAD: u64 = 31;

impl SensorTopic {
    fn encode(&self, message: &mut cdr::Writer, stamp: i64, sensors: &[f64]) {
        let number = |place: &Option<usize>| place.and_then(|i| sensors.get(i)).copied().unwrap_or(f64::NAN);
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
