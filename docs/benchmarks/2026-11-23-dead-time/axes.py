#!/usr/bin/env python3
"""Flights of vehicles of which single axes act later or sooner than configured: axes.py PROGRAM FLIGHTS FIRST_SEED

A row per vehicle: the acceleration limit, what is added to the dead times of roll and pitch, throttle and yaw; finished
flights; 95 % and the largest of the distances to the path; flights within 0.3 m of it; what ended the others, with
their number.
"""
import json
import re
import subprocess
import sys
import tempfile

PROGRAM, FLIGHTS, FIRST_SEED = sys.argv[1:]
SIM = json.load(open("configs/sim.json"))
# m/s^2; s for roll and pitch, throttle, yaw.
VEHICLES = [
    (1.1, 0.0, 0.0, 0.0),
    (1.1, 0.27, 0.27, 0.27),
    (1.1, 0.27, 0.0, 0.0),
    (1.1, 0.15, 0.0, 0.0),
    (1.1, 0.0, 0.15, 0.0),
    (1.1, 0.0, 0.27, 0.0),
    (1.1, 0.0, 0.4, 0.0),
    (1.1, 0.0, -0.09, 0.0),
    (1.1, 0.0, 0.0, 0.27),
    (3.0, 0.27, 0.27, 0.27),
    (3.0, 0.27, 0.0, 0.0),
]

print("plant,a_max,roll and pitch,throttle,yaw,finished,95 %,largest,within 0.3 m,ended by")
for plant in ["fitted", "rigid_body"]:
    for vehicle in VEHICLES:
        accel_mps2, *longer_s = vehicle
        sim = json.loads(json.dumps(SIM))
        sim["plant"]["accel_max_mps2"] = accel_mps2
        for axis, longer in zip(["horizontal", "vertical", "yaw"], longer_s):
            sim["plant"][axis]["dead_time_s"] += longer
        with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
            json.dump(sim, file)
            file.flush()
            words = [PROGRAM, "sim", "--batch", FLIGHTS, "--seed", FIRST_SEED, "--plant", plant, "--sim-config", file.name]
            table = subprocess.run(words, capture_output=True, text=True, check=False).stdout
        finished = re.search(r"(\d+) finished", table)[1]
        most, largest = (re.search(rf"([\d.]+) +[\d.]+  m, {name}", table)[1] for name in ["95 %", "largest"])
        within = re.search(r"within 0.3 m +([\d.]+)", table)[1]
        ended = "; ".join(" ".join(by) for by in re.findall(r"^(\S.*?) +(\d+) landed early$", table, re.MULTILINE))
        print(plant, *vehicle, finished, most, largest, within, ended, sep=",", flush=True)
