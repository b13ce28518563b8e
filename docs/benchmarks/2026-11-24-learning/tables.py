#!/usr/bin/env python3
"""The tables of this page on learning in flight, by one command.

    tables.py tello-ctl [FLIGHTS [FIRST_SEED]] > tables.txt

Runs `tello-ctl sim --batch` for every row, in the root of the repository. Prints each command to standard error.
"""

import json
import pathlib
import subprocess
import sys
import tempfile

PLANTS = {"identified": "fitted", "rigid body": "rigid_body"}
VARIED = ["", "gain=0.7", "gain=1.3", "dead_time=-0.1", "dead_time=+0.1", "lag=0.7", "lag=1.4", "theta_0=-0.3", "theta_0=+0.3"]
ALL_WRONG = ["gain=0.6", "dead_time=+0.15", "lag=1.6", "theta_0=+0.5"]
WEAK = [
    ["dead_time=+0.28"],
    ["lag=1.8"],
    ["lag=3"],
    ["theta_0=+0.6"],
    ["theta_0=+0.8"],
    ["theta_0=+1.0"],
    ["flow=0.5"],
    ["no flow"],
    ["wind=1.5"],
    ["wind=3"],
    ALL_WRONG,
]
# The rigid body of the simulator, whose flow says that it stands still: velocity commands become tilts.
NO_FLOW = {
    "attitude_radps": 14.0,
    "attitude_damping": 0.5,
    "velocity_ki": 0.0,
    "flow_tau_s": 1e6,
    "flow_drift_mps": 0.0,
    "flow_drift_tau_s": 10.0,
    "drag_per_s": 0.25,
    "wind_mps": 0.0,
    "gust_mps": 0.1,
    "gust_tau_s": 1.5,
    "motor_tau_s": 0.05,
    "sag": 0.15,
}


class Program:
    def __init__(self, path, flights, seed):
        self.path, self.flights, self.seed = path, flights, seed
        self.no_flow = pathlib.Path(tempfile.mkdtemp()) / "no_flow.json"
        settings = json.loads(pathlib.Path("configs/sim.json").read_text())
        settings["plant"]["rigid_body"] = NO_FLOW
        self.no_flow.write_text(json.dumps(settings))

    def fly(self, plant, varied=(), **options):
        command = [self.path, "sim", "--batch", str(self.flights), "--seed", str(self.seed), "--json"]
        options = {"profile": "good_day", "mission": "configs/missions/square.json", **options}
        if "no flow" in varied:
            options["sim-config"] = str(self.no_flow)
        else:
            options["plant"] = PLANTS[plant]
        for name, value in options.items():
            command += [f"--{name}", str(value)]
        for change in varied:
            command += ["--vary", change] if "=" in change else []
        print(" ".join(command), file=sys.stderr, flush=True)
        return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def name(varied):
    return ", ".join(change.replace("=+", " + ").replace("=-", " - ").replace("=", " ") for change in varied) or "nominal"


def distance(part):
    """95 % of the distances, and the flights within 0.3 m where not all are."""
    if part is None:
        return "-"
    within = part["within_valid_distance"]
    return f"{part['pooled_distance_m'][1]:.4f}" + (f", {within:.3f}" if within < 1 else "")


def some(batch):
    """Flights that finished, where not all did."""
    return "" if batch["finished_count"] == batch["flights_count"] else f" ({batch['finished_count']})"


def ending(batch):
    """Median of the finish, of all flights: 120 s for those that did not finish."""
    if batch["by_truth"] is None:
        return "-" + some(batch)
    return f"{batch['by_truth']['finish_quartiles_s'][1]:.2f}{some(batch)}"


def hovered(batch):
    """Median and largest RMS of the horizontal error."""
    if batch["hover"] is None:
        return "-" + some(batch)
    return "{:.3f}, {:.3f}".format(*batch["hover"]["horizontal_rms_m"]) + some(batch)


def heads(*columns):
    print("\n| " + " | ".join(columns) + " |\n" + "|---" * len(columns) + "|", flush=True)


def line(*cells):
    print("| " + " | ".join(cells) + " |", flush=True)


def varied(program, plant):
    print(f"\n{plant}")
    heads("vehicle", "lap 1", "2", "3", "4", "5", "finished", "second flight, lap 1", "after one square", "finish, s")
    for change in VARIED:
        change = [change] if change else []
        laps = program.fly(plant, change, mission="configs/missions/square_laps.json")
        later = program.fly(plant, change, mission="configs/missions/square_laps.json", earlier=1)
        square = program.fly(plant, change, earlier=1)
        cells = [distance(lap) for lap in laps["laps"]]
        cells += [str(laps["finished_count"]), distance(later["laps"][0])]
        line(name(change), *cells, distance(square["by_truth"]), ending(square))


def beside_thesis(program):
    heads("plant", "flight", "95 %, m", "finish, s", "thesis: 95 %, m", "finish, s")
    flights = {
        "square": {},
        "figure of eight": {"mission": "configs/missions/figure_eight.json"},
        "hover 30 s, RMS": {"hover": 30},
        "outages": {"profile": "outages"},
        "wind 0.5 m/s": {"varied": ["wind=0.5"]},
    }
    for plant in PLANTS:
        for flight, options in flights.items():
            if plant == "identified" and "varied" in options:
                continue
            cells = []
            for settings, square in [("fly", "missions"), ("thesis/fly", "targets")]:
                mission = {"mission": f"configs/{square}/square.json", **options}
                batch = program.fly(plant, config=f"configs/{settings}.json", **mission)
                cells += [hovered(batch), ""] if "hover" in options else [distance(batch["by_truth"]), ending(batch)]
            line(plant, flight, *cells)


def weak(program):
    heads("rigid body", "95 %, m", "finish, s", "hover, m", "second flight: 95 %, m", "finish, s", "hover, m")
    for change in WEAK:
        cells = []
        for options in [{}, {"earlier": 1}]:
            square = program.fly("rigid body", change, **options)
            hover = program.fly("rigid body", change, hover=30, **options)
            cells += [distance(square["by_truth"]), ending(square), hovered(hover)]
        line(name(change), *cells)


def main(path, flights="200", seed="410001"):
    program = Program(path, int(flights), int(seed))
    for plant in PLANTS:
        varied(program, plant)
    beside_thesis(program)
    weak(program)


if __name__ == "__main__":
    if not 2 <= len(sys.argv) <= 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
