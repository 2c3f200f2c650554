"""Bags of ROS 2: written by the packages that ROS users have, read here, and what is written here read by them."""

from pathlib import Path

import numpy as np
import pkm
import pytest

JOINTS = ["shoulder", "élbow", "wrist_roll_3"]
"""Names of several lengths: each moves what follows it to another place in its message."""

HEADER = f"""
{"=" * 80}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{"=" * 80}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
JOINT_STATE = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort" + HEADER


@pytest.fixture
def samples():
    """Stamps [ns], and position, velocity and effort of every joint: numbers whose every byte matters."""
    random = np.random.default_rng(7)
    stamps = 1_700_000_000_123_456_789 + np.arange(40) * 1_000_003
    return stamps, random.standard_normal((3, 40, len(JOINTS)))


def states(samples, fields=(True, True, True), frame="base_link"):
    """Stamp [ns], names and lists of every message; a list is empty where `fields` says so."""
    stamps, values = samples
    for k, stamp in enumerate(stamps):
        yield int(stamp), frame, [list(values[f, k]) if fields[f] else [] for f in range(3)]


def write_rosbags(folder: Path, topics, *, is_little=True, compression=None, storage="MCAP"):
    """A rosbag2 recording; `topics` are names with what `states` gives. The path of its file."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="the package rosbags is not installed")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    time, header, state = (
        store.types[name] for name in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header", "sensor_msgs/msg/JointState")
    )
    writer = rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin[storage])
    if compression == "storage":
        writer.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
    with writer:
        connections = {topic: writer.add_connection(topic, state.__msgtype__, typestore=store) for topic in topics}
        for topic, messages in topics.items():
            for stamp, frame, lists in messages:
                arrays = [np.array(x, dtype=np.float64) for x in lists]
                message = state(header(time(stamp // 10**9, stamp % 10**9), frame), JOINTS, *arrays)
                data = store.serialize_cdr(message, state.__msgtype__, little_endian=is_little)
                writer.write(connections[topic], stamp + 50_000, data)
    (file,) = (path for path in folder.iterdir() if path.name != "metadata.yaml")
    return file


def write_mcap_ros2(path: Path, topics):
    """The same through mcap-ros2-support."""
    writers = pytest.importorskip("mcap_ros2.writer", reason="the package mcap-ros2-support is not installed")
    with open(path, "wb") as file:
        writer = writers.Writer(file)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        for topic, messages in topics.items():
            for stamp, frame, (position, velocity, effort) in messages:
                head = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": frame}
                state = {"header": head, "name": JOINTS, "position": position, "velocity": velocity, "effort": effort}
                writer.write_message(topic, schema, state, log_time=stamp + 50_000, publish_time=stamp)
        writer.finish()
    return path


def same(recording, samples, fields=("q", "dq", "tau")):
    stamps, values = samples
    np.testing.assert_allclose(recording.time, stamps / 1e9, rtol=0, atol=2.5e-7)
    for field, prefix in enumerate(("q", "dq", "tau")):
        for j, joint in enumerate(JOINTS):
            if prefix in fields:
                np.testing.assert_array_equal(recording[f"{prefix}.{joint}"], values[field, :, j])
            else:
                assert f"{prefix}.{joint}" not in recording


@pytest.mark.parametrize("is_little", [True, False], ids=["little-endian", "big-endian"])
@pytest.mark.parametrize("frame", ["", "b", "base", "base_link"])
def test_a_bag_of_rosbags_is_read_to_the_bit(samples, tmp_path, is_little, frame):
    file = write_rosbags(tmp_path / "bag", {"/arm/joint_states": states(samples, frame=frame)}, is_little=is_little)
    same(pkm.read(file), samples)


@pytest.mark.parametrize("frame", ["", "b", "base", "base_link"])
def test_a_bag_of_mcap_ros2_support_is_read_to_the_bit(samples, tmp_path, frame):
    file = write_mcap_ros2(tmp_path / "bag.mcap", {"/arm/joint_states": states(samples, frame=frame)})
    same(pkm.read(file), samples)


@pytest.mark.parametrize("fields", [(True, False, True), (True, False, False), (False, True, True), (True, True, False)])
def test_empty_lists_are_columns_that_are_not_there(samples, tmp_path, fields):
    wanted = [prefix for prefix, is_there in zip(("q", "dq", "tau"), fields, strict=True) if is_there]
    for is_little in (True, False):
        bag = {"/joint_states": states(samples, fields)}
        same(pkm.read(write_rosbags(tmp_path / f"bag{is_little}", bag, is_little=is_little)), samples, wanted)
    same(pkm.read(write_mcap_ros2(tmp_path / "bag.mcap", {"/joint_states": states(samples, fields)})), samples, wanted)


def test_the_folder_of_a_bag_is_read_as_its_file(samples, tmp_path):
    folder = tmp_path / "bag"
    file = write_rosbags(folder, {"/joint_states": states(samples)})
    whole, by_file = pkm.read(folder), pkm.read(file)
    assert whole.name == str(folder) and whole.signals == by_file.signals
    np.testing.assert_array_equal(whole["q.shoulder"], by_file["q.shoulder"])
    # Split, it is not one recording.
    (folder / "bag_1.mcap").write_bytes(file.read_bytes())
    with pytest.raises(ValueError, match=r"bag: a folder with 2 MCAP files"):
        pkm.read(folder)


def test_a_bag_in_sqlite_is_refused_with_what_to_do(samples, tmp_path):
    folder = tmp_path / "old"
    file = write_rosbags(folder, {"/joint_states": states(samples)}, storage="SQLITE3")
    assert file.suffix == ".db3"
    for path in [folder, file]:
        with pytest.raises(ValueError, match=r"SQLite is not read: make it an MCAP with `ros2 bag convert`"):
            pkm.read(path)


def test_compressed_storage_of_rosbags_is_read(samples, tmp_path):
    same(pkm.read(write_rosbags(tmp_path / "bag", {"/joint_states": states(samples)}, compression="storage")), samples)


def test_several_topics_ask_for_a_choice(samples, tmp_path):
    other = (samples[0], samples[1] + 1.0)
    topics = {"/left/joint_states": states(samples), "/right/joint_states": states(other)}
    file = write_rosbags(tmp_path / "bag", topics)
    with pytest.raises(ValueError, match="--topic: /left/joint_states, /right/joint_states"):
        pkm.read(file)
    same(pkm.read(file, topic="/left/joint_states"), samples)
    same(pkm.read(file, topic="/right/joint_states"), other)


def test_rosbags_and_mcap_ros2_support_read_what_is_written_here(tmp_path):
    mcap_reader = pytest.importorskip("mcap.reader", reason="the package mcap is not installed")
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="the package mcap-ros2-support is not installed")
    stores = pytest.importorskip("rosbags.typesys", reason="the package rosbags is not installed")
    robot = pkm.robots.load("five_bar")
    recording = pkm.simulate(robot, robot, seed=3, duration_s=0.5, rate_hz=200.0)
    path = tmp_path / "a.mcap"
    pkm.write(path, recording)
    store = stores.get_typestore(stores.Stores.ROS2_HUMBLE)
    columns = {"/joint_states": ("q", None, "tau"), "/joint_references": ("q_ref", "dq_ref", None)}
    seen = dict.fromkeys(columns, 0)
    with open(path, "rb") as file:
        reader = mcap_reader.make_reader(file, validate_crcs=True, decoder_factories=[decoder.DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            k = seen[channel.topic]
            seen[channel.topic] += 1
            for state in (decoded, store.deserialize_cdr(message.data, schema.name)):
                assert state.header.stamp.sec * 10**9 + state.header.stamp.nanosec == round(recording.time[k] * 1e9)
                for values, prefix in zip((state.position, state.velocity, state.effort), columns[channel.topic], strict=True):
                    wanted = [recording[f"{prefix}.{joint}"][k] for joint in state.name] if prefix else []
                    np.testing.assert_array_equal(np.asarray(values), wanted)
    assert seen == dict.fromkeys(columns, len(recording))
