"""Prints the first message of every topic of an MCAP file as one JSON object, read with the packages ROS 2 users have."""

import json
import math
import sys

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory


def plain(value):
    """A message as dictionaries and lists; NaN as null."""
    if hasattr(value, "__slots__"):
        return {name.lstrip("_"): plain(getattr(value, name)) for name in value.__slots__}
    if isinstance(value, float):
        return None if math.isnan(value) else value
    if isinstance(value, (str, int)):
        return value
    return [plain(item) for item in value]


def main(path):
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        answer = {
            "profile": reader.get_header().profile,
            "messages": summary.statistics.message_count,
            "attachments": [a.name for a in reader.iter_attachments()],
            "metadata": {m.name: dict(m.metadata) for m in reader.iter_metadata()},
            "topics": {},
        }
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            if channel.topic not in answer["topics"]:
                first = {"schema": schema.name, "encoding": schema.encoding, "log_time": message.log_time}
                answer["topics"][channel.topic] = {**first, "message": plain(decoded)}
    print(json.dumps(answer))


if __name__ == "__main__":
    main(sys.argv[1])
