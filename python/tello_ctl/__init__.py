"""Identify, estimate, control and simulate a small quadrotor with an input delay, and systems of your own.

Poses are (x, y, z, theta) in the world frame, m and rad, theta counter-clockwise from above. Sticks are
(roll, pitch, yaw, throttle) in [-1, 1]: right, forward, counter-clockwise, up. Times are in seconds.

Everything that can be wrong about an argument raises TelloError, a ValueError, which names the argument.
Long calls let other Python threads run and end at Ctrl-C; `report` and replays of CSV flights compute to their end
first.
"""

from ._native import VERSION, Expression, Model, TelloError, select
from .flights import Batch, batch, defaults, fly, identify, replay, report
from .logs import Channel, Log, read_log
from .simulators import DT, Controllers, Simulators, State
from .solvers import Fit, Mhe, Mpc, Planned, Solved, fit

__version__ = VERSION

__all__ = [
    "DT",
    "VERSION",
    "Batch",
    "Channel",
    "Controllers",
    "Expression",
    "Fit",
    "Log",
    "Mhe",
    "Model",
    "Mpc",
    "Planned",
    "Simulators",
    "Solved",
    "State",
    "TelloError",
    "batch",
    "defaults",
    "fit",
    "fly",
    "identify",
    "read_log",
    "replay",
    "report",
    "select",
]
