#!/usr/bin/env python3
"""How long, and how often, the estimator's heading is wrong on recordings.

    wrong_heading.py tello-ctl FLY.json RECORDING.log ...

Runs each recording through `tello-ctl replay` with the settings and compares the estimated heading with the most
probable path of the recorded one on a circle (Viterbi, with what came later known). Steps count where a heading was
recorded within 0.2 s and the estimated height is above 0.3 m. Needs numpy.
"""

import csv
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

DT_S = 0.02
POINTS = 628
SPACING_RAD = 2 * np.pi / POINTS
STEPS_MAX = 5
STEP_COST = 0.35
WRONG_RAD = 0.3


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def sample_cost():
    """Cost of a sample at each distance from the true heading: two normal laws and a uniform one."""
    distance = wrap(np.arange(POINTS) * SPACING_RAD)
    normal = lambda part, sd: part / (sd * np.sqrt(2 * np.pi)) * np.exp(-0.5 * (distance / sd) ** 2)
    return -np.log(normal(0.85, 0.04) + normal(0.10, 0.15) + 0.05 / (2 * np.pi))


def best_path(samples):
    """Most probable headings; NaN is a missing sample. rad"""
    cost, by_sample = np.zeros(POINTS), sample_cost()
    steps_to = np.zeros((len(samples), POINTS), np.int8)
    for k, sample in enumerate(samples):
        best = np.full(POINTS, np.inf)
        for step in range(-STEPS_MAX, STEPS_MAX + 1):
            arriving = np.roll(cost, step) + STEP_COST * step * step
            is_better = arriving < best
            best[is_better], steps_to[k][is_better] = arriving[is_better], step
        if np.isfinite(sample):
            at = int(round((wrap(sample) + np.pi) / SPACING_RAD)) % POINTS
            best = best + np.roll(by_sample, at)
        cost = best - best.min()
    point, path = int(cost.argmin()), np.zeros(len(samples))
    for k in range(len(samples) - 1, -1, -1):
        path[k] = point * SPACING_RAD - np.pi
        point = (point - int(steps_to[k][point])) % POINTS
    return path


def columns(path, names):
    with open(path) as file:
        rows = [[float(row[name] or "nan") for name in names] for row in csv.DictReader(file)]
    return {int(row[0]): np.array(row[1:]) for row in rows}


def headings(folder):
    """Recorded headings that count, estimated ones, and which steps are judged."""
    estimated = columns(folder / "estim_state.csv", ["step", "theta", "z"])
    seen = columns(folder / "vicon_raw.csv", ["step", "x", "y", "z", "theta"])
    steps = sorted(estimated)
    pose = np.array([seen.get(step, np.full(4, np.nan)) for step in steps])
    is_lost = (np.abs(pose[:, :3]) < 1e-3).all(1)
    is_repeated = np.r_[False, (np.diff(pose, axis=0) == 0).all(1)]
    recorded = np.where(is_lost | is_repeated, np.nan, pose[:, 3])
    near = np.array([np.isfinite(recorded[max(0, k - 10) : k + 11]).any() for k in range(len(steps))])
    state = np.array([estimated[step] for step in steps])
    return recorded, state[:, 0], near & (state[:, 1] > 0.3)


def longest_s(is_wrong):
    longest = run = 0
    for wrong in is_wrong:
        run = run + 1 if wrong else 0
        longest = max(longest, run)
    return longest * DT_S


def main(program, settings, *recordings):
    print(f"{'recording':12} {'wrong':>7} {'longest':>8} {'RMS':>6}  theta RMSE 0.2/0.6/1.0 s   x-y RMSE 0.2/0.6/1.0 s  link down")
    for recording in recordings:
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            log = folder / "replay.mcap"
            replay = [program, "replay", recording, "--config", settings, "--out", log, "--json"]
            output = subprocess.run(replay, capture_output=True, text=True, check=True).stdout
            subprocess.run([program, "log", "csv", log, "--out-dir", folder / "csv"], check=True, capture_output=True)
            recorded, estimated, is_judged = headings(folder / "csv")
        error = wrap(estimated - best_path(recorded))[is_judged]
        is_wrong = (np.abs(wrap(estimated - best_path(recorded))) > WRONG_RAD) & is_judged
        [flight] = json.loads(output)["flights"]
        ahead = flight["forecasts"][0]
        row = lambda key: "/".join(f"{value:.3f}" for value in ahead[key])
        name = "/".join(pathlib.Path(recording).with_suffix("").parts[-3:])
        print(
            f"{name:18} {is_wrong.sum() / is_judged.sum():7.2%} {longest_s(is_wrong):6.2f} s {np.sqrt((error**2).mean()):6.3f}"
            f"  {row('theta_rmse_rad')}  {row('xy_rmse_m')}  {flight['ticks_link_down'] / flight['ticks']:.1%}",
            flush=True,
        )


if __name__ == "__main__":
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
