"""Reads our DataStream server with the package `motioncapture`, which contains Vicon's own client.

    mocap_python.py HOST:PORT NAME

Says `seen` once the body NAME is there, with its position (m) and quaternion (x y z w), and `lost` once
it has vanished, each as one line of JSON; exit code 1 if that takes too long.
"""

import json
import sys
import time

import motioncapture

PATIENCE_S = 20.0


def wait_for(mocap, is_there):
    """The rigid bodies of the first frame in which `is_there` says yes."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        mocap.waitForNextFrame()
        bodies = mocap.rigidBodies
        if is_there(bodies):
            return bodies
    sys.exit(1)


def main():
    address, name = sys.argv[1:]
    mocap = motioncapture.connect("vicon", {"hostname": address})
    body = wait_for(mocap, lambda bodies: name in bodies)[name]
    rotation = body.rotation
    quaternion = [rotation.x, rotation.y, rotation.z, rotation.w]
    position = [float(metres) for metres in body.position]
    print(json.dumps({"seen": name, "position": position, "quaternion": quaternion}), flush=True)
    bodies = wait_for(mocap, lambda bodies: name not in bodies)
    print(json.dumps({"lost": name, "others": sorted(bodies)}), flush=True)


main()
