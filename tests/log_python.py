"""Reads a log of tello-ctl with the `mcap` package, which uses no code of its writer.

    log_python.py FILE --topics TOPIC... [--document config.json] [--torn] [--period 0.02] [--cut 0.7]

Checks the head (metadata, attachments), the channels and their schemas, each JSON message against its
schema, the order and grid of the times, and, unless --torn, that the file is complete and its
statistics are right. With --cut, the first part of the file alone must give back the same messages
up to the tear. Prints one line; exit code 0 if all holds, 1 if not.
"""

import argparse
import io
import json
import struct
import sys
from collections import Counter
from pathlib import Path

import zstandard
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, DataEnd, Footer, Message, Metadata, Schema, Statistics
from mcap.stream_reader import StreamReader

# How far from the grid of periods a record may be. s
GRID_TOLERANCE_S = 1e-3
# Of a cut file, everything may be lost that came after the last flush.
LOST_FRACTION_MAX = 0.1
# Records that programs read again, and messages for viewers.
RECORDS = {("json", "jsonschema")}
FOR_VIEWERS = {("protobuf", "protobuf"), ("cdr", "ros2msg")}
TEARS = (McapError, struct.error, ValueError, zstandard.ZstdError)
TYPES = {
    "object": dict,
    "array": list,
    "string": str,
    "boolean": bool,
    "null": type(None),
    "integer": int,
    "number": (int, float),
}


class Log:
    """What a front-to-back reading of `data` gives, and how it ended."""

    def __init__(self, data: bytes):
        self.metadata, self.attachments = {}, {}
        self.schemas, self.channels, self.messages = {}, {}, []
        self.statistics, self.tear = None, None
        is_summary, has_footer = False, False
        try:
            for record in StreamReader(io.BytesIO(data), validate_crcs=True).records:
                if isinstance(record, DataEnd):
                    is_summary = True
                elif isinstance(record, Footer):
                    has_footer = True
                elif isinstance(record, Statistics):
                    self.statistics = record
                elif not is_summary:
                    self.take(record)
        except TEARS as error:
            self.tear = f"{type(error).__name__} {error}".strip()
        if self.tear is None and not has_footer:
            self.tear = "no footer"

    def take(self, record):
        if isinstance(record, Metadata):
            self.metadata[record.name] = record.metadata
        elif isinstance(record, Attachment):
            self.attachments[record.name] = record.data
        elif isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Channel):
            self.channels[record.id] = record
        elif isinstance(record, Message):
            self.messages.append(record)


def parse(text: bytes):
    """JSON as the standard has it: no NaN, no infinity."""

    def refuse(constant):
        raise ValueError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


def mismatch(value, schema, root, path="$"):
    """First place where `value` violates `schema`, or None. Knows the keywords that schemars writes."""
    if schema is True:
        return None
    if "$ref" in schema:
        target = root
        for key in schema["$ref"].removeprefix("#/").split("/"):
            target = target[key]
        return mismatch(value, target, root, path)
    for key in ("anyOf", "oneOf"):
        found = [mismatch(value, option, root, path) for option in schema.get(key, [])]
        if found and all(found):
            return f"{path}: {value!r} fits no option ({found[0]})"
    for part in schema.get("allOf", []):
        if found := mismatch(value, part, root, path):
            return found
    types = schema.get("type", list(TYPES))
    types = [types] if isinstance(types, str) else types
    is_flag = isinstance(value, bool)  # which Python counts among the integers
    if not any(isinstance(value, TYPES[t]) and is_flag <= (t == "boolean") for t in types):
        return f"{path}: {value!r} is not {' or '.join(types)}"
    if "const" in schema and value != schema["const"]:
        return f"{path}: {value!r} is not {schema['const']!r}"
    if "enum" in schema and value not in schema["enum"]:
        return f"{path}: {value!r} is none of {schema['enum']}"
    if isinstance(value, dict):
        return object_mismatch(value, schema, root, path)
    if isinstance(value, list):
        prefix, rest = schema.get("prefixItems", []), schema.get("items", True)
        for i, item in enumerate(value):
            found = mismatch(item, prefix[i] if i < len(prefix) else rest, root, f"{path}[{i}]")
            if found:
                return found
    return None


def object_mismatch(value, schema, root, path):
    properties = schema.get("properties", {})
    for key in schema.get("required", []):
        if key not in value:
            return f"{path}: no key {key!r}"
    for key, item in value.items():
        if key in properties:
            if found := mismatch(item, properties[key], root, f"{path}.{key}"):
                return found
        elif schema.get("additionalProperties") is False:
            return f"{path}: unknown key {key!r}"
    return None


def head_faults(log, document):
    head = log.metadata.get("tello-ctl")
    if head is None:
        yield "no metadata record 'tello-ctl'"
        return
    for key in ("version", "revision", "started_unix_ns"):
        if not head.get(key):
            yield f"metadata without {key}"
    if document not in log.attachments:
        yield f"no attachment {document}"
    for name, data in log.attachments.items():
        try:
            parse(data)
        except ValueError as error:
            yield f"attachment {name}: {error}"


def channel_faults(log, topics):
    found = {channel.topic for channel in log.channels.values()}
    for topic in sorted(set(topics) - found):
        yield f"no channel {topic}"
    for topic in sorted(found - set(topics)):
        yield f"unexpected channel {topic}"
    for channel in log.channels.values():
        schema = log.schemas.get(channel.schema_id)
        encodings = (channel.message_encoding, schema and schema.encoding)
        if encodings not in (FOR_VIEWERS if channel.topic.startswith("/scene/") else RECORDS):
            yield f"{channel.topic}: encodings {encodings}"


def message_faults(log):
    schemas = {}
    for channel in log.channels.values():
        if channel.message_encoding == "json" and channel.schema_id in log.schemas:
            schemas[channel.id] = parse(log.schemas[channel.schema_id].data)
    for message in log.messages:
        channel, schema = log.channels[message.channel_id], schemas.get(message.channel_id, True)
        if channel.message_encoding != "json":
            continue
        try:
            found = mismatch(parse(message.data), schema, schema)
        except ValueError as error:
            found = str(error)
        if found:
            yield f"message {message.sequence} of {channel.topic}: {found}"


def time_faults(log, period_s):
    if not log.messages:
        yield "no messages"
        return
    started = int(log.metadata.get("tello-ctl", {}).get("started_unix_ns", 0))
    before = log.messages[0].log_time
    for message in log.messages:
        if message.log_time < before:
            yield f"message {message.sequence} is {before - message.log_time} ns before the last one"
        before = message.log_time
        t_s = (message.log_time - started) * 1e-9
        if abs(t_s - round(t_s / period_s) * period_s) > GRID_TOLERANCE_S:
            yield f"message {message.sequence} at {t_s:.6f} s is off the grid of {period_s} s"


def ending_faults(log, is_torn):
    if is_torn != (log.tear is not None):
        yield f"torn: {log.tear}" if log.tear else "complete, not torn"
    if log.tear is None:
        counts = Counter(message.channel_id for message in log.messages)
        stated = Counter(log.statistics.channel_message_counts) if log.statistics else None
        if counts != stated:
            yield f"statistics {stated} of messages {counts}"


def cut_faults(log, data, fraction):
    part = Log(data[: int(fraction * len(data))])
    count = len(part.messages)
    if part.tear is None:
        yield f"the first {fraction:.0%} pass for a complete log"
    if part.messages != log.messages[:count]:
        yield f"the first {fraction:.0%} hold other messages than the whole"
    if part.metadata != log.metadata or part.attachments != log.attachments:
        yield f"the first {fraction:.0%} have another head than the whole"
    if count < (fraction - LOST_FRACTION_MAX) * len(log.messages):
        yield f"the first {fraction:.0%} hold only {count} of {len(log.messages)} messages"


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("file", type=Path)
    arguments.add_argument("--topics", nargs="+", required=True, help="exactly the channels")
    arguments.add_argument("--document", default="config.json", help="attached to the head")
    arguments.add_argument("--torn", action="store_true", help="the writer was killed")
    arguments.add_argument("--period", type=float, default=0.02, help="of the loop, in s")
    arguments.add_argument("--cut", type=float, help="fraction of the file to read once more")
    given = arguments.parse_args()

    data = given.file.read_bytes()
    log = Log(data)
    faults = [
        *head_faults(log, given.document),
        *channel_faults(log, given.topics),
        *message_faults(log),
        *time_faults(log, given.period),
        *ending_faults(log, given.torn),
    ]
    if given.cut is not None:
        faults += cut_faults(log, data, given.cut)
    for fault in faults[:20]:
        print(f"{given.file}: {fault}", file=sys.stderr)
    end = f"torn ({log.tear})" if log.tear else "complete"
    print(
        f"{given.file}: {len(data)} bytes, {len(log.messages)} messages on {len(log.channels)} "
        f"channels, {end}, {len(faults)} faults"
    )
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
