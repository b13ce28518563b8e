"""Reads one of our mocap servers with a client that we did not write.

    mocap_foreign.py CLIENT HOST PORT NAME [GROUP GROUP_PORT]

CLIENT is `optitrack` or `vrpn` (both of the package `motioncapture`), `natnet` (package `natnet`) or `qtm`
(package `qtm_rt`). Prints position (m) and quaternion (x y z w) of the body NAME as one line of JSON; exit code 1 if
that takes too long.
"""

import asyncio
import json
import sys
import time

PATIENCE_S = 20.0


def tell(position, quaternion):
    print(json.dumps({"position": list(position), "quaternion": list(quaternion)}), flush=True)


def by_motioncapture(kind, settings, name):
    import motioncapture

    mocap = motioncapture.connect(kind, settings)
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        mocap.waitForNextFrame()
        body = mocap.rigidBodies.get(name)
        if body is not None:
            q = body.rotation
            tell([float(metres) for metres in body.position], [q.x, q.y, q.z, q.w])
            return
    sys.exit(1)


def by_natnet(host, port, name, group):
    from natnet import NatNetClient

    where = {"multicast_address": group[0], "data_port": int(group[1])} if group else {}
    client = NatNetClient(host, "127.0.0.1", command_port=int(port), use_multicast=bool(group), **where)
    frames, models = [], []
    client.on_data_frame_received_event.handlers.append(frames.append)
    client.on_data_description_received_event.handlers.append(models.append)
    end = time.monotonic() + PATIENCE_S
    with client:
        while time.monotonic() < end:
            client.request_modeldef()
            client.update_sync()
            if models and frames:
                identity = next(body.id_num for body in models[-1].rigid_bodies if body.name == name)
                body = next(body for body in frames[-1].rigid_bodies if body.id_num == identity)
                tell(body.pos, body.rot)
                return
            time.sleep(0.02)
    sys.exit(1)


def quaternion_of(columns):
    """x y z w of a matrix near the identity, given column by column."""
    (a, d, g), (b, e, h), (c, f, i) = columns[0:3], columns[3:6], columns[6:9]
    w = 0.5 * (1.0 + a + e + i) ** 0.5
    return [(h - f) / (4 * w), (c - g) / (4 * w), (d - b) / (4 * w), w]


async def by_qtm(host, port, name):
    import xml.etree.ElementTree

    import qtm_rt

    connection = await qtm_rt.connect(host, int(port), timeout=PATIENCE_S)
    document = xml.etree.ElementTree.fromstring(await connection.get_parameters(["6d"]))
    index = [body.text for body in document.findall("The_6D/Body/Name")].index(name)
    packets = []
    answer = await connection.stream_frames(components=["6d"], on_packet=packets.append)
    assert answer == b"Ok", answer
    end = time.monotonic() + PATIENCE_S
    while not packets and time.monotonic() < end:
        await asyncio.sleep(0.02)
    _, bodies = packets[-1].get_6d()
    position, rotation = bodies[index]
    tell([mm / 1000.0 for mm in position], quaternion_of(rotation.matrix))
    connection.disconnect()


def main():
    client, host, port, name, *group = sys.argv[1:]
    if client == "optitrack":
        settings = {"hostname": host, "port_command": port, "interface_ip": "127.0.0.1"}
        by_motioncapture(client, settings, name)
    elif client == "vrpn":
        by_motioncapture(client, {"hostname": f"tcp://{host}:{port}"}, name)
    elif client == "natnet":
        by_natnet(host, port, name, group)
    else:
        asyncio.run(by_qtm(host, port, name))


main()
