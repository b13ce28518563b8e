"""Holds the messages of /scene against the schemas that Foxglove publishes (foxglove-schemas-protobuf).

    logs_foxglove.py FILE

Every message on a channel whose schema is called foxglove.* is parsed as that message; a key that the
published schema does not have, or a value of another type, is a fault. Prints one line per channel;
exit code 0 if all hold, 1 if not.
"""

import importlib
import json
import sys
from collections import Counter
from datetime import datetime, timezone

from google.protobuf import json_format
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


def main():
    counts, faults = Counter(), []
    with open(sys.argv[1], "rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
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
    for (topic, schema), count in sorted(counts.items()):
        print(f"{topic}: {count} of {schema}")
    for fault in faults[:20]:
        print(fault, file=sys.stderr)
    if len(counts) < 5:
        print(f"only {len(counts)} channels for viewers", file=sys.stderr)
    return 1 if faults or len(counts) < 5 else 0


if __name__ == "__main__":
    sys.exit(main())
