"""Writes MCAP files as rosbag2 does (other writer, zstd, other topics) into the directory given."""

import sys

from mcap.writer import CompressionType
from mcap_ros2.writer import Writer

SEPARATOR = "=" * 80
HEADER = f"""{SEPARATOR}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{SEPARATOR}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
JOINTS = f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{HEADER}"""
TEXT = "string data\n"


def state(stamp_ns, names, position=(), velocity=(), effort=()):
    stamp = {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}
    return {
        "header": {"stamp": stamp, "frame_id": "base"},
        "name": list(names),
        "position": list(position),
        "velocity": list(velocity),
        "effort": list(effort),
    }


def bag(path, messages, compression=CompressionType.ZSTD):
    with open(path, "wb") as file:
        writer = Writer(file, compression=compression)
        joints = writer.register_msgdef("sensor_msgs/msg/JointState", JOINTS)
        text = writer.register_msgdef("std_msgs/msg/String", TEXT)
        for log_time, topic, message in messages:
            schema = text if "data" in message else joints
            writer.write_message(topic, schema, message, log_time=log_time)
        writer.finish()


def main(folder):
    ms = 10**6
    start = 5 * 10**9
    # Names change their order, one joint is missing once, messages are out of order and one is there twice.
    ordered = [
        (start, "/rosout", {"data": "hello"}),
        (start, "/arm/joint_states", state(start, "ab", [1, 2], [], [10, 20])),
        (start, "/arm/joint_states", state(start + 2 * ms, "ba", [22, 21], [], [40, 30])),
        (start, "/arm/joint_states", state(start + 1 * ms, "ba", [12, 11], [], [25, 15])),
        (start, "/arm/joint_states", state(start + 1 * ms, "ba", [99, 99], [], [99, 99])),
        (start, "/arm/joint_states", state(start + 3 * ms, "a", [31])),
        # Nearest within half a millisecond; the last one is too far from any.
        (start, "/joint_references", state(start + 0.3 * ms // 1, "a", [0.5])),
        (start, "/joint_references", state(start + 10 * ms, "a", [9.5])),
    ]
    ordered = [(log, topic, {**m, "header": whole(m["header"])} if "header" in m else m) for log, topic, m in ordered]
    bag(f"{folder}/one.mcap", ordered)
    bag(f"{folder}/plain.mcap", ordered, CompressionType.NONE)
    two = [(k * ms, topic, state(0, "a", [k])) for k in range(4) for topic in ("/left/joint_states", "/right/joint_states")]
    bag(f"{folder}/two.mcap", two)
    bag(f"{folder}/none.mcap", [(0, "/rosout", {"data": "hello"})])


def whole(header):
    stamp = {key: int(value) for key, value in header["stamp"].items()}
    return {**header, "stamp": stamp}


if __name__ == "__main__":
    main(sys.argv[1])
