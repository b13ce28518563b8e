#!/usr/bin/env python3
"""The table `missions.csv`, by one command.

    missions.py tello-ctl [FLIGHTS [FIRST_SEED]] > missions.csv

Runs `tello-ctl sim --batch` for every row, in the root of the repository.
"""

import csv
import json
import subprocess
import sys

MISSIONS = ["square", "figure_eight", "arc", "cross", "big_square"]
PLANTS = {"identified": "fitted", "rigid body": "rigid_body"}
SPEEDS = ["0.5", "1"]


def fly(program, flights, seed, mission, plant, speed):
    command = [program, "sim", "--batch", flights, "--seed", seed, "--profile", "good_day", "--json"]
    command += ["--mission", f"configs/missions/{mission}.json", "--plant", PLANTS[plant], "--speed", speed]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def row(batch):
    truth = batch["by_truth"]
    endings = {"missed a target": "missed_count", "landed early": "landed_count", "not done": "unfinished_count"}
    endings = {how: batch[key] for how, key in endings.items()}
    finish = [f"{truth['finish_quartiles_s'][1]:.2f}"] + [f"{count} {how}" for how, count in endings.items() if count]
    distance = ", ".join(f"{distance_m:.3f}" for distance_m in truth["pooled_distance_m"])
    return ["; ".join(finish), distance, f"{truth['within_valid_distance']:.3f}"]


def main(program, flights="200", seed="1001"):
    table = csv.writer(sys.stdout, lineterminator="\n")
    table.writerow(["mission", "plant", "speed", "finish, median s", "distance: median, 95 %, largest m", "within 0.3 m"])
    for mission in MISSIONS:
        for plant in PLANTS:
            for speed in (["0.25"] if (mission, plant) == ("square", "identified") else []) + SPEEDS:
                batch = fly(program, flights, seed, mission, plant, speed)
                table.writerow([mission, plant, speed, *row(batch)])
                sys.stdout.flush()


if __name__ == "__main__":
    if not 2 <= len(sys.argv) <= 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
