"""Logs as arrays."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _native
from ._arguments import Path, file
from ._native import TelloError


@dataclass(frozen=True)
class Channel:
    """The records of one channel."""

    time_ns: npt.NDArray[np.int64]
    """Time of each record since the start of the log, ns."""
    columns: Mapping[str, Any]
    """By name, inner fields as `outer.inner`: arrays of numbers (NaN where absent) or flags, lists of anything else."""

    @property
    def time_s(self) -> npt.NDArray[np.float64]:
        """Time of each record since the start of the log, s."""
        return self.time_ns * 1e-9

    def __getitem__(self, column: str) -> Any:
        return self.columns[column]

    def __len__(self) -> int:
        return len(self.time_ns)

    def frame(self) -> Any:
        """A pandas DataFrame, its index `time_ns`."""
        import pandas as pd

        index = pd.Index(self.time_ns, name="time_ns")
        return pd.DataFrame({name: pd.Series(values, index=index) for name, values in self.columns.items()})


@dataclass(frozen=True)
class Log:
    """A recorded flight."""

    channels: Mapping[str, Channel]
    """By topic, for instance "/estim/state"; docs/logs.md lists them."""
    settings: Optional[Mapping[str, Any]] = field(repr=False)
    """The settings of the flight; None in a log that carries none."""
    torn: Optional[str]
    """Why the log ends early; None if it was closed. Every record is sound in either case."""

    def __getitem__(self, topic: str) -> Channel:
        return self.channels[topic]


def read_log(path: Path, topics: Union[str, Iterable[str], None] = None) -> Log:
    """The log of a flight (MCAP), all channels or those of `topics`, one or several.

    Raises TelloError for a file that is no log, and for a topic that the log does not have.
    """
    chosen = None if topics is None else [topics] if isinstance(topics, str) else list(topics)
    if chosen is not None and not all(isinstance(topic, str) for topic in chosen):
        raise TelloError(f"topics: expected names of channels, given {topics!r}")
    tables, settings, torn = _native.read_log(file("path", path), chosen)
    channels = {topic: Channel(time_ns, columns) for topic, (time_ns, columns) in tables.items()}
    return Log(channels, None if settings is None else json.loads(settings), torn)
