"""Arguments on their way to the native part."""

from __future__ import annotations

import json
import operator
import os
from collections.abc import Iterable, Mapping
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from ._native import TelloError

Path = Union[str, "os.PathLike[str]"]
Floats = npt.NDArray[np.float64]
_FLOAT64 = np.dtype(np.float64)


def numbers(name: str, value: npt.ArrayLike, dimensions: Optional[int]) -> Floats:
    """`value` as float64 array of so many dimensions; None: of any number."""
    if type(value) is np.ndarray and value.dtype is _FLOAT64 and value.ndim == dimensions:
        # What a control loop passes: half a microsecond less.
        return value
    try:
        array = np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TelloError(f"{name}: expected numbers, given {type(value).__name__}: {error}") from None
    if dimensions is not None and array.ndim != dimensions:
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
    try:
        with open(file(name, value), encoding="utf-8") as opened:
            return opened.read()
    except (OSError, UnicodeDecodeError) as error:
        raise TelloError(f"{name}: {value}: {error}") from None


def whole(name: str, value: Any, below: int = 2**64) -> int:
    """A whole number from 0 on."""
    try:
        number = operator.index(value)
    except TypeError:
        number = -1
    if not 0 <= number < below:
        raise TelloError(f"{name}: expected a whole number in 0..{below}, given {value!r}")
    return number


def wholes(name: str, values: Iterable[Any]) -> list[int]:
    """Several of them."""
    try:
        given = list(values)
    except TypeError:
        raise TelloError(f"{name}: expected whole numbers, given {values!r}") from None
    return [whole(f"{name}[{position}]", value) for position, value in enumerate(given)]


def file(name: str, value: Path) -> str:
    """One path."""
    try:
        path: Any = os.fspath(value)
    except TypeError:
        path = None
    if not isinstance(path, str):
        raise TelloError(f"{name}: expected a path, given {value!r}")
    return path


def files(name: str, value: Union[Path, Iterable[Path]], at_least: int = 1) -> list[str]:
    """One path or several."""
    try:
        paths = [value] if isinstance(value, (str, os.PathLike)) else list(value)
    except TypeError:
        raise TelloError(f"{name}: expected paths, given {value!r}") from None
    if len(paths) < at_least:
        raise TelloError(f"{name}: expected at least {at_least} path, given none")
    return [file(name, path) for path in paths]
