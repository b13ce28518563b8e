#!/usr/bin/env python3
"""By how much each closed-loop flight of the thesis comes down below its target: no more than it is below, nor than it
has come down since it was last within 0.1 m of the target's height.

    sunk.py squares closed_loop > sunk.txt        # folders of the thesis' repository
"""

import pathlib
import statistics
import sys

LEVEL_M = 0.1

sunk = []
for path in sorted(path for folder in sys.argv[1:] for path in pathlib.Path(folder).iterdir()):
    heights = {"pos": {}, "target": {}}
    for line in path.read_text(errors="replace").splitlines():
        tag, *values = line.split(",")
        if tag in heights and len(values) >= 4:
            try:
                heights[tag][int(values[0])] = float(values[3])
            except ValueError:
                pass  # a torn line
    steps = sorted(heights["pos"].keys() & heights["target"].keys())
    if len(steps) < 500:
        continue
    end = max(step for step in steps if heights["pos"][step] > 0.8) - 100
    worst_m, top_m = 0.0, None
    for step in steps:
        z_m = heights["pos"][step]
        below_m = heights["target"][step] - z_m
        if top_m is None and abs(below_m) > 0.15 or step > end:
            continue
        top_m = z_m if below_m <= LEVEL_M or top_m is None else max(top_m, z_m)
        worst_m = max(worst_m, min(below_m, top_m - z_m))
    sunk.append((worst_m, path.name))
print(f"{len(sunk)} flights, median {statistics.median(worst_m for worst_m, _ in sunk):.3f} m")
for worst_m, name in sorted(sunk, reverse=True)[:10]:
    print(f"{worst_m:.3f} m {name}")
