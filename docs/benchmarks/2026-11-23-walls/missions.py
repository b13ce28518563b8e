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
    table = csv.writer(sys.stdout, lineterminator="\n")
    table.writerow(
        ["mission", "speed", "pole at x, y", "flights", "finished without", "with the pole"]
        + ["finish without, median s", "with the pole", "least clearance, m"]
    )
    for mission, speed, centre_m in POLES:
        pole = {"kind": "cylinder", "centre_m": centre_m, "radius_m": 0.12, "z_m": [-0.2, 2.5]}
        without, beside = (fly(tello_ctl, mission, speed, o, flights, seed) for o in ([], [pole]))
        both = (without, beside)
        table.writerow(
            [mission, speed, f"{centre_m[0]}, {centre_m[1]}", flights]
            + [one["finished_count"] for one in both]
            + [f'{one["by_truth"]["finish_quartiles_s"][1]:.2f}' for one in both]
            + [f'{beside["clearance"]["obstacle_m"]:.3f}']
        )
        sys.stdout.flush()


main(*sys.argv[1:])
