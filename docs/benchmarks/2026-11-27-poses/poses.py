"""Repetitions and jumps in the raw poses of real flights: poses.py FOLDER...

A pose that equals the one before in all four rows is of a stream that stalled, and counts as no pose.
"""
import math
import pathlib
import sys

SPEED_MAX_MPS, DT_S, ROUGH_M, WINDOW = 2.0, 0.02, 0.1, 50
# Height of a vehicle in the air, and the windows of the stillness monitor: steps of four blocks each.
FLYING_M, STILL_STEPS, BLOCKS = 0.35, (40, 120), 4


def poses(path):
    """The poses of a log by their steps; lines that cannot be read are left out."""
    found = {}
    for line in path.read_text(errors="replace").splitlines():
        tag, _, rest = line.partition(",")
        fields = rest.split(",")
        if tag == "pos" and len(fields) == 5:
            try:
                found[int(fields[0])] = tuple(map(float, fields[1:]))
            except ValueError:
                continue
    return sorted(found.items())


def longest(flags):
    """The longest run of true flags."""
    best = run = 0
    for flag in flags:
        run = run + 1 if flag else 0
        best = max(best, run)
    return best


def least_range_m(new, length):
    """The least range of the means of four blocks, of the row that ranges most, over all windows of `length` steps in the
    air. Blocks with less than half of their poses do not count."""
    by_step = dict(new)
    block, least = length // BLOCKS, math.inf
    for first in range(new[0][0], new[-1][0] - length):
        blocks = [
            [by_step[k] for k in range(first + i * block, first + (i + 1) * block) if k in by_step]
            for i in range(BLOCKS)
        ]
        if any(2 * len(block_poses) < block or min(pose[2] for pose in block_poses) < FLYING_M for block_poses in blocks):
            continue
        means = [[sum(pose[row] for pose in of) / len(of) for of in blocks] for row in range(3)]
        least = min(least, max(max(of_row) - min(of_row) for of_row in means))
    return least


print("log,poses,stalled,x and y repeated,longest run,longest run of z,longest run of theta,"
      "rough 0.1 to 0.4 m,most in a second,deepest step below 2 m/s (m),least range in 0.8 s (m),in 2.4 s (m)")
total = [0, 0, 0, 0]
for folder in sys.argv[1:]:
    for path in sorted(pathlib.Path(folder).glob("*.log")):
        stalled, new = 0, []
        for step, pose in poses(path):
            if new and pose == new[-1][1]:
                stalled += 1
            else:
                new.append((step, pose))
        pairs = list(zip(new, new[1:]))
        repeats = [a[:2] == b[:2] for (_, a), (_, b) in pairs]
        runs = [longest(a[row] == b[row] for (_, a), (_, b) in pairs) for row in (2, 3)]
        rough, deepest_m = [], -math.inf
        for (i, a), (k, b) in pairs:
            flown_m = SPEED_MAX_MPS * DT_S * (k - i)
            jump_m = math.dist(a[:3], b[:3]) - flown_m
            # The filter of the flight refuses larger ones.
            if ROUGH_M < jump_m < 0.4:
                rough.append(k)
            if jump_m < 0.4 and any(b[:3]):
                deepest_m = max(deepest_m, a[2] - b[2] - flown_m)
        seen = [(step, pose) for step, pose in new if any(pose[:3])]
        ranges_m = [least_range_m(seen, length) for length in STILL_STEPS]
        most = max((sum(0 <= k - i < WINDOW for k in rough) for i in rough), default=0)
        print(f"{path.parent.name}/{path.name},{len(new) + stalled},{stalled},{sum(repeats)},"
              f"{longest(repeats)},{runs[0]},{runs[1]},{len(rough)},{most},"
              f"{deepest_m:.3f},{ranges_m[0]:.4f},{ranges_m[1]:.4f}")
        total = [a + b for a, b in zip(total, (len(new) + stalled, stalled, sum(repeats), len(rough)))]
print("all,{},{},{},,,,{},,,,".format(*total))
