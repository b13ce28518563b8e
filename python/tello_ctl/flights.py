"""What the commands of `tello-ctl` do, with the same results bit for bit."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any, Optional, Union

from . import _native
from ._arguments import Path, file, files, mapping, text, whole
from ._native import TelloError

Settings = Mapping[str, Any]


class Batch(dict[str, Any]):
    """The table of a batch, as `tello-ctl sim --batch N --json` prints it."""

    def frame(self) -> Any:
        """One row per flight as pandas DataFrame, inner fields as `outer.inner`."""
        import pandas as pd

        return pd.json_normalize(self["flights"])


def defaults(kind: str) -> dict[str, Any]:
    """The built-in settings of "fly", "sim" or "ident", or the built-in "mission"."""
    table: dict[str, Any] = json.loads(_native.defaults(kind))
    return table


def batch(
    count: int,
    seed: int = 1,
    *,
    mission: Union[Settings, Path, None] = None,
    config: Optional[Settings] = None,
    sim: Optional[Settings] = None,
    hover: Optional[float] = None,
) -> Batch:
    """Flies the seeds `seed .. seed + count` in virtual time on all cores.

    `mission` is a mission or its file. `config` and `sim` hold the keys that differ from `defaults("fly")` and
    `defaults("sim")`. With `hover` the vehicle hovers at the first target for so many seconds.
    """
    if whole("count", count) < 1:
        raise TelloError(f"count: expected at least 1, given {count}")
    first = whole("seed", seed, 2**64 - count)
    flown = (mapping("mission", mission), text("config", config), text("sim", sim))
    return Batch(json.loads(_native.batch(first, count, flown, hover)))


def fly(
    log: Path,
    seed: int = 1,
    *,
    mission: Union[Settings, Path, None] = None,
    config: Optional[Settings] = None,
    sim: Optional[Settings] = None,
) -> dict[str, Any]:
    """Flies one seed in virtual time and leaves its log (MCAP) at `log`; how it ended comes back."""
    flown = (mapping("mission", mission), text("config", config), text("sim", sim))
    ended: dict[str, Any] = json.loads(_native.fly(file("log", log), whole("seed", seed), flown))
    return ended


def identify(
    logs: Union[Path, Iterable[Path]],
    *,
    settings: Optional[Settings] = None,
    bootstrap: Optional[int] = None,
    seed: int = 1,
    out: Optional[Path] = None,
) -> dict[str, Any]:
    """Identifies the vehicle from logs: files (CSV, MCAP) or folders of them.

    `settings` holds the keys that differ from `defaults("ident")`; `bootstrap` estimates again with so many
    resamples. With `out`, the parameter file and figures are written to that folder. The result is that of
    `tello-ctl ident --json` (`seconds` is 0): `["parameters"]` has one entry per parameter.
    """
    report: dict[str, Any] = json.loads(
        _native.identify(
            files("logs", logs),
            text("settings", settings),
            None if bootstrap is None else whole("bootstrap", bootstrap),
            whole("seed", seed),
            None if out is None else file("out", out),
        )
    )
    return report


def replay(
    logs: Union[Path, Iterable[Path]], *, config: Optional[Path] = None, out: Optional[Path] = None
) -> dict[str, Any]:
    """Runs recorded flights through the control loop again and compares, as `tello-ctl replay --json`."""
    replayed: dict[str, Any] = json.loads(
        _native.replay(
            files("logs", logs),
            None if config is None else file("config", config),
            None if out is None else file("out", out),
        )
    )
    return replayed


def report(
    logs: Union[Path, Iterable[Path]],
    out: Path = "report.html",
    *,
    against: Union[Path, Iterable[Path]] = (),
) -> dict[str, Any]:
    """Writes the page of recorded flights to `out`; its numbers come back, as `tello-ctl report --json`.

    An older page at `out` is replaced, any other file is not.
    """
    numbers: dict[str, Any] = json.loads(
        _native.report(files("logs", logs), files("against", against, 0), file("out", out))
    )
    return numbers
