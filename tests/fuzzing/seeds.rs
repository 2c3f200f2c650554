//! Files to begin with: shipped robots, examples of the documentation, recordings made here, and the inputs that are kept.

use alloc::collections::BTreeMap;
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use pkm_ident::Recording;
use pkm_record::{Attachment, Attachments, Control, ControlStep};

/// Seeds of a target, the kept ones last.
///
/// # Panics
/// If the folder of kept inputs cannot be read.
#[must_use]
pub fn of(target: &str) -> Vec<Vec<u8>> {
    let robots = |text: fn(&pkm_robots::Shipped) -> &'static str| pkm_robots::ALL.iter().map(|r| text(r).as_bytes().to_vec()).collect();
    let mut out: Vec<Vec<u8>> = match target {
        "urdf" => robots(|robot| robot.urdf),
        "robot_toml" => robots(|robot| robot.toml),
        "controller_toml" => files(&root().join("docs/examples/controllers")),
        "daemon_toml" => vec![fs::read(root().join("docs/examples/daemon.toml")).expect("the example"), every_key().to_vec()],
        "frames" => vec![super::frames::session(), super::frames::motion()],
        "csv" => vec![recorded("A.csv")],
        "mcap" => vec![recorded("A.mcap"), bag_of(&message())],
        "cdr" => vec![message(), steps_message()],
        _ => Vec::new(),
    };
    out.extend(files(&root().join("tests/corpora").join(target)));
    out
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A daemon.toml with every key there is.
fn every_key() -> &'static [u8] {
    b"robot = \"prs3\"\ncontroller = \"c.toml\"\ndirectory = \"meet\"\nrealtime = \"off\"\nblack_box_s = 2.0\n\
    [hal]\nkind = \"iceoryx2\"\nvalid_for_s = 0.1\nlate_s = 0.02\nstale_s = 0.1\n\
    [loop]\nstall_s = 0.1\nsupervisor_s = 1.0\nconsecutive_overruns = 5\noverrun_share = 0.1\nsoft_start_s = 0.5\nstop_s = 0.5\npriority = 80\ncpu = 1\n\
    [limits]\neffort = [100.0, 200.0, 300.0]\neffort_rate = 1e5\nvelocity = 0.3\nlower = 0.01\nupper = 0.25\nposition_gain = 20.0\nvelocity_gain = 1e4\n\
    following = 0.05\nstuck = 0.01\njump = 0.01\nmove_speed = 0.1\n\
    [safe]\nkind = \"hold\"\nstiffness = 2e4\ndamping = 2e3\neffort = 100.0\nramp_s = 0.5\n[home]\nq = [0.1, 0.12, 0.14]\n[run]\nmotion = \"m.csv\"\n"
}

/// Contents of the files of a folder, by name; none where there is no folder.
fn files(folder: &Path) -> Vec<Vec<u8>> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    paths.iter().map(|path| fs::read(path).expect("a readable file")).collect()
}

/// A recording with everything a recording can have, as this library writes it.
fn recorded(name: &str) -> Vec<u8> {
    let columns = ["q.a", "dq.a", "tau.a", "q_ref.a", "temp.a", "wrench.hand.fx", "pose.marker.qw", "current.a"];
    let time: Vec<f64> = (0..12).map(|k| f64::from(k) / 100.0).collect();
    let mut recording = Recording { time: time.clone(), ..Recording::default() };
    for (k, column) in columns.iter().enumerate() {
        recording.signals.insert((*column).to_string(), time.iter().map(|t| t + k as f64).collect());
    }
    recording.meta.gravity = Some([0.0, 0.1, -9.8]);
    recording.meta.other.insert("note".to_string(), "text".to_string());
    let file = Attachment { name: "robot.toml".to_string(), media_type: "application/toml".to_string(), bytes: b"name = 'x'".to_vec() };
    let controls = time.iter().zip(0..).map(|(t, k)| ControlStep::new(*t, k, &step())).collect();
    let carried = Attachments {
        files: vec![file],
        keys: BTreeMap::from([("hash".to_string(), "abc".to_string())]),
        controls,
        ..Attachments::default()
    };
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(name);
    pkm_record::write(&path, &recording, &carried).expect("a recording");
    fs::read(path).expect("the recording")
}

fn step() -> Control<'static> {
    Control {
        is_first: true,
        is_other_law: false,
        is_faulted: false,
        dt: 0.01,
        q_dt: 0.02,
        q_meas: &[1.0, 2.0],
        tau_meas: &[3.0, 4.0],
        wrench_meas: [0.0; 6],
        q_ref: &[5.0, 6.0],
        v_ref: &[7.0, 8.0],
        a_ref: &[9.0, 10.0],
        wrench_ref: [0.0; 6],
        tau_ff: &[11.0, 12.0],
        command: &[13.0, 14.0],
    }
}

/// A `JointState` in CDR: stamp, empty frame, one joint, one position.
fn message() -> Vec<u8> {
    let mut bytes = vec![0, 1, 0, 0];
    for word in [5_u32, 500, 1, 0, 1, 2, u32::from_le_bytes(*b"a\0\0\0"), 1] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(1.5_f64.to_le_bytes());
    bytes.extend([0; 8]);
    bytes
}

/// A step of a controller in CDR, cut out of a file.
fn steps_message() -> Vec<u8> {
    let file = recorded("A.mcap");
    let mut out = Vec::new();
    let stream = mcap::MessageStream::new(&file).expect("a file of our own");
    for message in stream.flatten() {
        if message.channel.topic == "/pkm/control" {
            out = message.data.into_owned();
        }
    }
    out
}

/// A whole file with `data` as the message of every kind that is read; neither packed nor summed up, so that changes reach what is inside.
#[must_use]
pub fn bag_of(data: &[u8]) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    // Into memory: nothing refuses.
    let _ = write_bag(&mut out, data);
    out.into_inner()
}

fn write_bag(out: &mut Cursor<Vec<u8>>, data: &[u8]) -> mcap::McapResult<()> {
    let options = WriteOptions::new().compression(None::<Compression>).compression_threads(0).calculate_chunk_crcs(false);
    let mut writer = options.calculate_data_section_crc(false).create(out)?;
    for (topic, kind) in [
        ("/joint_states", "sensor_msgs/msg/JointState"),
        ("/pkm/signals", "sensor_msgs/msg/JointState"),
        ("/wrench/hand", "geometry_msgs/msg/WrenchStamped"),
        ("/pose/marker", "geometry_msgs/msg/PoseStamped"),
        ("/pkm/control", "pkm_msgs/msg/Control"),
    ] {
        let schema = writer.add_schema(kind, "ros2msg", b"")?;
        let channel_id = writer.add_channel(schema, topic, "cdr", &BTreeMap::new())?;
        for sequence in 0..2 {
            let time = u64::from(sequence) * 1_000_000;
            writer.write_to_known_channel(&MessageHeader { channel_id, sequence, log_time: time, publish_time: time }, data)?;
        }
    }
    writer.finish()?;
    Ok(())
}
