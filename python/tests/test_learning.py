"""Stable-Baselines3 trains on the environments."""

import os
import re
from pathlib import Path

import pytest

try:
    import gymnasium
    import nbclient
    import nbformat
    from stable_baselines3.common.env_checker import check_env
except ImportError as missing:
    if os.environ.get("CI"):
        raise
    pytest.skip(f"NOT CHECKED: {missing}", allow_module_level=True)
import tello_ctl.envs  # noqa: F401  registers

NOTEBOOK = Path(__file__).parent.parent / "notebooks" / "policy.ipynb"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("task", ["TelloHover-v0", "TelloTrack-v0", "TelloSquare-v0"])
def test_stable_baselines_accepts_the_environment(task):
    check_env(gymnasium.make(task).unwrapped)


def test_a_policy_learns_what_its_teacher_left_out(tmp_path):
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": tmp_path}}).execute()
    printed = "".join(output.get("text", "") for cell in notebook.cells for output in cell.get("outputs", []))
    flown = {name: (float(median), float(most)) for name, median, most in re.findall(r"(\w+) +(0\.\d+) +(0\.\d+)", printed)}
    print(printed)
    assert list(flown) == ["expert", "cloned", "learned"], printed
    assert flown["expert"] < flown["learned"], printed
    assert flown["learned"][0] < 0.8 * flown["cloned"][0] and flown["learned"][1] < flown["cloned"][1], printed
