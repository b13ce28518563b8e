"""Squares whose object is found in two places from 5 s on: split.py TELLO-CTL. Writes one batch per offset and fraction."""
import json
import pathlib
import subprocess
import sys
import tempfile

settings = json.loads(pathlib.Path("configs/sim.json").read_text())
with tempfile.TemporaryDirectory() as folder:
    path = pathlib.Path(folder, "sim.json")
    for offset_m, fraction in [
        (0.12, 0.5), (0.15, 0.5), (0.2, 0.5), (0.25, 0.75), (0.25, 0.25), (0.3, 0.5), (0.35, 0.5), (0.3, 0.1), (0.3, 0.9),
    ]:
        fault = {"mocap_split": {"offset_m": [offset_m, 0, 0], "fraction": fraction}}
        settings["faults"] = [{"fault": fault, "from_s": 5.0, "for_s": 1000.0}]
        path.write_text(json.dumps(settings))
        print(f"offset {offset_m} m, fraction {fraction}", flush=True)
        subprocess.run([sys.argv[1], "sim", "--batch", "60", "--sim-config", str(path)], check=True)
