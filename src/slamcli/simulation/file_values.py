# SPDX-License-Identifier: MIT
"""Values of one kind out of the document of a world file, or an error that says which entry is wrong."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ConfigError
from slamcli.parameters import unknown_name

MAX_ENTRIES = 200_000
_EXPONENT = re.compile(r"[-+]?\d{1,9}[eE][-+]?\d{1,3}")


class FileValues:
    """Checks values of one file; knows the file's name for its messages. `where` names an entry."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def fail(self, where: str, message: str) -> NoReturn:
        """Raise the error of an entry."""
        raise ConfigError(f"{self.path}: {where}: {message}" if where else f"{self.path}: {message}")

    def mapping(
        self, value: Any, where: str, known: Iterable[str] | None, needed: Iterable[str] = ()
    ) -> Mapping[str, Any]:
        """Return a table; its keys must be `known` (None: any text), `needed` ones there."""
        names = tuple(known) if known is not None else ()
        if not isinstance(value, Mapping):
            self.fail(
                where, f"is {_kind(value)}, not a table of keys" + (f" ({', '.join(names[:6])} ...)" if names else "")
            )
        for key in value:
            if not isinstance(key, str):
                self.fail(where, f"the key {shown(key)} is not text")
            if known is not None and key not in names:
                message = unknown_name(key, names).replace("parameter", "key").split("; `slamcli")[0]
                self.fail(where, message if "did you mean" in message else f"{message}; known are {', '.join(names)}")
        for key in needed:
            if key not in value:
                self.fail(where, f"`{key}` is missing")
        return dict(value)

    def items(self, document: Mapping[str, Any], key: str) -> list[Any]:
        """Return the list under a key, empty where there is none."""
        value = document.get(key) or []
        if not isinstance(value, list):
            self.fail(key, f"is {_kind(value)}, not a list")
        if len(value) > MAX_ENTRIES:
            self.fail(key, f"{len(value)} entries are more than {MAX_ENTRIES}")
        return value

    def text(self, value: Any, where: str) -> str:
        """Return a name."""
        if not isinstance(value, (str, int, float)) or is_huge(value):
            self.fail(where, f"{shown(value)} is not text")
        return str(value)

    def number(self, value: Any, where: str, low: float = -1e6, high: float = 1e6) -> float:
        """Return a number from `low` to `high`."""
        if isinstance(value, str) and _EXPONENT.fullmatch(value):
            value = float(value)  # YAML 1.1 reads 1e3 as text
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
            self.fail(where, f"{shown(value)} is not a number between {low:g} and {high:g}")
        return float(value)

    def numbers(self, value: Any, where: str, count: int, meaning: str) -> NDArray[np.float64]:
        """Return a list of `count` numbers, (count,)."""
        if not isinstance(value, list) or len(value) != count:
            self.fail(where, f"{shown(value)} is not {meaning}")
        return np.array([self.number(v, where) for v in value])

    def points(self, value: Any, where: str, least: int) -> NDArray[np.float64]:
        """Return at least so many points, (N, 2)."""
        if not isinstance(value, list) or len(value) < least:
            self.fail(where, f"is not a list of at least {least} points [x, y]")
        return np.array([self.numbers(p, f"{where}[{i}]", 2, "a point [x, y]") for i, p in enumerate(value)])

    def repeats(self, entry: Mapping[str, Any], where: str) -> NDArray[np.float64]:
        """Return the offsets (N, 2) of the copies that `repeat` and `step` of an entry ask for."""
        if "repeat" not in entry:
            return np.zeros((1, 2))
        if "step" not in entry:
            self.fail(where, "`repeat` needs `step: [dx, dy]`")
        counts = self.numbers(entry["repeat"], f"{where}.repeat", 2, "[along x, along y]")
        if min(counts) < 1 or counts.prod() > MAX_ENTRIES or (counts % 1).any():
            self.fail(f"{where}.repeat", f"{counts.tolist()} is not two whole numbers from 1 on")
        step = self.numbers(entry["step"], f"{where}.step", 2, "[dx, dy]")
        rows, columns = np.meshgrid(np.arange(counts[1]), np.arange(counts[0]), indexing="ij")
        return np.column_stack([columns.ravel() * step[0], rows.ravel() * step[1]])


def _kind(value: Any) -> str:
    return "empty" if value is None else "a list" if isinstance(value, list) else shown(value)


def is_huge(value: Any) -> bool:
    """Whether a value is a whole number of hundreds of digits, which cannot even be printed."""
    return isinstance(value, int) and abs(value) > 1 << 64


def shown(value: Any) -> str:
    """Return a short text for a value of any size or depth."""
    return "a number of hundreds of digits" if is_huge(value) else _BRIEFLY.repr(value)


class _Brief(reprlib.Repr):
    def repr_int(self, x: int, level: int) -> str:  # noqa: ARG002 - the interface of Repr
        return "..." if is_huge(x) else repr(x)


_BRIEFLY = _Brief()
_BRIEFLY.maxlist, _BRIEFLY.maxdict, _BRIEFLY.maxlevel, _BRIEFLY.maxstring, _BRIEFLY.maxother = 5, 4, 3, 60, 60
