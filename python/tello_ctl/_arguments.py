"""Arguments on their way to the native part."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from ._native import TelloError

Path = Union[str, "os.PathLike[str]"]
Floats = npt.NDArray[np.float64]
_FLOAT64 = np.dtype(np.float64)


def numbers(name: str, value: npt.ArrayLike, dimensions: int) -> Floats:
    """`value` as float64 array of so many dimensions."""
    if type(value) is np.ndarray and value.dtype is _FLOAT64 and value.ndim == dimensions:
        # What a control loop passes: half a microsecond less.
        return value
    try:
        array = np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TelloError(f"{name}: expected numbers, given {type(value).__name__}: {error}") from None
    if array.ndim != dimensions:
        raise TelloError(f"{name}: expected {dimensions} dimensions, given shape {array.shape}")
    return array


def text(name: str, value: Optional[Mapping[str, Any]]) -> str:
    """A mapping of settings as JSON."""

    def plain(entry: Any) -> Any:
        if isinstance(entry, np.ndarray):
            return entry.tolist()
        if isinstance(entry, np.generic):
            return entry.item()
        raise TypeError(f"{name}: {type(entry).__name__} is no value of a setting")

    try:
        return json.dumps(dict(value or {}), default=plain, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise TelloError(f"{name}: {error}") from None


def mapping(name: str, value: Union[Mapping[str, Any], Path, None]) -> Optional[str]:
    """A mapping, or the JSON file of one, as JSON."""
    if value is None:
        return None
    if isinstance(value, Mapping):
        return text(name, value)
    with open(value, encoding="utf-8") as file:
        return file.read()


def files(value: Union[Path, Iterable[Path]]) -> list[str]:
    """One path or several."""
    if isinstance(value, (str, os.PathLike)):
        value = [value]
    return [os.fspath(path) for path in value]
