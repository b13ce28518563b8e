#!/usr/bin/env python3
"""When a flight is landed whose heading drifts while the drone reports none, `landing.csv`.

    landing.py tello-ctl [FLIGHTS] > landing.csv

Flies each mission with a drift of +-0.3 rad/s from 12 s on, seeds from 1. Of flights that are landed before the mission
is over it reads the moment of `landing` from `/supervisor/phase`. Runs in the root of the repository.
"""

import csv
import json
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile

MISSIONS = ["square_laps", "big_square", "figure_eight", "cross"]
FAULT_AT_S = 12.0


def landing_s(program, folder, mission, yaw_radps, seed):
    """`None`: the mission was over before."""
    settings = json.loads(pathlib.Path("configs/sim.json").read_text())
    settings["drone"]["status"]["heading"] = {"is_present": False, "is_mirrored": False, "drift_radps": 0.0, "late_s": 0.0}
    drift = {"mocap_drift": {"velocity_mps": [0.0, 0.0, 0.0], "yaw_radps": yaw_radps}}
    settings["faults"] = [{"fault": drift, "from_s": FAULT_AT_S, "for_s": 1000.0}]
    (folder / "sim.json").write_text(json.dumps(settings))
    log = folder / "flight.mcap"
    log.unlink(missing_ok=True)
    flight = ["sim", "--seed", str(seed), "--profile", "clean", "--mission", f"configs/missions/{mission}.json"]
    command = [program, *flight, "--sim-config", folder / "sim.json", "--log", log]
    result = subprocess.run(command, capture_output=True, text=True)
    reached, targets = re.search(r"(\d+) of (\d+) targets", result.stdout).groups()
    if reached == targets:
        return None
    table = ["log", "csv", log, "--out-dir", folder, "--topic", "/supervisor/phase", "--force"]
    subprocess.run([program, *table], check=True, capture_output=True)
    with open(folder / "supervisor_phase.csv") as file:
        phases = [(float(row["t_s"]), row["phase"]) for row in csv.DictReader(file)]
    return next(t_s for t_s, phase in phases if phase == "landing") - FAULT_AT_S


def main(program, flights="30"):
    folder = pathlib.Path(tempfile.mkdtemp())
    table = csv.writer(sys.stdout, lineterminator="\n")
    table.writerow(["mission", "rad/s", "landed early", "LAND: median, s", "largest, s"])
    for mission in MISSIONS:
        for yaw_radps in [0.3, -0.3]:
            times_s = [landing_s(program, folder, mission, yaw_radps, 1 + at) for at in range(int(flights))]
            times_s = [time_s for time_s in times_s if time_s is not None]
            median_s, largest_s = statistics.median(times_s), max(times_s)
            table.writerow([mission, yaw_radps, len(times_s), f"{median_s:.2f}", f"{largest_s:.2f}"])
            sys.stdout.flush()


if __name__ == "__main__":
    if not 2 <= len(sys.argv) <= 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
