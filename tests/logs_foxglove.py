"""Reads a log of tello-ctl with programs that know nothing of it: foxglove-sdk, mcap-protobuf-support,
mcap-ros2-support, foxglove-schemas-protobuf, and rosbags for its copy as ROS 2 messages.

    logs_foxglove.py FILE BAG

Each message on a channel whose schema is called foxglove.* is decoded by the schema of the file and by the
published one; a field that the published schema does not have is a fault. So is a message that foxglove-sdk,
which goes by the indexes of the file, does not find or finds elsewhere, a stamp that is not the time of the
message, and a pose, by any of the readers, that is not that of /estim/state to the last bit. BAG is what
`tello-ctl log ros2` makes of FILE. Prints one line per channel; exit code 0 if all hold, 1 if not.
"""

import importlib
import json
import math
import sys
from collections import Counter
from datetime import datetime, timedelta, timezone
from pathlib import Path
from types import SimpleNamespace

from foxglove.datasets import EpisodeReader, ObjectLocation
from mcap.decoder import DecoderFactory
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as Protobuf
from mcap_ros2.decoder import DecoderFactory as Ros2
from rosbags.highlevel import AnyReader

PREFIX = "foxglove."
# Of a quaternion of length 1 computed by another sine.
TURN_TOLERANCE = 1e-15


def published(schema):
    name = schema.removeprefix(PREFIX)
    return getattr(importlib.import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name)


class Folder:
    """What foxglove-sdk reads from: files."""

    def open(self, location):
        return open(location.path, "rb")


class Bytes(DecoderFactory):
    def decoder_for(self, message_encoding, schema):
        return bytes


def of_sdk(path, summary):
    """Times and messages by topic as foxglove-sdk finds them."""
    topics = tuple(channel.topic for channel in summary.channels.values())
    times = (summary.statistics.message_start_time, summary.statistics.message_end_time)
    start, end = (datetime.fromtimestamp(ns // 10**9, timezone.utc) for ns in times)
    location = ObjectLocation("", path)
    episode = SimpleNamespace(
        id="flight", start_time=start, end_time=end + timedelta(seconds=1), locations=[location]
    )
    reader = EpisodeReader(episode, topics, None, Folder())
    found = {}
    for _, channel, message, record in reader.iter_messages(decoder_factories=[Bytes()]):
        found.setdefault(channel.topic, []).append((message.log_time, record))
    return found


def stamp_ns(stamp):
    return stamp.seconds * 10**9 + stamp.nanos if hasattr(stamp, "nanos") else stamp.sec * 10**9 + stamp.nanosec


def numbers_of(position, turn):
    return [position.x, position.y, position.z], [turn.x, turn.y, turn.z, turn.w]


def pose_faults(reader, poses, states):
    """Holds poses by time against those of /estim/state."""
    if poses.keys() != states.keys():
        yield f"{reader}: {len(poses)} poses of {len(states)} states"
    for time_ns in poses.keys() & states.keys():
        position, turn = poses[time_ns]
        state = states[time_ns]
        expected = [0, 0, math.sin(state["theta"] / 2), math.cos(state["theta"] / 2)]
        is_turn = all(abs(a - b) <= TURN_TOLERANCE for a, b in zip(turn, expected))
        if position != [state["x"], state["y"], state["z"]] or not is_turn:
            yield f"{reader} at {time_ns}: {position} {turn}, not {state}"


def of_log(path):
    """Messages by topic as their bytes; states, poses and plots by time; counts and faults."""
    found, states, poses, plots, counts, faults = {}, {}, {}, {}, Counter(), []
    protobuf, ros2 = Protobuf(), Ros2()
    with open(path, "rb") as stream:
        reader = make_reader(stream)
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            found.setdefault(channel.topic, []).append((message.log_time, message.data))
            if channel.topic == "/estim/state":
                states[message.log_time] = json.loads(message.data)
            if not channel.topic.startswith("/scene/"):
                continue
            counts[channel.topic, schema.name] += 1
            decoder = next(
                decode for f in (protobuf, ros2) if (decode := f.decoder_for(channel.message_encoding, schema))
            )
            record = decoder(message.data)
            if schema.name.startswith(PREFIX):
                record = published(schema.name).FromString(message.data)
                if record.SerializeToString() != decoder(message.data).SerializeToString():
                    faults.append(f"{channel.topic} at {message.log_time}: not the published schema")
                known = type(record)()
                known.CopyFrom(record)
                known.DiscardUnknownFields()
                if known != record:
                    faults.append(f"{channel.topic} at {message.log_time}: unknown fields")
            stamp = getattr(record, "timestamp", None) or getattr(record, "header", None)
            stamp = getattr(stamp, "stamp", stamp)
            if stamp and stamp_ns(stamp) != message.log_time:
                faults.append(f"{channel.topic} at {message.log_time}: stamped {stamp}")
            if channel.topic == "/scene/pose":
                poses[message.log_time] = numbers_of(record.pose.position, record.pose.orientation)
            if channel.topic == "/scene/numbers":
                plots[message.log_time] = dict(zip(record.name, record.position, strict=True))
        summary = reader.get_summary()
    faults += pose_faults("mcap-protobuf-support", poses, states)
    for time_ns, numbers in plots.items():
        if any(numbers[f"state.{key}"] != states[time_ns][key] for key in ("x", "y", "z", "theta")):
            faults.append(f"/scene/numbers at {time_ns}: {numbers}")
    if plots.keys() != states.keys():
        faults.append(f"{len(plots)} plots of {len(states)} states")
    return found, states, summary, counts, faults


def of_bag(path, states):
    """Counts and faults of the copy as ROS 2 messages, by rosbags."""
    counts, poses, faults = Counter(), {}, []
    with AnyReader([Path(path)]) as bag:
        for connection, time_ns, data in bag.messages():
            record = bag.deserialize(data, connection.msgtype)
            counts[connection.topic, connection.msgtype] += 1
            if hasattr(record, "header") and stamp_ns(record.header.stamp) != time_ns:
                faults.append(f"{connection.topic} at {time_ns}: stamped {record.header.stamp}")
            if connection.topic == "/tello/pose":
                poses[time_ns] = numbers_of(record.pose.position, record.pose.orientation)
    faults += pose_faults("rosbags", poses, states)
    return counts, faults


def main():
    _, log, bag = sys.argv
    found, states, summary, counts, faults = of_log(log)
    by_sdk = of_sdk(log, summary)
    for topic in sorted(found.keys() | by_sdk.keys()):
        one, other = found.get(topic, []), by_sdk.get(topic, [])
        if one != other:
            faults.append(f"{topic}: {len(one)} messages, by foxglove-sdk {len(other)} or others")
    in_bag, bag_faults = of_bag(bag, states)
    faults += bag_faults
    for (topic, schema), count in sorted((counts | in_bag).items()):
        print(f"{topic}: {count} of {schema}")
    for fault in faults[:20]:
        print(fault, file=sys.stderr)
    if len(counts) < 7 or len(in_bag) < 8:
        print(f"only {len(counts)} channels for viewers, {len(in_bag)} topics", file=sys.stderr)
        return 1
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
