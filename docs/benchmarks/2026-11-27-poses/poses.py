"""Repetitions and jumps in the raw poses of real flights: poses.py FOLDER...

A pose that equals the one before in all four rows is of a stream that stalled, and counts as no pose.
"""
import math
import pathlib
import sys

SPEED_MAX_MPS, DT_S, ROUGH_M, WINDOW = 2.0, 0.02, 0.1, 50


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


print("log,poses,stalled,x and y repeated,longest run,longest run of z,longest run of theta,"
      "rough 0.1 to 0.4 m,most in a second")
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
        rough = []
        for (i, a), (k, b) in pairs:
            jump_m = math.dist(a[:3], b[:3]) - SPEED_MAX_MPS * DT_S * (k - i)
            # The filter of the flight refuses larger ones.
            if ROUGH_M < jump_m < 0.4:
                rough.append(k)
        most = max((sum(0 <= k - i < WINDOW for k in rough) for i in rough), default=0)
        print(f"{path.parent.name}/{path.name},{len(new) + stalled},{stalled},{sum(repeats)},"
              f"{longest(repeats)},{runs[0]},{runs[1]},{len(rough)},{most}")
        total = [a + b for a, b in zip(total, (len(new) + stalled, stalled, sum(repeats), len(rough)))]
print("all,{},{},{},,,,{},".format(*total))
