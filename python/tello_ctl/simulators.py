"""The deterministic simulator, step by step, and the flight's own controller beside it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _native
from ._arguments import Floats, Path, mapping, numbers, text, whole, wholes

DT = 0.02
"""Period of the simulator, s."""


@dataclass(frozen=True)
class State:
    """What a step of n drones shows."""

    measured: Floats
    """Newest pose of each drone by motion capture, (n, 4); noise, stalls, flips and losses included."""
    age: Floats
    """How old it is, (n,), s."""
    pose: Floats
    """True poses, (n, 4), heading continuous."""
    velocity: Floats
    """True velocities in the world frame, (n, 4): m/s and rad/s."""
    link: npt.NDArray[np.bool_]
    """Whether commands arrive, (n,)."""


class Simulators:
    """Simulated drones in flight: dead time, lag, dead zone, disturbances, mocap faults, outages.

    One drone per seed. `settings` holds the keys that differ from `defaults("sim")`, for instance
    `{"profile": "clean"}`; the drones start in the air near (0, 0, 1.2, 0) unless `start` says otherwise.
    Equal seeds and sticks give equal flights, bit for bit.
    """

    def __init__(self, seeds: Iterable[int], settings: Optional[Mapping[str, Any]] = None) -> None:
        start = {"air": {"x": 0.0, "y": 0.0, "z": 1.2, "theta": 0.0}}
        changes = {"start": start, **(settings or {})}
        self._native = _native.Simulators(wholes("seeds", seeds), text("settings", changes))

    def __len__(self) -> int:
        return len(self._native)

    def observe(self) -> State:
        """What the last step showed."""
        return State(*self._native.observe())

    def step(self, sticks: npt.ArrayLike) -> State:
        """Flies one period of 20 ms with `sticks` (n, 4), held to [-1, 1]."""
        return State(*self._native.step(numbers("sticks", sticks, 2)))

    def reset(self, drones: Iterable[int], seeds: Iterable[int]) -> State:
        """Starts some drones anew, each with a seed."""
        return State(*self._native.reset(wholes("drones", drones), wholes("seeds", seeds)))


class Controllers:
    """`count` controllers of the flight program: outlier filter, MHE, prediction over the dead time, MPC.

    They take their own sticks to be flown. `config` holds the keys that differ from `defaults("fly")`.
    """

    def __init__(
        self,
        count: int,
        *,
        mission: Union[Mapping[str, Any], Path, None] = None,
        config: Optional[Mapping[str, Any]] = None,
    ) -> None:
        flown = (mapping("mission", mission), text("config", config))
        self._native = _native.Controllers(whole("count", count), *flown)

    def act(self, state: State) -> Floats:
        """The sticks of each controller for its drone, (n, 4).

        They follow from measured poses; true poses and velocities are only what the drone reports of itself, which
        the monitors compare.
        """
        is_new = np.ascontiguousarray(state.age <= 0.0)
        return self._native.act(state.measured, is_new, state.pose, state.velocity)

    def reset(self, controllers: Iterable[int]) -> None:
        """Starts some controllers anew."""
        self._native.reset(wholes("controllers", controllers))
