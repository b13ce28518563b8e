"""Estimation, control and identification of any discrete-time system.

A system is a `Model`: `s' = step(s, u, p, dt)`, `o = observe(s)`. Its functions are called once, with
expressions in place of numbers, and compiled with their exact derivatives: no Python runs in the solvers.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple, Optional, Union

import numpy.typing as npt

from . import _native
from ._arguments import Floats, numbers, text
from ._native import Model, TelloError

import numpy as np


class Solved(NamedTuple):
    """How a solver ended."""

    cost: float
    iterations: int
    converged: bool
    """Whether it ended by a tolerance, not by its limit of iterations."""


class Planned(NamedTuple):
    """How a controller ended."""

    cost: float
    iterations: int
    has_new_plan: bool
    """Whether the plan is new; if not, it is the one from before, shifted or zero."""


@dataclass(frozen=True)
class Fit:
    """An identified parameter."""

    parameter: Floats
    deviation: Floats
    """Standard deviation of each entry by Laplace's approximation; NaN if data and prior do not determine the entry."""
    cost: float
    iterations: int
    converged: bool
    """Whether it ended by a tolerance; if not, `deviation` says nothing."""


class Mhe:
    """Moving horizon estimator of state and parameter.

    `settings` are keys of the estimator's table: `p_prior` (required for own models), `p_lb`, `p_ub`, `C_o`, `C_s`,
    `C_p` (weights; residuals of transitions are divided by `dt`), `window_steps`, `arrival`, `observation_loss`,
    `transition_loss`, `solver`. For `Model.vehicle("lagged")` the defaults are those of flights.
    """

    def __init__(self, model: Model, dt: float, **settings: Any) -> None:
        self._native = _native.Mhe(model, dt, text("settings", settings))

    def start(self, o: npt.ArrayLike) -> None:
        """Starts, or starts again, at rest where `o` (observations) was observed."""
        self._native.start(numbers("o", o, 1))

    def update(self, u: npt.ArrayLike, o: Optional[npt.ArrayLike]) -> Solved:
        """One period later: `u` (inputs) was applied in it, `o` (observations) is seen at its end, or None.

        A NaN in `o` is a row that was not observed.
        """
        seen = None if o is None else numbers("o", o, 1)
        return Solved(*self._native.update(numbers("u", u, 1), seen))

    @property
    def state(self) -> Floats:
        """The newest state estimate, (states,)."""
        return self._native.state

    @property
    def parameter(self) -> Floats:
        """The parameter estimate, (parameters,)."""
        return self._native.parameter


class Mpc:
    """Model predictive controller.

    `settings` are keys of the controller's table: `horizon_steps`, `stages`, `C_s`, `C_s_end`, `C_u` (weights),
    `u_lb`, `u_ub`, `input_cost` ("absolute" or "difference"), `solver`.
    """

    def __init__(self, model: Model, dt: float, **settings: Any) -> None:
        self._native = _native.Mpc(model, dt, text("settings", settings))
        self._rest = np.zeros(model.inputs)

    def solve(
        self,
        state: npt.ArrayLike,
        parameter: npt.ArrayLike,
        reference: npt.ArrayLike,
        u_before: Optional[npt.ArrayLike] = None,
    ) -> Planned:
        """Plans from `state`. `reference` is (stages, states), or one state for all stages."""
        target = numbers("reference", reference, None)
        if target.ndim == 1:
            target = target[None]
        before = self._rest if u_before is None else numbers("u_before", u_before, 1)
        solved = self._native.solve(
            numbers("state", state, 1),
            numbers("parameter", parameter, 1),
            numbers("reference", target, 2),
            before,
        )
        return Planned(*solved)

    def shift(self) -> None:
        """Moves the plan on by one period: the start of the next solution."""
        self._native.shift()

    @property
    def plan(self) -> Floats:
        """The planned inputs, (stages, inputs); the first row is what to send now."""
        return self._native.plan

    @property
    def planned_states(self) -> Floats:
        """The planned states, one row per stage."""
        return self._native.planned_states


def fit(
    model: Model,
    pieces: Iterable[tuple[npt.ArrayLike, npt.ArrayLike]],
    dt: float,
    **settings: Any,
) -> Fit:
    """Identifies the parameter of `model` from pieces of inputs (n, inputs) and observations (n, observations).

    `u[k]` was applied from step k to k + 1. A NaN is a row that was not observed. `settings`: `p_prior` (required), `p_lb`, `p_ub`, `C_o`, `C_s`, `C_p`,
    `C_0`, `observation_loss`, `transition_loss`, `curvature` (Gauss-Newton for own models), `solver`.
    """
    arrays: list[tuple[Floats, Floats]] = []
    for position, piece in enumerate(pieces):
        try:
            u, o = piece
        except (TypeError, ValueError):
            raise TelloError(f"pieces[{position}]: expected a pair of inputs and observations") from None
        name = f"pieces[{position}]"
        arrays.append((numbers(f"{name}: inputs", u, 2), numbers(f"{name}: observations", o, 2)))
    parameter, deviation, cost, iterations, converged = _native.fit(model, arrays, dt, text("settings", settings))
    return Fit(np.asarray(parameter), np.asarray(deviation), cost, iterations, converged)
