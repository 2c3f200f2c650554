//! Files of other writers, and ours in other readers.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests")]
mod made_up;

use std::path::Path;
use std::process::Command;

use made_up::read;
use pkm_hal::cycle::{CycleRecord, Phase, flags};
use pkm_record::cycles::{Folder, Layout, Options, Recorder};
use pkm_record::{Attachments, Control, ControlStep, ReadOptions, read as read_with, write};

/// Runs a script of this folder; none, with a word on why, where Python lacks the packages.
fn python(script: &str, argument: &Path) -> Option<String> {
    let can = Command::new("python3").args(["-c", "import mcap_ros2.writer, mcap.reader"]).output();
    if !can.is_ok_and(|o| o.status.success()) {
        println!("not run: python3 with mcap and mcap-ros2-support is not installed");
        return None;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests").join(script);
    let output = Command::new("python3").arg(script).arg(argument).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8(output.stdout).unwrap())
}

#[test]
fn a_rosbag2_file_is_read_by_joint_name_and_stamp() {
    let directory = tempfile::tempdir().unwrap();
    if python("write_with_python.py", directory.path()).is_none() {
        return;
    }
    for name in ["one.mcap", "plain.mcap"] {
        let recording = read(&directory.path().join(name)).unwrap();
        assert_eq!(recording.time, [5.0, 5.001, 5.002, 5.003]);
        assert_eq!(recording.signal("q.a").unwrap(), [1.0, 11.0, 21.0, 31.0]);
        assert_eq!(recording.signal("q.b").unwrap()[..3], [2.0, 12.0, 22.0]);
        assert_eq!(recording.signal("tau.b").unwrap()[..3], [20.0, 25.0, 40.0]);
        assert!(recording.signal("q.b").unwrap()[3].is_nan() && recording.signal("tau.a").unwrap()[3].is_nan());
        assert_eq!(recording.signal("dq.a"), None);
        let reference = recording.signal("q_ref.a").unwrap();
        assert!(reference[0].to_bits() == 0.5f64.to_bits() && reference[1..].iter().all(|v| v.is_nan()), "{reference:?}");
    }
}

#[test]
fn several_topics_ask_for_a_choice() {
    let directory = tempfile::tempdir().unwrap();
    if python("write_with_python.py", directory.path()).is_none() {
        return;
    }
    let path = directory.path().join("two.mcap");
    let text = read(&path).unwrap_err().to_string();
    assert!(text.ends_with("choose one with --topic: /left/joint_states, /right/joint_states"), "{text}");
    let chosen = |topic: &str| read_with(&path, &ReadOptions { topic: Some(topic.into()), recover: false });
    // Nobody set the stamps: time is that of logging.
    assert_eq!(chosen("/right/joint_states").unwrap().time, [0.0, 0.001, 0.002, 0.003]);
    let text = chosen("/middle").unwrap_err().to_string();
    assert!(text.ends_with("(there is: /left/joint_states, /right/joint_states)"), "{text}");
    let text = read(&directory.path().join("none.mcap")).unwrap_err().to_string();
    assert!(text.ends_with("no topic of type sensor_msgs/msg/JointState (topics: /rosout)"), "{text}");
}

#[test]
fn our_file_is_read_by_ros_tools() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("A.mcap");
    write(&path, &made_up::recording(20, 7.5), &made_up::attachments()).unwrap();
    let Some(json) = python("read_with_python.py", &path) else { return };
    for part in [
        "\"profile\": \"ros2\"",
        "\"messages\": 180",
        "\"attachments\": [\"robot.toml\"]",
        "\"tau\": \"measured\"",
        "\"/joint_states\": {\"schema\": \"sensor_msgs/msg/JointState\", \"encoding\": \"ros2msg\", \"log_time\": 7500000000",
        "\"stamp\": {\"sec\": 7, \"nanosec\": 500000000}",
        "\"name\": [\"a\", \"leg 2\"]",
        "\"/wrench/hand\": {\"schema\": \"geometry_msgs/msg/WrenchStamped\"",
        "\"/pose/marker\": {\"schema\": \"geometry_msgs/msg/PoseStamped\"",
        "\"/joint_temperatures\"",
        "\"/joint_link_states\"",
        "\"/joint_reference_accelerations\"",
    ] {
        assert!(json.contains(part), "{part} is not in {json}");
    }
}

#[test]
fn periods_and_steps_are_decoded_by_ros_tools_from_the_definitions_in_the_file() {
    let directory = tempfile::tempdir().unwrap();
    let layout = Layout { joints: vec!["a".into()], epoch_ns: 5_000_000_000, carried: made_up::attachments(), ..Layout::default() };
    let mut recorder = Recorder::begin(Box::new(Folder::new(directory.path())), layout, Options::default(), 0).unwrap();
    let mut record = CycleRecord::new(1, 0);
    (record.cycle, record.planned_ns, record.skipped, record.dt) = (7, 11, 2, [0.001]);
    (record.flags, record.phase, record.value) = (flags::NEW_STATE | flags::SAFE, Phase::SafeStop.code(), [-0.5]);
    (record.state.stamp_ns, record.command.tau[0], record.wrench[5]) = (13, 2.5, 6.5);
    recorder.push(&record, 0);
    recorder.finish(1).1.unwrap();
    let Some(json) = python("read_with_python.py", &directory.path().join("cycles_0001.mcap")) else { return };
    for part in [
        "\"/pkm/cycle\": {\"schema\": \"pkm_msgs/msg/Cycle\", \"encoding\": \"ros2msg\", \"log_time\": 5000000013",
        "\"cycle\": 7, \"planned_ns\": 11,",
        "\"skipped\": 2, ",
        "\"dt\": 0.001, \"motion_time\": 0.0, \"value\": -0.5,",
        "\"phase\": 7,",
        "\"flags\": 65,",
        "\"tau_ff\": [0.0], \"tau_cmd\": [2.5], \"wrench\": [0.0, 0.0, 0.0, 0.0, 0.0, 6.5]",
        "\"attachments\": [\"robot.toml\"]",
    ] {
        assert!(json.contains(part), "{part} is not in {json}");
    }
    let step = Control {
        is_first: true,
        is_other_law: false,
        is_faulted: false,
        dt: 0.25,
        q_dt: 0.75,
        q_meas: &[1.5],
        tau_meas: &[2.5],
        wrench_meas: [1.0; 6],
        q_ref: &[3.5],
        v_ref: &[4.5],
        a_ref: &[5.5],
        wrench_ref: [2.0; 6],
        tau_ff: &[6.5],
        command: &[7.5],
    };
    let carried = Attachments { controls: vec![ControlStep::new(7.5, 9, &step)], ..made_up::attachments() };
    let path = directory.path().join("A.mcap");
    write(&path, &made_up::recording(20, 7.5), &carried).unwrap();
    let Some(json) = python("read_with_python.py", &path) else { return };
    let part = "\"number\": 9, \"flags\": 1, \"dt\": 0.25, \"q_meas\": [1.5], \"tau_meas\": [2.5], \"wrench_meas\": [1.0, 1.0, 1.0, 1.0, 1.0, 1.0], \
                \"q_ref\": [3.5], \"v_ref\": [4.5], \"a_ref\": [5.5], \"wrench_ref\": [2.0, 2.0, 2.0, 2.0, 2.0, 2.0], \"tau_ff\": [6.5], \"command\": [7.5], \"q_dt\": 0.75";
    assert!(json.contains(part), "{json}");
}

#[test]
fn a_folder_stands_for_its_only_file() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("rosbag2_2026");
    std::fs::create_dir(&bag).unwrap();
    let say = || read(&bag).unwrap_err().to_string().replace(&bag.display().to_string(), "bag");
    assert_eq!(say(), "bag: a folder with 0 MCAP files (a bag of one is read; of a split one, name the file)");
    std::fs::write(bag.join("metadata.yaml"), "rosbag2_bagfile_information:\n").unwrap();
    std::fs::write(bag.join("bag_0.db3"), b"SQLite format 3\0").unwrap();
    assert_eq!(say(), "bag: a rosbag2 in SQLite is not read: make it an MCAP with `ros2 bag convert` (storage_id: mcap)");
    let (_guard, recorded) = made_up::file("A.csv", b"t,q.a\n0,1\n0.5,2\n");
    write(&bag.join("bag_0.mcap"), &read(&recorded).unwrap(), &Attachments::default()).unwrap();
    let whole = read(&bag).unwrap();
    assert_eq!((whole.name.as_str(), whole.signal("q.a").unwrap()), (bag.to_str().unwrap(), &[1.0, 2.0][..]));
    std::fs::copy(bag.join("bag_0.mcap"), bag.join("bag_1.mcap")).unwrap();
    assert_eq!(say(), "bag: a folder with 2 MCAP files (a bag of one is read; of a split one, name the file)");
}
