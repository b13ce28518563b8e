#!/usr/bin/env python3
"""Corrections of the dead times after a gust on the way to the first waypoint.

    gusts.py tello-ctl [FLIGHTS [FIRST_SEED]] > gusts.csv

A push of 1 s begins 2.5 s after the start of a flight whose dead times are longer than configured. Prints the least and
the last correction of roll and pitch of every flight, s. Runs in the root of the repository.
"""

import csv
import json
import pathlib
import subprocess
import sys
import tempfile

ROWS = [
    ("rigid body, +0.2 s, gain x 1.22, speed 0.8", [0.8, -0.6], "--plant rigid_body --vary gain=1.22 --vary dead_time=0.2 --speed 0.8"),
    ("rigid body, +0.2 s, gain x 1.22, speed 0.8", [1.2, -0.8], "--plant rigid_body --vary gain=1.22 --vary dead_time=0.2 --speed 0.8"),
    ("identified plant, +0.1 s", [0.8, -0.6], "--vary dead_time=0.1"),
]


def corrections_s(program, folder, seed, options):
    log = folder / "flight.mcap"
    log.unlink(missing_ok=True)
    settings = folder / "sim.json"
    mission = "configs/missions/square.json"
    command = [program, "sim", "--seed", str(seed), "--mission", mission, "--sim-config", settings, "--log", log]
    subprocess.run([*command, *options.split()], capture_output=True)
    table = [program, "log", "csv", log, "--out-dir", folder, "--topic", "/estim/link", "--force"]
    subprocess.run(table, check=True, capture_output=True)
    with open(folder / "estim_link.csv") as file:
        return [float(row["dead_time_change_s"] or 0.0) for row in csv.DictReader(file)]


def main(program, flights="40", seed="710001"):
    folder = pathlib.Path(tempfile.mkdtemp())
    rows = csv.writer(sys.stdout, lineterminator="\n")
    rows.writerow(["vehicle", "push_x_mps", "push_y_mps", "seed", "least_s", "last_s"])
    for name, push, options in ROWS:
        settings = json.loads(pathlib.Path("configs/sim.json").read_text())
        fault = {"drone_pushed": {"velocity_mps": [*push, 0.0]}}
        settings["faults"] = [{"fault": fault, "from_s": 2.5, "for_s": 1.0}]
        (folder / "sim.json").write_text(json.dumps(settings))
        for at in range(int(seed), int(seed) + int(flights)):
            found_s = corrections_s(program, folder, at, options)
            rows.writerow([name, *push, at, f"{min(found_s):.2f}", f"{found_s[-1]:.2f}"])


if __name__ == "__main__":
    if not 2 <= len(sys.argv) <= 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
