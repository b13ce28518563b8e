"""Watches a flight of tello-ctl as Foxglove and Lichtblick do, with the package `websockets`.

    live_foxglove.py ws://127.0.0.1:8765 OUT [--until PHASE]

Subscribes to TOPICS and writes each message to OUT, one JSON object per line: topic, time in ns since
1970, the message, as hexadecimal digits if it is no JSON. Ends 50 poses after /scene/log message PHASE. Prints the
channels as one JSON object: topic, name of the schema, its properties if they are JSON. Exit code 1 on anything that the
protocol does not allow.
"""

import argparse
import json
import struct
import sys

from foxglove_schemas_protobuf.Log_pb2 import Log
from websockets.sync.client import connect

PROTOCOL = "foxglove.sdk.v1"
TOPICS = ("/estim/state", "/scene/flight", "/scene/log")
# Opcode, subscription, time in ns; the message follows.
HEAD = struct.Struct("<BIQ")
MESSAGE = 1
POSES = 50
ENCODINGS = {("json", "jsonschema"), ("protobuf", "protobuf"), ("cdr", "ros2msg")}


def advertised(socket):
    """Channels by topic, once those that we want are there."""
    channels = {}
    while not set(TOPICS) <= channels.keys():
        message = json.loads(socket.recv(timeout=5))
        if message["op"] == "advertise":
            channels |= {channel["topic"]: channel for channel in message["channels"]}
    return channels


def properties(channel):
    is_json = channel["encoding"] == "json"
    return sorted(json.loads(channel["schema"])["properties"]) if is_json else []


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("url")
    arguments.add_argument("out")
    arguments.add_argument("--until", default="flying")
    given = arguments.parse_args()

    with connect(given.url, subprotocols=[PROTOCOL]) as socket, open(given.out, "w") as out:
        channels = advertised(socket)
        wanted = [{"id": i, "channelId": channels[topic]["id"]} for i, topic in enumerate(TOPICS)]
        socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        remaining = None
        while remaining != 0:
            data = socket.recv(timeout=20)
            if isinstance(data, str):
                continue
            opcode, subscription, time_ns = HEAD.unpack_from(data)
            if opcode != MESSAGE:
                sys.exit(f"opcode {opcode}")
            topic, data = TOPICS[subscription], data[HEAD.size :]
            message = json.loads(data) if channels[topic]["encoding"] == "json" else data.hex()
            out.write(json.dumps({"topic": topic, "t": time_ns, "message": message}) + "\n")
            if topic == "/scene/log" and Log.FromString(data).message == f"phase {given.until}":
                remaining = POSES
            elif topic == "/estim/state" and remaining:
                remaining -= 1
    for channel in channels.values():
        if (channel["encoding"], channel["schemaEncoding"]) not in ENCODINGS:
            sys.exit(f"{channel['topic']}: {channel['encoding']}, {channel['schemaEncoding']}")
    kinds = {
        topic: [channel["schemaName"], properties(channel)] for topic, channel in channels.items()
    }
    print(json.dumps(kinds))


if __name__ == "__main__":
    main()
