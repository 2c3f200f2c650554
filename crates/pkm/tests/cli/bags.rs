//! Bags of ROS 2, as a big-endian machine writes them, are read by every verb that reads recordings; several topics ask for a choice.

extern crate alloc;

use alloc::collections::BTreeMap;
use std::fs;
use std::io::Cursor;
use std::path::Path;

use mcap::WriteOptions;
use mcap::records::MessageHeader;

use crate::fixture::{csv_lines, prints, refused, rig};

/// A message of ROS 2 in plain CDR, big-endian: every number aligned to its size.
#[derive(Default)]
struct Message(Vec<u8>);

impl Message {
    fn align(&mut self, to: usize) {
        self.0.resize(self.0.len().next_multiple_of(to), 0);
    }

    fn u32(&mut self, value: u32) {
        self.align(4);
        self.0.extend(value.to_be_bytes());
    }

    fn text(&mut self, text: &str) {
        self.u32(u32::try_from(text.len() + 1).unwrap());
        self.0.extend(text.as_bytes());
        self.0.push(0);
    }

    fn numbers(&mut self, values: &[f64]) {
        self.u32(u32::try_from(values.len()).unwrap());
        for value in values {
            self.align(8);
            self.0.extend(value.to_be_bytes());
        }
    }

    /// The message behind the four bytes that say how it is encoded.
    fn finish(self) -> Vec<u8> {
        [&[0, 0, 0, 0], self.0.as_slice()].concat()
    }
}

fn joint_state(t: f64, lists: [&[f64]; 3]) -> Vec<u8> {
    let mut message = Message::default();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few seconds")]
    let (sec, nanosec) = (t as u32, ((t - t.floor()) * 1e9).round() as u32);
    message.u32(sec);
    message.u32(nanosec);
    message.text("base");
    message.u32(2);
    ["j1", "j2"].iter().for_each(|name| message.text(name));
    lists.iter().for_each(|list| message.numbers(list));
    message.finish()
}

/// The recording in `csv` as a bag: measured states under `/arm/joint_states`, the same at rest under `/other/joint_states`.
fn bag(csv: &Path, to: &Path) {
    let (first, lines) = csv_lines(&csv.to_path_buf());
    let names: Vec<&str> = lines[first - 1].split(',').collect();
    let mut out = Cursor::new(Vec::new());
    let mut writer = WriteOptions::new().compression_threads(0).profile("ros2").create(&mut out).unwrap();
    let schema = writer.add_schema("sensor_msgs/msg/JointState", "ros2msg", b"std_msgs/Header header").unwrap();
    let topics = ["/arm/joint_states", "/other/joint_states", "/joint_references"];
    let channels = topics.map(|topic| writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap());
    for line in &lines[first..] {
        let values: Vec<f64> = line.split(',').map(|field| field.parse().unwrap()).collect();
        let column = |name: &str| values[names.iter().position(|n| *n == name).unwrap()];
        let both = |prefix: &str| ["j1", "j2"].map(|joint| column(&format!("{prefix}.{joint}")));
        let t = column("t");
        let messages = [
            joint_state(t, [&both("q"), &[], &both("tau")]),
            joint_state(t, [&[0.0, 0.0], &[], &[0.0, 0.0]]),
            joint_state(t, [&both("q_ref"), &both("dq_ref"), &[]]),
        ];
        for (channel_id, message) in channels.into_iter().zip(messages) {
            let header = MessageHeader { channel_id, sequence: 0, log_time: 1, publish_time: 1 };
            writer.write_to_known_channel(&header, &message).unwrap();
        }
    }
    writer.finish().unwrap();
    drop(writer);
    fs::write(to, out.into_inner()).unwrap();
}

#[test]
fn every_verb_reads_bags_and_asks_for_a_topic_where_there_are_several() {
    let folder = rig();
    for seed in ["1", "2"] {
        let out = format!("{seed}.csv");
        prints(folder.path(), &["simulate", "rig.toml", "--out", &out, "--seed", seed, "--duration", "10", "--rate", "200"]);
        bag(&folder.path().join(out), &folder.path().join(format!("{seed}.mcap")));
    }
    let (topic, fast) = (["--topic", "/arm/joint_states"], ["--null-runs", "19"]);
    let both = ["--recording", "1.mcap", "--holdout", "2.mcap"];
    let verbs: [&[&[&str]]; 6] = [
        &[&["convert", "1.mcap", "back.csv"]],
        &[&["simulate", "rig.toml", "--out", "C.csv", "--reference", "1.mcap", "--duration", "1"]],
        &[&["twin", "rig.toml", "--recording", "1.mcap"]],
        &[&["identify", "rig.toml", "--out", "better.toml"], &both],
        &[&["diagnose", "rig.toml", "--json", "out.json"], &both, &fast],
        &[&["trial-null", "rig.toml", "--runs", "1"], &both, &fast],
    ];
    for verb in verbs {
        let arguments = verb.concat();
        refused(folder.path(), &arguments, &["1.mcap", "choose one with --topic: /arm/joint_states, /other/joint_states"]);
        prints(folder.path(), &[&arguments[..], &topic].concat());
    }
    // The folder of a bag stands for its file, and says the same.
    let verdict = || fs::read_to_string(folder.path().join("out.json")).unwrap();
    prints(folder.path(), &[&["diagnose", "rig.toml", "--json", "out.json"][..], &both, &fast, &topic].concat());
    let by_file = verdict();
    fs::create_dir(folder.path().join("night")).unwrap();
    fs::rename(folder.path().join("2.mcap"), folder.path().join("night/night_0.mcap")).unwrap();
    let by_folder = ["--recording", "1.mcap", "--holdout", "night"];
    prints(folder.path(), &[&["diagnose", "rig.toml", "--json", "out.json"][..], &by_folder, &fast, &topic].concat());
    assert_eq!(verdict(), by_file.replace("2.mcap", "night"));
    // Text with every digit on both sides: the numbers came through to the bit, and times, which are whole nanoseconds in a bag, as those.
    let numbers = |name: &str| {
        let (first, lines) = csv_lines(&folder.path().join(name));
        let split = |line: &String| {
            let (t, rest) = line.split_once(',').unwrap();
            #[expect(clippy::cast_possible_truncation, reason = "a few seconds in nanoseconds")]
            let ns = t.parse::<f64>().map_or(-1, |t| (1e9 * t).round() as i64);
            (ns, rest.to_string())
        };
        lines[first - 1..].iter().map(split).collect::<Vec<_>>()
    };
    assert!(numbers("back.csv") == numbers("1.csv"), "the way through the bag changes numbers");
}
