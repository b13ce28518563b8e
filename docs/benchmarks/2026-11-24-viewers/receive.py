"""Receives rt/tello/pose with cyclonedds: `receive.py COUNT PAYLOADS`.

PAYLOADS are the poses in CDR, each behind its length (4 bytes, little-endian), as `publish.rs` sends them over and
over. Prints how many came and how many differ. CYCLONEDDS_URI limits it to the interface lo, with 127.0.0.1 as peer.
"""

import struct
import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, uint32
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

SILENT_S = 20


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Point
    orientation: Quaternion


@dataclass
class PoseStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseStamped_"):
    header: Header
    pose: Pose


def payloads(path):
    with open(path, "rb") as file:
        while length := file.read(4):
            yield file.read(struct.unpack("<I", length)[0])


def main():
    count, expected = int(sys.argv[1]), list(payloads(sys.argv[2]))
    participant = DomainParticipant(0)
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=10)), Policy.History.KeepAll, Policy.Durability.Volatile)
    reader = DataReader(participant, Topic(participant, "rt/tello/pose", PoseStamped, qos=qos), qos=qos)
    received, different, last = 0, 0, time.time()
    while received < count and time.time() - last < SILENT_S:
        for sample in reader.take(N=500):
            if not isinstance(sample, PoseStamped):
                continue
            # Behind the four bytes that name the encoding.
            different += sample.serialize(use_version_2=False)[4:] != expected[received % len(expected)][4:]
            received, last = received + 1, time.time()
        time.sleep(0.001)
    print(f"{received} of {count} received, {different} different")


if __name__ == "__main__":
    main()
