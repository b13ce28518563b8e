#!/usr/bin/env python3
"""What the settings of `cycle.link.dead_time` and the prior of tau_h change: one row for each choice.

    choices.py tello-ctl [FLIGHTS [FIRST_SEED]] > choices.txt

The dead times are those of `dead_times.py`, equal vehicles of the identified plant. Runs in the root of the repository.
"""

import json
import pathlib
import statistics
import subprocess
import sys
import tempfile

from dead_times import CHANGES_S, found_s
from tables import Program, distance, heads, line, some

# Position noise of the dead time's own filter, m, None without that filter; mhe.C_p of tau_h, 1/s.
CHOICES = [(None, 7.0), (0.004, 7.0), (0.006, 10.0), (0.006, 7.0), (0.006, 5.0), (0.006, 4.0), (0.008, 7.0)]
TAU_H = 4


def settings(sd_position_m, c_p):
    table = json.loads(pathlib.Path("configs/fly.json").read_text())
    link = table["cycle"]["link"]
    if sd_position_m is None:
        link["dead_time"] = None
    else:
        link["dead_time"]["sd_position_m"] = sd_position_m
    table["cycle"]["mhe"]["C_p"][TAU_H] = c_p
    return json.dumps(table)


def within_10_ms(program, folder, sim, flights, seed, *options):
    """Fractions of the flights for each of CHANGES_S, against the mean of the nominal ones."""
    found = [
        [found_s(program, folder, sim, at, change_s, "--plant", "fitted", *options) for change_s in CHANGES_S]
        for at in range(int(seed), int(seed) + int(flights))
    ]
    found = [row for row in found if None not in row]
    right_s = statistics.fmean(row[0] for row in found)
    errors_s = [[row[k] - right_s - change_s for row in found] for k, change_s in enumerate(CHANGES_S)]
    return [sum(abs(error_s) <= 0.01 for error_s in errors) / len(errors) for errors in errors_s]


def main(program, flights="40", seed="430001"):
    folder = pathlib.Path(tempfile.mkdtemp())
    config, sim = folder / "fly.json", folder / "sim.json"
    sim.write_text(json.dumps({**json.loads(pathlib.Path("configs/sim.json").read_text()), "has_spread": False}))
    batches = Program(program, 100, 410001)
    heads(
        "sd_position_m", "C_p of tau_h", *(f"within 10 ms, {change_s:+.1f} s" for change_s in CHANGES_S),
        "dead time - 0.2 s: 95 %, m", "lag x 1.4: 95 %, m", "rigid body, wind 1.5 m/s: 95 %, m", "dead time + 0.1 s: 95 %, m",
    )
    for sd_position_m, c_p in CHOICES:
        config.write_text(settings(sd_position_m, c_p))
        fractions = within_10_ms(program, folder, sim, flights, seed, "--config", config)
        rows = [
            ("identified", "dead_time=-0.2"), ("identified", "lag=1.4"), ("rigid body", "wind=1.5"), ("rigid body", "dead_time=+0.1")
        ]
        flown = [batches.fly(plant, [varied], config=config) for plant, varied in rows]
        cells = [distance(batch["by_truth"]) + some(batch) for batch in flown]
        line(str(sd_position_m), f"{c_p:g}", *(f"{fraction:.2f}" for fraction in fractions), *cells)
    heads("rigid body", "C_p of tau_h", "lap 1", "2", "3", "4", "5", "finished")
    laps = {"mission": "configs/missions/square_laps.json", "config": config}
    for varied in ["lag=3", "wind=1.5"]:
        for c_p in [7.0, 4.0]:
            config.write_text(settings(0.006, c_p))
            for earlier in [{}, {"earlier": 1}]:
                flown = batches.fly("rigid body", [varied], **laps, **earlier)
                flight = varied + (", second flight" if earlier else "")
                line(flight, f"{c_p:g}", *map(distance, flown["laps"]), str(flown["finished_count"]))


if __name__ == "__main__":
    if not 2 <= len(sys.argv) <= 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
