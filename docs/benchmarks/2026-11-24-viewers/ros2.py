"""ROS 2 beside this program, by the package `cyclonedds`: what `fly --ros2` publishes, and poses for `mocap ros2`.

    ros2.py receive FILE        # the messages of a flight, until none came for 10 s, to FILE
    ros2.py compare FILE BAG    # these against the file that `log ros2` makes of the flight's log
    ros2.py publish HOST:PORT   # the lines of a relay as /mocap/tello/pose
"""

import math
import pickle
import socket
import sys
import time
from dataclasses import dataclass
from types import new_class

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, byte, float32, float64, int32, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

SILENT_S = 10


def message(package, name, /, **rows):
    """A kind of message as its published definition has it."""
    typename = {"typename": f"{package}::msg::dds_::{name}_"}
    return dataclass(new_class(name, (IdlStruct,), typename, lambda body: body.update(__annotations__=rows)))


Time = message("builtin_interfaces", "Time", sec=int32, nanosec=uint32)
Header = message("std_msgs", "Header", stamp=Time, frame_id=str)
Point = message("geometry_msgs", "Point", x=float64, y=float64, z=float64)
Vector3 = message("geometry_msgs", "Vector3", x=float64, y=float64, z=float64)
Quaternion = message("geometry_msgs", "Quaternion", x=float64, y=float64, z=float64, w=float64)
Pose = message("geometry_msgs", "Pose", position=Point, orientation=Quaternion)
PoseStamped = message("geometry_msgs", "PoseStamped", header=Header, pose=Pose)
Twist = message("geometry_msgs", "Twist", linear=Vector3, angular=Vector3)
TwistStamped = message("geometry_msgs", "TwistStamped", header=Header, twist=Twist)
Transform = message("geometry_msgs", "Transform", translation=Vector3, rotation=Quaternion)
TransformStamped = message(
    "geometry_msgs", "TransformStamped", header=Header, child_frame_id=str, transform=Transform
)
TFMessage = message("tf2_msgs", "TFMessage", transforms=sequence[TransformStamped])
Path = message("nav_msgs", "Path", header=Header, poses=sequence[PoseStamped])
JointState = message(
    "sensor_msgs",
    "JointState",
    header=Header,
    name=sequence[str],
    position=sequence[float64],
    velocity=sequence[float64],
    effort=sequence[float64],
)
KeyValue = message("diagnostic_msgs", "KeyValue", key=str, value=str)
DiagnosticStatus = message(
    "diagnostic_msgs", "DiagnosticStatus", level=byte, name=str, message=str, hardware_id=str, values=sequence[KeyValue]
)
DiagnosticArray = message("diagnostic_msgs", "DiagnosticArray", header=Header, status=sequence[DiagnosticStatus])
BatteryState = message(
    "sensor_msgs",
    "BatteryState",
    header=Header,
    numbers=array[float32, 7],
    power_supply_status=uint8,
    power_supply_health=uint8,
    power_supply_technology=uint8,
    present=bool,
    cell_voltage=sequence[float32],
    cell_temperature=sequence[float32],
    location=str,
    serial_number=str,
)

TOPICS = {
    "/tello/pose": PoseStamped,
    "/tf": TFMessage,
    "/tello/velocity": TwistStamped,
    "/tello/state": JointState,
    "/tello/reference": PoseStamped,
    "/tello/target": PoseStamped,
    "/tello/plan": Path,
    "/diagnostics": DiagnosticArray,
    "/tello/battery": BatteryState,
}


def receive(file):
    participant = DomainParticipant(0)
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=10)), Policy.History.KeepAll, Policy.Durability.Volatile)
    readers = {
        name: DataReader(participant, Topic(participant, "rt" + name, kind, qos=qos), qos=qos)
        for name, kind in TOPICS.items()
    }
    received = {name: [] for name in TOPICS}
    last = None
    while last is None or time.time() - last < SILENT_S:
        for name, reader in readers.items():
            for sample in reader.take(N=500):
                # Behind the four bytes that name the encoding.
                if isinstance(sample, TOPICS[name]):
                    received[name].append(sample.serialize(use_version_2=False)[4:])
                    last = time.time()
        time.sleep(0.002)
    with open(file, "wb") as out:
        pickle.dump(received, out)


def compare(file, bag):
    from mcap.reader import make_reader

    with open(file, "rb") as stream:
        received = pickle.load(stream)
    logged = {name: [] for name in TOPICS}
    with open(bag, "rb") as stream:
        for _, channel, record in make_reader(stream).iter_messages():
            logged[channel.topic].append(record.data[4:])
    for name, messages in received.items():
        # Who joins late misses what was said before.
        late = logged[name].index(messages[0]) if messages else len(logged[name])
        is_equal = messages == logged[name][late:]
        print(f"{name}: {len(messages)} of {len(logged[name])}, {late} before it was found, rest equal: {is_equal}")
    print(sum(map(len, received.values())), "messages")


def publish(address):
    participant = DomainParticipant(0)
    qos = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(10), Policy.DataRepresentation(use_cdrv0_representation=True))
    writer = DataWriter(participant, Topic(participant, "rt/mocap/tello/pose", PoseStamped, qos=qos), qos=qos)
    host, port = address.split(":")
    with socket.create_connection((host, int(port))) as relay:
        for line in relay.makefile():
            frame, rate, _, occluded, x, y, z, *angles = line.split()
            if occluded != "0":
                continue
            # The simulated vehicle is level: the third angle is its heading.
            half = 0.5 * float(angles[2])
            turn = Quaternion(0.0, 0.0, math.sin(half), math.cos(half))
            stamp_ns = round(int(frame) / float(rate) * 1e9)
            header = Header(Time(stamp_ns // 10**9, stamp_ns % 10**9), "world")
            writer.write(PoseStamped(header, Pose(Point(float(x), float(y), float(z)), turn)))


if __name__ == "__main__":
    {"receive": receive, "compare": compare, "publish": publish}[sys.argv[1]](*sys.argv[2:])
