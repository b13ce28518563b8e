"""Holds the messages of /scene against the schemas that Foxglove publishes (foxglove-schemas-protobuf),
and reads the whole log with foxglove-sdk.

    logs_foxglove.py FILE

Every message on a channel whose schema is called foxglove.* is parsed as that message; a key that the
published schema does not have, or a value of another type, is a fault. So is a message that
foxglove-sdk, which goes by the indexes of the file, does not find or decode, or finds elsewhere. Prints
one line per channel; exit code 0 if all hold, 1 if not.
"""

import importlib
import json
import sys
from collections import Counter
from datetime import datetime, timedelta, timezone
from types import SimpleNamespace

from foxglove.datasets import EpisodeReader, ObjectLocation
from google.protobuf import json_format
from mcap.decoder import DecoderFactory
from mcap.reader import make_reader

PREFIX = "foxglove."


def times_as_text(value, key=None):
    """The JSON schemas write times as sec and nsec, protobuf's JSON as text; else they are the same."""
    if isinstance(value, dict):
        if value.keys() == {"sec", "nsec"}:
            if key == "lifetime":
                return f"{value['sec']}.{value['nsec']:09d}s"
            moment = datetime.fromtimestamp(value["sec"], timezone.utc)
            return f"{moment:%Y-%m-%dT%H:%M:%S}.{value['nsec']:09d}Z"
        return {key: times_as_text(item, key) for key, item in value.items()}
    if isinstance(value, list):
        return [times_as_text(item) for item in value]
    return value


def published(schema):
    name = schema.removeprefix(PREFIX)
    return getattr(importlib.import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name)


class Folder:
    """What foxglove-sdk reads from: files."""

    def open(self, location):
        return open(location.path, "rb")


class Json(DecoderFactory):
    def decoder_for(self, message_encoding, schema):
        return json.loads if (message_encoding, schema.encoding) == ("json", "jsonschema") else None


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
    for _, channel, message, record in reader.iter_messages(decoder_factories=[Json()]):
        found.setdefault(channel.topic, []).append((message.log_time, record))
    return found


def main():
    counts, faults, found = Counter(), [], {}
    with open(sys.argv[1], "rb") as stream:
        reader = make_reader(stream)
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            topic = found.setdefault(channel.topic, [])
            topic.append((message.log_time, json.loads(message.data)))
            if not schema.name.startswith(PREFIX):
                continue
            counts[channel.topic, schema.name] += 1
            record = json.loads(message.data)
            try:
                json_format.ParseDict(times_as_text(record), published(schema.name)())
            except json_format.ParseError as error:
                faults.append(f"{channel.topic} at {message.log_time}: {error}")
            stamp = record.get("timestamp")
            if stamp and stamp["sec"] * 10**9 + stamp["nsec"] != message.log_time:
                faults.append(f"{channel.topic} at {message.log_time}: stamped {stamp}")
        by_sdk = of_sdk(sys.argv[1], reader.get_summary())
    for topic in sorted(found.keys() | by_sdk.keys()):
        one, other = found.get(topic, []), by_sdk.get(topic, [])
        if one != other:
            faults.append(f"{topic}: {len(one)} messages, by foxglove-sdk {len(other)} or others")
    for (topic, schema), count in sorted(counts.items()):
        print(f"{topic}: {count} of {schema}")
    for fault in faults[:20]:
        print(fault, file=sys.stderr)
    if len(counts) < 5:
        print(f"only {len(counts)} channels for viewers", file=sys.stderr)
    return 1 if faults or len(counts) < 5 else 0


if __name__ == "__main__":
    sys.exit(main())
