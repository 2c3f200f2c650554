//! Files of other writers, and ours in other readers.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests")]
mod made_up;

use std::path::Path;
use std::process::Command;

use made_up::read;
use pkm_record::{ReadOptions, read as read_with, write};

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
