"""Flies the simulated drone with a client library that we did not write.

    drone_python.py CLIENT PROGRAM SIM_CONFIG

CLIENT is tellopy (binary protocol), or of the text SDK djitellopy, tello-asyncio, easytello, rktellolib,
tello-control, and tellolib, KTLib and ryzetello, which wait for no answer to a movement; or the Rust crate
tello-edu, whose program (clients/tello_edu) TELLO_EDU names. PROGRAM is tello-ctl,
whose `sim` gets 192.168.10.1 in a network namespace of its own, since the libraries know no other
address; this process is to run in a fresh network namespace, too (`unshare`). Connects, takes off,
reads the battery, moves on all axes, lands. What happened is judged by the poses that the simulator's
mocap relay reports. Prints one JSON object; exit code 0 if everything went the right way.
"""

import asyncio
import json
import math
import os
import socket
import subprocess
import sys
import threading
import time
import traceback

DRONE = "192.168.10.1"
HOST = "192.168.10.2"
RELAY_PORT = 51602
# How far each movement must lead at least; the libraries are ordered 0.5 m or half a stick for 1.5 s. m
MOVED_MIN_M = 0.2
TURNED_MIN_RAD = 0.5
STANDING_MAX_M = 0.1
FLYING_MIN_M = 0.6
# A flip may end so far from where it began, and the logged heading from the true one. m, rad
FLIPPED_MAX = 0.1
YAW_MAX_RAD = 0.1
BATTERY_PCT = range(80, 91)


def run(*words):
    subprocess.run(words, check=True)


def start_drone(program, sim_config):
    """Starts the simulator behind a cable of its own; returns its process."""
    arguments = ["--sim-config", sim_config, "--drone-address", f"{DRONE}:8889"]
    arguments += ["--relay-address", f"{DRONE}:{RELAY_PORT}", "--json"]
    wait = 'echo ready; read -r line; exec "$0" sim "$@"'
    drone = subprocess.Popen(
        ["unshare", "-n", "sh", "-c", wait, program, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert drone.stdout.readline() == "ready\n"
    pid = str(drone.pid)
    run("ip", "link", "set", "lo", "up")
    run("ip", "link", "add", "host0", "type", "veth", "peer", "name", "drone0", "netns", pid)
    run("ip", "addr", "add", f"{HOST}/24", "dev", "host0")
    run("ip", "link", "set", "host0", "up")
    there = ["nsenter", "-t", pid, "-n"]
    run(*there, "ip", "link", "set", "lo", "up")
    run(*there, "ip", "addr", "add", f"{DRONE}/24", "dev", "drone0")
    run(*there, "ip", "link", "set", "drone0", "up")
    drone.stdin.write("go\n")
    drone.stdin.flush()
    assert json.loads(drone.stdout.readline())["drone"] == f"{DRONE}:8889"
    return drone


class Poses:
    """The newest pose of the relay: x, y, z in metres, theta in radians, continuous."""

    def __init__(self):
        self.newest = None
        stream = socket.create_connection((DRONE, RELAY_PORT), timeout=10)
        threading.Thread(target=self.listen, args=(stream,), daemon=True).start()
        while self.newest is None:
            time.sleep(0.01)

    def listen(self, stream):
        for line in stream.makefile():
            x, y, z, _, _, theta = (float(word) for word in line.split()[4:])
            if self.newest is not None:
                turns = round((self.newest[3] - theta) / (2 * math.pi))
                theta += 2 * math.pi * turns
            self.newest = (x, y, z, theta)

    def height(self):
        return self.newest[2]

    def moved(self, since):
        """Forward, left, up and counter-clockwise since a pose."""
        dx, dy, dz, turned = (now - then for now, then in zip(self.newest, since))
        sin, cos = math.sin(since[3]), math.cos(since[3])
        return {
            "forward": cos * dx + sin * dy,
            "left": cos * dy - sin * dx,
            "up": dz,
            "counter_clockwise": turned,
        }


class Judge:
    """Notes what a movement did, and whether it was what was asked for."""

    def __init__(self, poses):
        self.poses = poses
        self.story = {}
        self.is_right = True

    def note(self, name, value, is_right):
        self.story[name] = round(value, 3)
        self.is_right &= bool(is_right)
        if not is_right:
            print(f"wrong: {name} {value}", file=sys.stderr)

    def standing(self, name):
        self.note(name, self.poses.height(), self.poses.height() < STANDING_MAX_M)

    def flying(self, name):
        self.note(name, self.poses.height(), self.poses.height() > FLYING_MIN_M)

    def battery(self, percent):
        self.note("battery", percent, percent in BATTERY_PCT)

    def equal(self, name, value, expected, tolerance):
        self.note(name, value, abs(value - expected) <= tolerance)

    def moved(self, name, since, axis, sign):
        moved = sign * self.poses.moved(since)[axis]
        least = TURNED_MIN_RAD if axis == "counter_clockwise" else MOVED_MIN_M
        self.note(name, moved, moved > least)


# The axis and the sign of each movement.
MOVES = {
    "forward": ("forward", 1),
    "back": ("forward", -1),
    "left": ("left", 1),
    "right": ("left", -1),
    "up": ("up", 1),
    "down": ("up", -1),
    "clockwise": ("counter_clockwise", -1),
    "counter_clockwise": ("counter_clockwise", 1),
}


def fly_djitellopy(judge, poses):
    from djitellopy import Tello, TelloException

    tello = Tello()
    tello.connect()
    judge.battery(tello.get_battery())
    judge.battery(tello.query_battery())
    tello.takeoff()
    judge.flying("taken_off")
    for name, (axis, sign) in MOVES.items():
        since = poses.newest
        is_turn = axis == "counter_clockwise"
        verb = f"rotate_{name}" if is_turn else f"move_{name}"
        getattr(tello, verb)(60 if is_turn else 50)
        judge.moved(name, since, axis, sign)
    # Left and right, forward and back, up and down, yaw.
    for name, sticks in [
        ("right", (50, 0, 0, 0)),
        ("forward", (0, 50, 0, 0)),
        ("up", (0, 0, 50, 0)),
        ("clockwise", (0, 0, 0, 50)),
    ]:
        since = poses.newest
        tello.send_rc_control(*sticks)
        time.sleep(1.5)
        tello.send_rc_control(0, 0, 0, 0)
        time.sleep(1.0)
        judge.moved(f"stick_{name}", since, *MOVES[name])
    since = poses.newest
    tello.flip_forward()
    judge.equal("flip", max(map(abs, poses.moved(since).values())), 0, FLIPPED_MAX)
    try:
        tello.streamon()
        judge.note("video_refused", 0, False)
    except TelloException as refusal:
        judge.note("video_refused", 1, "No video" in str(refusal))
    tello.land()


def fly_tello_asyncio(judge, poses):
    from tello_asyncio import Tello

    async def fly():
        tello = Tello()
        await tello.connect()
        judge.battery(await tello.query_battery())
        await tello.takeoff()
        judge.flying("taken_off")
        for name, (axis, sign) in MOVES.items():
            since = poses.newest
            is_turn = axis == "counter_clockwise"
            verb = f"turn_{name.replace('_', '')}" if is_turn else f"move_{name}"
            await getattr(tello, verb)(60 if is_turn else 50)
            judge.moved(name, since, axis, sign)
        await tello.land()
        await tello.disconnect()

    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    loop.run_until_complete(fly())


def fly_easytello(judge, poses):
    from easytello.tello import Tello

    tello = Tello(debug=False)
    judge.battery(tello.get_battery())
    tello.takeoff()
    judge.flying("taken_off")
    for name in ("forward", "left", "up"):
        since = poses.newest
        getattr(tello, name)(50)
        judge.moved(name, since, *MOVES[name])
    since = poses.newest
    tello.cw(60)
    judge.moved("clockwise", since, *MOVES["clockwise"])
    tello.land()


# How long a pose must stay to count as at rest, and how far it may go then. s, m and rad
REST_S = 1.2
REST_MAX = 0.01


def rest(poses, patience_s=12):
    """Waits until the vehicle has begun to move and is at rest."""
    time.sleep(1.0)
    deadline = time.monotonic() + patience_s
    while time.monotonic() < deadline:
        since = poses.newest
        time.sleep(REST_S)
        if max(map(abs, poses.moved(since).values())) < REST_MAX:
            return


# One movement for each axis, for libraries that are like others.
FEW = ("forward", "left", "up", "clockwise")


def fly_by(judge, poses, take_off, land, moves):
    """Takes off, does each of `moves`, a call by its name in MOVES, and lands; waits for rest after each."""
    take_off()
    rest(poses)
    judge.flying("taken_off")
    for name, move in moves.items():
        since = poses.newest
        move()
        rest(poses)
        judge.moved(name, since, *MOVES[name])
    land()
    rest(poses)


def fly_rktellolib(judge, poses):
    from rktellolib import Tello

    tello = Tello()
    tello.connect()
    judge.battery(int(tello.get_battery()))
    names = {"clockwise": "cw"}
    moves = {name: lambda verb=names.get(name, name): getattr(tello, verb)(60) for name in FEW}
    fly_by(judge, poses, tello.takeoff, tello.land, moves)


def fly_tello_control(judge, poses):
    from tello_control.structs import TelloCommand
    from tello_control.tello import Tello

    tello = Tello()
    judge.note("connected", 1, tello.connect())
    judge.battery(int(tello.battery))

    def order(command):
        return lambda: judge.note("answered", 1, tello.send_command(command, wait_for_success=True)[0])

    def push(*sticks):
        def move():
            tello.send_command(TelloCommand.RC, *sticks)
            time.sleep(1.5)
            tello.send_command(TelloCommand.RC, 0, 0, 0, 0)

        return move

    moves = {"right": push(50, 0, 0, 0), "forward": push(0, 50, 0, 0), "up": push(0, 0, 50, 0)}
    moves["clockwise"] = push(0, 0, 0, 50)
    fly_by(judge, poses, order(TelloCommand.TAKE_OFF), order(TelloCommand.LAND), moves)


def fly_few(judge, poses, tello, clockwise):
    """Flies a few ways by methods of the ways' names, which take text."""
    verbs = {name: name for name in FEW} | {"clockwise": clockwise}
    moves = {name: lambda verb=verb: getattr(tello, verb)("60") for name, verb in verbs.items()}
    fly_by(judge, poses, tello.takeoff, tello.land, moves)


def fly_tellolib(judge, poses):
    from tellolib.tello import Tello

    tello = Tello(9000)
    tello.connect()
    tello.recieve()
    fly_few(judge, poses, tello, "rotatecw")


def fly_ktlib(judge, poses):
    from KTLib.KTLib import Tello

    tello = Tello()
    tello.connect()
    fly_few(judge, poses, tello, "cw")


def fly_ryzetello(judge, poses):
    from ryzetello import tello as connect

    tello = connect()
    moves = {name: lambda verb=name: getattr(tello, verb)(60) for name in ("forward", "left", "up")}
    moves["clockwise"] = lambda: tello.rotate("cw", 60)
    fly_by(judge, poses, tello.takeoff, tello.land, moves)


def fly_tello_edu(judge, poses):
    program = os.environ["TELLO_EDU"]
    crate = subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def answer(order=None):
        """The answer to `order`, or that it is connected; beside these it prints what the crate does."""
        if order:
            print(order, file=crate.stdin, flush=True)
        for line in crate.stdout:
            if line.startswith("answer "):
                return line.split()[1]
        raise EOFError("tello-edu ended by itself")

    def order(words):
        judge.note(words, 1, answer(words) == "ok")

    judge.note("connected", 1, answer() == "connected")
    judge.battery(int(answer("battery")))
    order("take_off")
    judge.flying("taken_off")
    for name, (axis, sign) in MOVES.items():
        since = poses.newest
        order(f"{name} {60 if axis == 'counter_clockwise' else 50}")
        judge.moved(name, since, axis, sign)
    since = poses.newest
    order("flip")
    judge.equal("flipped", max(map(abs, poses.moved(since).values())), 0, FLIPPED_MAX)
    order("land")
    crate.stdin.close()
    judge.note("ended_well", crate.wait(10), crate.returncode == 0)


def yaw_of(imu):
    """Heading, clockwise from above, of a record of the flight log."""
    return 2 * math.atan2(imu.q3, imu.q0)


def fly_tellopy(judge, poses):
    import tellopy

    tello = tellopy.Tello()
    tello.set_loglevel(tello.LOG_ERROR)
    battery = []
    tello.subscribe(
        tello.EVENT_FLIGHT_DATA, lambda event, sender, data, **_: battery.append(data.battery_percentage)
    )
    yaw = []
    tello.subscribe(tello.EVENT_LOG_DATA, lambda event, sender, data, **_: yaw.append(yaw_of(data.imu)))
    tello.connect()
    tello.wait_for_connection(10)
    time.sleep(0.5)
    judge.battery(battery[-1] if battery else -1)
    tello.takeoff()
    time.sleep(6)
    judge.flying("taken_off")
    start = (poses.newest, yaw[-1] if yaw else math.nan)
    for name, (axis, sign) in MOVES.items():
        since = poses.newest
        stick = getattr(tello, "backward" if name == "back" else name)
        stick(50)
        time.sleep(1.5)
        stick(0)
        time.sleep(1.0)
        judge.moved(name, since, axis, sign)
        if axis == "counter_clockwise" and yaw:
            turned = poses.moved(start[0])[axis]
            judge.equal(f"log_{name}", yaw[-1] - start[1], -turned, YAW_MAX_RAD)
    judge.note("log_records", len(yaw), yaw)
    tello.land()
    deadline = time.monotonic() + 10
    while poses.height() > STANDING_MAX_M and time.monotonic() < deadline:
        time.sleep(0.1)
    tello.quit()


CLIENTS = {
    "djitellopy": fly_djitellopy,
    "tello-asyncio": fly_tello_asyncio,
    "easytello": fly_easytello,
    "tellopy": fly_tellopy,
    "rktellolib": fly_rktellolib,
    "tello-control": fly_tello_control,
    "tellolib": fly_tellolib,
    "KTLib": fly_ktlib,
    "ryzetello": fly_ryzetello,
    "tello-edu": fly_tello_edu,
}


def main():
    client, program, sim_config = sys.argv[1:]
    drone = start_drone(program, sim_config)
    code = 1
    try:
        poses = Poses()
        judge = Judge(poses)
        judge.standing("before")
        CLIENTS[client](judge, poses)
        time.sleep(0.5)
        judge.standing("landed")
        # What the libraries print goes before it.
        print(json.dumps({"client": client, "is_right": judge.is_right, **judge.story}))
        code = 0 if judge.is_right else 1
    except Exception:
        traceback.print_exc()
    finally:
        drone.kill()
        sys.stdout.flush()
        # The libraries' threads may not want to end.
        os._exit(code)


if __name__ == "__main__":
    main()
