"""Receives rt/tello/pose with cyclonedds; prints count, gaps, and differences to the list of payloads."""
import sys, time, struct
from dataclasses import dataclass
from cyclonedds.domain import DomainParticipant
from cyclonedds.topic import Topic
from cyclonedds.sub import DataReader
from cyclonedds.core import Qos, Policy
from cyclonedds.util import duration
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import int32, uint32, float64
N='geometry_msgs::msg::dds_::'
@dataclass
class Time_(IdlStruct, typename='builtin_interfaces::msg::dds_::Time_'):
    sec: int32; nanosec: uint32
@dataclass
class Header_(IdlStruct, typename='std_msgs::msg::dds_::Header_'):
    stamp: Time_; frame_id: str
@dataclass
class Point_(IdlStruct, typename=N+'Point_'):
    x: float64; y: float64; z: float64
@dataclass
class Quaternion_(IdlStruct, typename=N+'Quaternion_'):
    x: float64; y: float64; z: float64; w: float64
@dataclass
class Pose_(IdlStruct, typename=N+'Pose_'):
    position: Point_; orientation: Quaternion_
@dataclass
class PoseStamped_(IdlStruct, typename=N+'PoseStamped_'):
    header: Header_; pose: Pose_
want=int(sys.argv[1]); src=open(sys.argv[2],'rb').read()
expected=[]; at=0
while at<len(src):
    n,=struct.unpack_from('<I',src,at); expected.append(src[at+4:at+4+n]); at+=4+n
dp=DomainParticipant(0)
qos=Qos(Policy.Reliability.Reliable(duration(seconds=10)), Policy.History.KeepAll, Policy.Durability.Volatile)
rd=DataReader(dp, Topic(dp,'rt/tello/pose',PoseStamped_,qos=qos), qos=qos)
got=0; different=0; t0=time.time(); last=t0
while got<want and time.time()-last<20:
    for s in rd.take(N=500):
        if not hasattr(s,'pose'): continue
        if s.serialize(use_version_2=False)[4:] != expected[got%len(expected)][4:]:
            different+=1
            if different<3: print(s, s.serialize(use_version_2=False).hex(), expected[got%len(expected)].hex())
        got+=1; last=time.time()
    time.sleep(0.001)
print(f'{got} of {want} received, {different} different, {last-t0:.1f} s')
