//! Which column lives in which topic. Reading and writing share this one table.

/// Topic of measured states, the time base of a recording.
pub(crate) const STATES: &str = "/joint_states";
/// Topic of commanded efforts.
pub(crate) const COMMANDS: &str = "/joint_commands";
/// Topic of every column that has no place of its own; joint names are column names.
pub(crate) const SIGNALS: &str = "/pkm/signals";
/// Topic of the periods of a loop.
pub(crate) const CYCLES: &str = "/pkm/cycle";
/// Topic of the steps of a controller.
pub(crate) const CONTROLS: &str = "/pkm/control";
/// Topic of measured states' references.
pub(crate) const REFERENCES: &str = "/joint_references";
/// Topic of reference accelerations, as positions.
pub(crate) const REFERENCE_ACCELERATIONS: &str = "/joint_reference_accelerations";
/// Prefix of wrench topics.
pub(crate) const WRENCH: &str = "/wrench/";
/// Prefix of pose topics.
pub(crate) const POSE: &str = "/pose/";

/// Topics of `JointState` with the column prefixes of position, velocity and effort.
pub(crate) const JOINT_TOPICS: [(&str, [Option<&str>; 3]); 6] = [
    (STATES, [Some("q"), Some("dq"), Some("tau")]),
    (REFERENCES, [Some("q_ref"), Some("dq_ref"), Some("tau_ref")]),
    // JointState has no acceleration: it travels as the position of a topic of its own.
    (REFERENCE_ACCELERATIONS, [Some("ddq_ref"), None, None]),
    (COMMANDS, [Some("q_cmd"), Some("dq_cmd"), Some("tau_cmd")]),
    ("/joint_link_states", [Some("q_link"), None, None]),
    ("/joint_temperatures", [Some("temp"), None, None]),
];

/// Components of a wrench in message order.
pub(crate) const WRENCH_PARTS: [&str; 6] = ["fx", "fy", "fz", "mx", "my", "mz"];
/// Components of a pose in message order.
pub(crate) const POSE_PARTS: [&str; 7] = ["x", "y", "z", "qx", "qy", "qz", "qw"];

/// Message types a recording is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Kind {
    Joints,
    Wrench,
    Pose,
}

/// Where a column goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Slot<'a> {
    /// Field 0 to 2 of that joint.
    Joint { topic: &'static str, field: usize, joint: &'a str },
    /// Component of a wrench or pose.
    Part { kind: Kind, sensor: &'a str, part: usize },
}

/// The place of a column.
pub(crate) fn slot(column: &str) -> Slot<'_> {
    let spare = Slot::Joint { topic: SIGNALS, field: 0, joint: column };
    let Some((prefix, rest)) = column.split_once('.') else { return spare };
    for (topic, prefixes) in JOINT_TOPICS {
        if let Some(field) = prefixes.iter().position(|p| *p == Some(prefix)) {
            return Slot::Joint { topic, field, joint: rest };
        }
    }
    let (kind, parts) = match prefix {
        "wrench" => (Kind::Wrench, &WRENCH_PARTS[..]),
        "pose" => (Kind::Pose, &POSE_PARTS[..]),
        _ => return spare,
    };
    let Some((sensor, part)) = rest.rsplit_once('.') else { return spare };
    parts.iter().position(|p| *p == part).map_or(spare, |part| Slot::Part { kind, sensor, part })
}

/// The column of field `field` of the entry `name` of a topic, if the topic has such a column.
///
/// `/joint_states` stands for whichever topic was chosen as time base.
pub(crate) fn column(topic: &str, field: usize, name: &str) -> Option<String> {
    if topic == SIGNALS {
        return (field == 0).then(|| name.to_string());
    }
    if let Some(sensor) = topic.strip_prefix(WRENCH) {
        return Some(format!("wrench.{sensor}.{name}"));
    }
    if let Some(sensor) = topic.strip_prefix(POSE) {
        return Some(format!("pose.{sensor}.{name}"));
    }
    let (_, prefixes) = JOINT_TOPICS.iter().find(|(t, _)| *t == topic)?;
    let prefix = (*prefixes.get(field)?)?;
    Some(format!("{prefix}.{name}"))
}

/// Whether a topic of joint states is one of ours with another meaning than measured states.
pub(crate) fn is_auxiliary(topic: &str) -> bool {
    topic == SIGNALS || JOINT_TOPICS.iter().any(|(t, _)| *t == topic && *t != STATES)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_finds_its_way_back() {
        let columns = [
            "q.a",
            "dq.a.b",
            "tau.",
            "q_ref.a",
            "ddq_ref.a",
            "tau_cmd.a",
            "q_link.a",
            "temp.a",
            "wrench.s.fx",
            "wrench.a/b.c.mz",
            "pose..qw",
            "wrench.s.other",
            "pose.x",
            "current.a",
            "x",
            "tau_ref.a",
        ];
        for name in columns {
            let back = match slot(name) {
                Slot::Joint { topic, field, joint } => column(topic, field, joint),
                Slot::Part { kind: Kind::Wrench, sensor, part } => column(&format!("{WRENCH}{sensor}"), 0, WRENCH_PARTS[part]),
                Slot::Part { sensor, part, .. } => column(&format!("{POSE}{sensor}"), 0, POSE_PARTS[part]),
            };
            assert_eq!(back.as_deref(), Some(name));
        }
    }
}
