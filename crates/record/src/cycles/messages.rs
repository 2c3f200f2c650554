//! A period as messages: which topics a layout has, and what is on each.

use alloc::collections::BTreeMap;

use pkm_hal::cycle::{Cause, CycleRecord, Phase, flags};
use pkm_hal::{MAX_AXES, Signal, StateFrame};

use super::{Control, Layout};
use crate::mcap::columns::{self, Kind, Slot};
use crate::mcap::{cdr, schema};

/// A topic of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topic {
    /// Its name.
    pub name: String,
    /// Type of its messages.
    pub schema: &'static str,
    /// Definition of that type in the language of ROS 2 (`ros2msg`); messages are CDR.
    pub definition: String,
}

/// Makes the messages of periods; the same for files and for whoever looks on.
#[derive(Debug)]
pub struct Messages {
    joints: Vec<String>,
    epoch_ns: u64,
    topics: Vec<Topic>,
    sensors: Vec<SensorTopic>,
    scratch: cdr::Writer,
}

/// A message of a period.
#[derive(Debug, Clone, Copy)]
pub struct Message<'a> {
    /// Place of its topic in [`Messages::topics`].
    pub topic: usize,
    /// Time of day of the sample `[ns]`.
    pub time_ns: u64,
    /// Number of the period.
    pub cycle: u64,
    /// The message.
    pub data: &'a [u8],
}

/// Topics that every layout has, in this order.
const STATES: usize = 0;
const REFERENCES: usize = 1;
const ACCELERATIONS: usize = 2;
const COMMANDS: usize = 3;
const CYCLES: usize = 4;
const CONTROLS: usize = 5;
const SENSORS: usize = 6;

/// A topic of further sensors.
#[derive(Debug)]
struct SensorTopic {
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

impl Messages {
    /// For a layout.
    #[must_use]
    pub fn new(layout: &Layout) -> Self {
        let topic = |name: &str, schema: &'static str, definition: &str| Topic {
            name: name.to_string(),
            schema,
            definition: definition.to_string(),
        };
        let joints = |name: &str| topic(name, schema::JOINT_STATE, schema::JOINT_STATE_TEXT);
        let mut topics = [columns::STATES, columns::REFERENCES, columns::REFERENCE_ACCELERATIONS, columns::COMMANDS].map(joints).to_vec();
        topics.push(topic(columns::CYCLES, schema::CYCLE, &definition()));
        topics.push(topic(columns::CONTROLS, schema::CONTROL, schema::CONTROL_TEXT));
        let mut sensors = Vec::new();
        for (name, draft) in drafts(layout) {
            topics.push(match draft.kind {
                Some(Kind::Wrench) => topic(&name, schema::WRENCH, schema::WRENCH_TEXT),
                Some(Kind::Pose) => topic(&name, schema::POSE, schema::POSE_TEXT),
                _ => joints(&name),
            });
            let names = draft.names.iter().map(ToString::to_string).collect();
            sensors.push(SensorTopic { names, frame: draft.frame.to_string(), fields: draft.fields });
        }
        Self { joints: layout.joints.clone(), epoch_ns: layout.epoch_ns, topics, sensors, scratch: cdr::Writer::default() }
    }

    /// The topics.
    #[must_use]
    pub fn topics(&self) -> &[Topic] {
        &self.topics
    }

    /// Hands the messages of a period to `send`, until one is refused.
    ///
    /// # Errors
    /// What `send` says.
    pub fn encode<E>(&mut self, record: &CycleRecord, send: &mut dyn FnMut(Message<'_>) -> Result<(), E>) -> Result<(), E> {
        let Self { joints: names, sensors, scratch: message, epoch_ns, .. } = self;
        let state = &record.state;
        // What answers a sample has the sample's time; a period without one has its own.
        let is_new = record.flags & flags::NEW_STATE != 0;
        let time_ns = epoch_ns.saturating_add(if is_new { state.stamp_ns } else { record.read_ns });
        let stamp = i64::try_from(time_ns).unwrap_or(i64::MAX);
        let mut pass = |topic: usize, message: &cdr::Writer| send(Message { topic, time_ns, cycle: record.cycle, data: message.finish() });
        let n = names.len();
        let mut joints = |topic: usize, message: &mut cdr::Writer, lists: [Option<&dyn Fn(usize) -> f64>; 3]| {
            message.start(stamp, "");
            message.count(n);
            names.iter().for_each(|name| message.text(name));
            for list in lists {
                message.count(if list.is_some() { n } else { 0 });
                list.iter().for_each(|value| (0..n).for_each(|i| message.f64(value(i))));
            }
            pass(topic, message)
        };
        let at = |list: &[f64; MAX_AXES], i: usize| list.get(i).copied().unwrap_or(f64::NAN);
        if is_new {
            let measured = |signal: Signal, i: usize| state.measured(signal, i).unwrap_or(f64::NAN);
            let [q, v, tau] = [Signal::Position, Signal::Velocity, Signal::Effort].map(|signal| move |i: usize| measured(signal, i));
            joints(STATES, message, [Some(&q), Some(&v), Some(&tau)])?;
        }
        joints(REFERENCES, message, [Some(&|i| at(&record.q_ref, i)), Some(&|i| at(&record.v_ref, i)), None])?;
        joints(ACCELERATIONS, message, [Some(&|i| at(&record.a_ref, i)), None, None])?;
        if record.flags & flags::COMMANDED != 0 {
            joints(COMMANDS, message, [None, None, Some(&|i| at(&record.tau_sent, i))])?;
        }
        if is_new {
            for (k, sensor) in sensors.iter().enumerate() {
                sensor.encode(message, stamp, state);
                pass(SENSORS + k, message)?;
            }
        }
        encode(message, stamp, record, n);
        pass(CYCLES, message)?;
        if record.flags & flags::STEPPED != 0 {
            step(message, stamp, record, n);
            pass(CONTROLS, message)?;
        }
        Ok(())
    }
}

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

/// The step that the controller did, with everything it was given: enough to do it again.
fn step(message: &mut cdr::Writer, stamp_ns: i64, record: &CycleRecord, n: usize) {
    let CycleRecord { state, flags, .. } = record;
    // An effort that was not measured is zero to a controller.
    let tau_meas: [f64; MAX_AXES] = core::array::from_fn(|i| state.measured(Signal::Effort, i).unwrap_or(0.0));
    let first = |list| <[f64]>::get(list, ..n).unwrap_or_default();
    let step = Control {
        is_first: flags & flags::AT_REST != 0,
        is_other_law: flags & flags::OTHER_LAW != 0,
        is_faulted: flags & flags::CONTROLLER_FAULT != 0,
        dt: record.dt[0],
        q_dt: record.q_dt[0],
        q_meas: first(&record.q_given),
        tau_meas: first(&tau_meas),
        wrench_meas: record.wrench,
        q_ref: first(&record.q_ref),
        v_ref: first(&record.v_ref),
        a_ref: first(&record.a_ref),
        wrench_ref: record.wrench_ref,
        tau_ff: first(&record.tau_ff),
        command: first(&record.tau_answer),
    };
    super::encode_control(message, stamp_ns, record.cycle, &step);
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
