#!/usr/bin/env python3
"""Dead time found after 30 s of flight, against that of the same vehicle without the change.

    dead_times.py tello-ctl [FLIGHTS [FIRST_SEED]]

Flies laps of the square with `--vary dead_time=..` and reads correction plus remaining error from `/estim/link`. Runs in
the root of the repository.
"""

import csv
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile

AT_S = 30.0
CHANGES_S = [0.0, -0.1, 0.1]


def found_s(program, folder, settings, seed, change_s, *options):
    log = folder / "flight.mcap"
    log.unlink(missing_ok=True)
    mission = "configs/missions/square_laps.json"
    command = [program, "sim", "--seed", str(seed), "--profile", "good_day", "--mission", mission, "--sim-config", settings]
    subprocess.run([*command, "--vary", f"dead_time={change_s}", "--log", log, *options], capture_output=True)
    table = [program, "log", "csv", log, "--out-dir", folder, "--topic", "/estim/link", "--force"]
    subprocess.run(table, check=True, capture_output=True)
    value = lambda text: float(text or 0.0)
    with open(folder / "estim_link.csv") as file:
        for row in csv.DictReader(file):
            if float(row["t_s"]) >= AT_S:
                return value(row["dead_time_change_s"]) + value(row["dead_time_error_s"])
    return None


def show(name, errors_s):
    errors_s = sorted(errors_s)
    within = lambda limit_s: sum(abs(error_s) <= limit_s for error_s in errors_s) / len(errors_s)
    rms_s = statistics.fmean(error_s**2 for error_s in errors_s) ** 0.5
    mean_s, largest_s = statistics.fmean(errors_s), max(map(abs, errors_s))
    print(
        f"| {name} | {len(errors_s)} | {mean_s:+.4f} | {rms_s:.4f} | {largest_s:.3f}"
        f" | {within(0.01):.2f} | {within(0.02):.2f} |",
        flush=True,
    )


def main(program, flights="50", seed="430001"):
    folder = pathlib.Path(tempfile.mkdtemp())
    settings = json.loads(pathlib.Path("configs/sim.json").read_text())
    print("| plant, vehicles, change | flights | mean, s | RMS, s | largest, s | within 10 ms | 20 ms |")
    print("|---|---|---|---|---|---|---|")
    for plant in ["fitted", "rigid_body"]:
        for has_spread in [False, True]:
            path = folder / "sim.json"
            path.write_text(json.dumps({**settings, "has_spread": has_spread}))
            rows = []
            for at in range(int(seed), int(seed) + int(flights)):
                row = [found_s(program, folder, path, at, change_s, "--plant", plant) for change_s in CHANGES_S]
                if None not in row:
                    rows.append(row)
            name = f"{plant}, {'drawn' if has_spread else 'equal'}"
            if not has_spread:
                # Of equal vehicles all nominal flights show what a right answer is.
                right_s = statistics.fmean(row[0] for row in rows)
                print(f"<!-- {plant}: nominal {right_s:+.4f} s -->")
                show(f"{name}, 0", [row[0] - right_s for row in rows])
            for k, change_s in list(enumerate(CHANGES_S))[1:]:
                own = lambda row: row[0] if has_spread else right_s
                show(f"{name}, {change_s:+.1f} s", [row[k] - own(row) - change_s for row in rows])


if __name__ == "__main__":
    if not 2 <= len(sys.argv) <= 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
