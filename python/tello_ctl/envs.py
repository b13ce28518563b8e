"""Gymnasium environments over the simulator: hover, track a moving reference, fly the square.

    import gymnasium, tello_ctl.envs
    env = gymnasium.make("TelloHover-v0", profile="good_day")
    envs = gymnasium.make_vec("TelloSquare-v0", num_envs=4096)

Action: sticks (roll, pitch, yaw, throttle) in [-1, 1]. They act after the vehicle's dead time: of the nominal
vehicle 0.34 s in roll and pitch.

Observation, 92 numbers, from motion capture and what was sent alone, horizontal vectors turned by the heading:
target minus position (3, m), heading error (1, rad), velocity by low-pass filtered differences (3, m/s), yaw
rate (1, rad/s), age of the pose (1, s), velocity of the target (3, m/s), the last 20 actions, newest first (80).

Reward: per step -(distance + 0.3 |heading error|) * dt - 0.002 |action|^2 * dt by the true pose; the square adds
1 for each corner. An episode terminates with -5 when the vehicle leaves its box, and in the square at the last
corner; it is truncated after `max_episode_steps`.

`expert_action()` is what the flight program's own controller (MHE, prediction, MPC) would send. It assumes
that its actions are applied: mixed with other actions its estimate is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Callable, Optional

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from . import _native
from ._arguments import Floats, numbers, text
from ._native import TelloError
from .simulators import DT, Controllers, State

HISTORY = _native.HISTORY
"""Actions in an observation: 0.4 s, more than the nominal dead time."""
OBSERVATIONS = _native.OBSERVATIONS

_HEIGHT = 1.3
_TRACK_HOLD_S = 2.0
_TRACK_PERIOD_S = 14.0
_MISSION_MAX_S = 3600.0
"""Longest mission that the flight program accepts."""


def _follow(within: float) -> dict[str, Any]:
    """Settings of the expert, whose mission begins `within` this distance of its first pose."""
    return {
        "reach": 0.2,
        "start": {"within": within, "settle_s": 0.0},
        "wait": {"begin_m": 0.15, "stop_m": 0.4},
    }


def _lemniscate(time_s: Floats) -> tuple[Floats, Floats]:
    """Position and velocity on a figure eight of 2 m x 1 m after a hold at its centre, (n, 3) each."""
    flown = np.maximum(time_s - _TRACK_HOLD_S, 0.0)
    rate = 2.0 * math.pi / _TRACK_PERIOD_S
    # The phase starts at rest.
    ramp = np.minimum(flown / 2.0, 1.0)
    phase = rate * np.where(flown < 2.0, flown * flown / 4.0, flown - 1.0)
    speed = rate * ramp
    zero = np.zeros_like(phase)
    position = np.stack([np.sin(phase), 0.5 * np.sin(2.0 * phase), zero + _HEIGHT], axis=-1)
    velocity = np.stack([np.cos(phase) * speed, np.cos(2.0 * phase) * speed, zero], axis=-1)
    return position, velocity


class _Task:
    """Where the target is."""

    steps = 500
    corners = np.array([[0.0, 0.0, _HEIGHT]])
    period: Optional[int] = None
    """Rows of `targets` that repeat at its end, if they are one per step and not corners."""

    def targets(self) -> Floats:
        """Positions and velocities, (n, 6)."""
        return np.hstack([self.corners, np.zeros_like(self.corners)])

    def mission(self, steps: int) -> dict[str, Any]:
        """What the expert flies in an episode of at most so many steps."""
        x, y, z = self.corners[0]
        rows = [[0.0, x, y, z, 0.0], [min(steps * DT + 60.0, _MISSION_MAX_S), x, y, z, 0.0]]
        return {"trajectory": {"points": {"rows": rows}, "accel_max_mps2": 0.9, "follow": _follow(0.5)}}


class _Track(_Task):
    steps = 1000
    period = round(_TRACK_PERIOD_S / DT)

    def targets(self) -> Floats:
        return np.hstack(_lemniscate(np.arange(self.steps + 1 + self.period) * DT))

    def mission(self, steps: int) -> dict[str, Any]:
        times = np.arange(0.0, min(steps * DT + 10.0, _MISSION_MAX_S), 0.1)
        position, _ = _lemniscate(times)
        rows = [[float(t), *map(float, row), 0.0] for t, row in zip(times, position)]
        return {"trajectory": {"points": {"rows": rows}, "accel_max_mps2": 0.9, "follow": _follow(0.5)}}


class _Square(_Task):
    steps = 1000
    corners = np.array(
        [[0.0, 0.0, _HEIGHT], [0.0, 1.5, _HEIGHT], [1.5, 1.5, _HEIGHT], [1.5, 0.0, _HEIGHT], [0.0, 0.0, _HEIGHT]]
    )

    def mission(self, steps: int) -> dict[str, Any]:
        waypoints = [[*map(float, corner), 0.0] for corner in self.corners]
        limits = {"speed_max_mps": 1.2, "accel_max_mps2": 0.9, "climb_max_mps": 0.3, "turn_max_radps": 1.0}
        return {
            "waypoints": {
                "waypoints": waypoints,
                "corner_m": 0.1,
                "heading": "fixed",
                "limits": limits,
                # The estimate within half of what the environment demands of the true pose.
                "follow": _follow(0.1),
            }
        }


_TASKS: dict[str, Callable[[], _Task]] = {"hover": _Task, "track": _Track, "square": _Square}


class TelloVectorEnv(VectorEnv):  # type: ignore[type-arg]
    """`num_envs` vehicles, each with its own task, seed and faults. An ended one starts anew at the next step."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 50, "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        task: str = "hover",
        profile: str = "good_day",
        sim: Optional[Mapping[str, Any]] = None,
        max_episode_steps: Optional[int] = None,
        render_mode: Optional[str] = None,
    ) -> None:
        if task not in _TASKS:
            raise TelloError(f"task: expected one of {sorted(_TASKS)}, given {task!r}")
        self.task = _TASKS[task]()
        self.steps_max = self.task.steps if max_episode_steps is None else max_episode_steps
        self.num_envs = num_envs
        self.render_mode = render_mode
        x, y, z = map(float, self.task.corners[0])
        start = {"air": {"x": x, "y": y, "z": z, "theta": 0.0}}
        self._settings = {"profile": profile, "start": start, **(sim or {})}
        self.single_action_space = spaces.Box(-1.0, 1.0, (4,), np.float32)
        largest = _native.LARGEST
        self.single_observation_space = spaces.Box(-largest, largest, (OBSERVATIONS,), np.float32)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._environments: Optional[_native.Environments] = None
        self._controllers: Optional[Controllers] = None
        self._expert: Optional[Floats] = None
        self._track: list[Floats] = []

    def reset(
        self, *, seed: Optional[int] = None, options: Optional[dict[str, Any]] = None
    ) -> tuple[npt.NDArray[np.float32], dict[str, Any]]:
        super().reset(seed=seed)
        if self._environments is None:
            settings = text("sim", self._settings)
            targets = self.task.targets()
            self._environments = _native.Environments(settings, targets, self.task.period, self.steps_max)
        observation = self._environments.reset(self._seeds(self.num_envs))
        self._over = np.zeros(self.num_envs, bool)
        self._expert = None
        if self._controllers is not None:
            self._controllers.reset(range(self.num_envs))
        if self.render_mode is not None:
            self._track = [self._state().pose[0].copy()]
        return observation, {}

    def step(
        self, actions: npt.ArrayLike
    ) -> tuple[npt.NDArray[np.float32], Floats, npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]:
        if self._environments is None:
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        sticks = numbers("actions", actions, 2)
        if sticks.shape != (self.num_envs, 4):
            raise TelloError(f"actions: expected shape {(self.num_envs, 4)}, given {sticks.shape}")
        fresh = np.flatnonzero(self._over)
        stepped = self._environments.step(sticks, self._seeds(len(fresh)))
        observation, reward, terminated, truncated, distance, link, corners = stepped
        self._over = terminated | truncated
        self._expert = None
        if len(fresh) and self._controllers is not None:
            self._controllers.reset(fresh)
        if self.render_mode is not None:
            if 0 in fresh:
                self._track = []
            self._track.append(self._state().pose[0].copy())
        return observation, reward, terminated, truncated, {"distance": distance, "link": link, "corners": corners}

    def expert_action(self) -> npt.NDArray[np.float32]:
        """The sticks that the flight program would send now, (n, 4)."""
        if self._controllers is None:
            self._controllers = Controllers(self.num_envs, mission=self.task.mission(self.steps_max))
        if self._expert is None:
            self._expert = self._controllers.act(self._state())
        return self._expert.astype(np.float32)

    def render(self) -> Optional[npt.NDArray[np.uint8]]:
        """The first vehicle from above, its track and its target: 300 x 300 pixels, 2.5 cm each."""
        if self.render_mode != "rgb_array":
            return None
        image = np.full((300, 300, 3), 255, np.uint8)

        def dot(x: float, y: float, radius: int, colour: tuple[int, int, int]) -> None:
            row, column = int(150 - y / 0.025), int(150 + x / 0.025)
            image[max(row - radius, 0) : max(row + radius + 1, 0), max(column - radius, 0) : max(column + radius + 1, 0)] = colour

        for line in range(-3, 4):
            at = int(150 + line / 0.025)
            image[at, :] = image[:, at] = 230
        for x, y, *_ in self._track[-500:]:
            dot(x, y, 0, (120, 160, 220))
        assert self._environments is not None
        x, y, _ = self._environments.first_target()
        dot(x, y, 3, (220, 60, 40))
        x, y, _, heading = self._state().pose[0]
        dot(x, y, 3, (20, 60, 140))
        dot(x + 0.15 * math.cos(heading), y + 0.15 * math.sin(heading), 1, (20, 60, 140))
        return image

    def _seeds(self, count: int) -> list[int]:
        return [int(seed) for seed in self.np_random.integers(0, 2**62, count)]

    def _state(self) -> State:
        assert self._environments is not None
        return State(*self._environments.observe())


class TelloEnv(gymnasium.Env):  # type: ignore[type-arg]
    """One vehicle; arguments as `TelloVectorEnv`."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 50}

    def __init__(self, **arguments: Any) -> None:
        self._vector = TelloVectorEnv(1, **arguments)
        self.render_mode = self._vector.render_mode
        self.action_space = self._vector.single_action_space
        self.observation_space = self._vector.single_observation_space

    def reset(
        self, *, seed: Optional[int] = None, options: Optional[dict[str, Any]] = None
    ) -> tuple[npt.NDArray[np.float32], dict[str, Any]]:
        super().reset(seed=seed)
        observation, _ = self._vector.reset(seed=int(self.np_random.integers(2**62)))
        return observation[0], {}

    def step(
        self, action: npt.ArrayLike
    ) -> tuple[npt.NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self._vector.step(np.asarray(action)[None])
        first = {name: value[0] for name, value in info.items()}
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), first

    def expert_action(self) -> npt.NDArray[np.float32]:
        """The sticks that the flight program would send now, (4,)."""
        action: npt.NDArray[np.float32] = self._vector.expert_action()[0]
        return action

    def render(self) -> Optional[npt.NDArray[np.uint8]]:
        return self._vector.render()


def _register() -> None:
    for task in _TASKS:
        gymnasium.register(
            f"Tello{task.title()}-v0",
            entry_point="tello_ctl.envs:TelloEnv",
            vector_entry_point="tello_ctl.envs:TelloVectorEnv",
            kwargs={"task": task},
        )


_register()
