#!/usr/bin/env python3
"""Missions beside a pole in their path: `missions.py TELLO_CTL [FLIGHTS [SEED]]`, from the root of the project.

Flies each mission with the built-in settings, without and with a pole of 0.12 m radius, and writes a CSV table.
"""
import csv
import json
import subprocess
import sys
import tempfile
from pathlib import Path

# Mission, speed, axis of the pole. m
POLES = [
    ("figure_eight", 0.5, [2.28, 0.0]),
    ("arc", 0.5, [1.94, 2.35]),
    ("cross", 0.5, [0.58, 0.0]),
    ("big_square", 0.5, [2.48, 0.5]),
    ("square", 1.0, [-1.97, -2.2]),
    ("look_around", 0.5, [-1.36, -2.68]),
]


def fly(tello_ctl, mission, speed, obstacles, flights, seed):
    """Figures of a batch."""
    settings = json.loads(Path("configs/fly.json").read_text())
    settings["mission"] = str(Path(f"configs/missions/{mission}.json").resolve())
    settings["cycle"]["obstacles"] = obstacles
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
        json.dump(settings, file)
        file.flush()
        command = [tello_ctl, "sim", "--batch", flights, "--seed", seed, "--profile", "good_day"]
        command += ["--config", file.name, "--speed", str(speed), "--json"]
        return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def main(tello_ctl, flights="200", seed="1001"):
    print(json.dumps(fly(tello_ctl, *POLES[0][:2], [], "2", seed))[:3000])


main(*sys.argv[1:])
