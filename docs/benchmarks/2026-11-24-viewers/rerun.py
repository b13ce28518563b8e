"""What Rerun makes of a log: `rerun.py LOG`, with the packages rerun-sdk and mcap.

Converts the log, prints the recording as text and holds positions of the track, transforms and plots against
/estim/state. Exit code 1 where a number differs or one is missing.
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from mcap.reader import make_reader

RERUN = Path(sys.executable).with_name("rerun")


def rows(recording, entity):
    """Cells of the rows of an entity, by time; a row ends with its data."""
    printed = subprocess.run(
        [RERUN, "rrd", "print", "-vvv", "--entity", entity, recording], capture_output=True, text=True, check=True
    ).stdout
    for line in printed.splitlines():
        cells = [cell.strip() for cell in line.strip("│ ").split("┆")]
        # Behind its number a row of data has its times; the other rows are about the channel.
        if cells[0].startswith("row_") and re.match(r"\d{4}-", cells[1]):
            yield cells


def lists(cells):
    """The numbers of each cell that holds a list of them; Rerun prints the first of many."""
    for cell in cells:
        if re.fullmatch(r"[\[\]\d.,eE+\-NaN\s…]+", cell) and cell.startswith("["):
            yield [float(number) for number in re.findall(r"NaN|-?[\d.]+(?:[eE][+-]?\d+)?", cell)]


def main():
    log = sys.argv[1]
    with open(log, "rb") as stream:
        states = [json.loads(m.data) for _, _, m in make_reader(stream).iter_messages(topics=["/estim/state"])]
    expected = [[state[key] for key in "xyz"] for state in states]
    faults = 0
    with tempfile.TemporaryDirectory() as folder:
        recording = f"{folder}/flight.rrd"
        subprocess.run([RERUN, "mcap", "convert", log, "-o", recording], check=True, capture_output=True)
        # Rerun keeps places in single precision, plots in double.
        accuracies_m = {"/scene/pose": 1e-6, "/scene/transform": 1e-6, "/scene/numbers/position": 1e-15}
        for entity, accuracy_m in accuracies_m.items():
            found = []
            for cells in rows(recording, entity):
                numbers = list(lists(cells))
                positions = [n[:3] for n in numbers if len(n) == 3 or len(n) > 4]
                found += positions[:1]
            worst = max(
                (abs(a - b) for one, other in zip(found, expected) for a, b in zip(one, other)), default=float("nan")
            )
            print(f"{entity}: {len(found)} of {len(expected)}, largest difference {worst:.1e}")
            faults += len(found) != len(expected) or not worst <= accuracy_m
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
