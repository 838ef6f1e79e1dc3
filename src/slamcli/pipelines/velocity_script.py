# SPDX-License-Identifier: MIT
"""Files of velocities: what a robot is told when nobody sits at the keyboard."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
import yaml
from numpy.typing import NDArray

from slamcli.errors import ConfigError

Names = tuple[str, ...]

_COLUMNS: tuple[Names, ...] = (
    ("time", "vx", "vy", "wz"), ("time", "vx", "wz"), ("duration", "vx", "vy", "wz"), ("duration", "vx", "wz"),
)  # fmt: skip
_SHORTEST_S = 0.01
_LONGEST_S = 1e6
_FASTEST = 1e3
_MOST_BYTES = 50_000_000
_HOW = "write time,vx,vy,wz (seconds, m/s, rad/s) or duration,vx,wz"


@dataclass(frozen=True, slots=True, eq=False)
class VelocityScript:
    """Velocities in the order of time; each holds until the next, the last until the end."""

    times_s: NDArray[np.float64]
    """float64 (N,), seconds from the start, from 0 up, never falling."""
    twists: NDArray[np.float64]
    """float64 (N, 3): forward and leftward m/s, and rad/s."""
    end_s: float
    """Where the script ends."""


@dataclass(frozen=True, slots=True)
class _Entry:
    """One velocity with the line that it stands on."""

    line: int
    names: Names
    values: tuple[float, ...]


def read_velocities(path: str | os.PathLike[str]) -> VelocityScript:
    """Read a file of velocities.

    Text: a row ``time vx vy wz`` says from when on a velocity holds; the last row ends the drive. A row ``duration vx wz``
    says for how long. Values are parted by commas, semicolons or blanks; a header may name the columns (then also
    ``time vx wz`` and ``duration vx vy wz``); ``#`` begins a comment. YAML (``.yaml``, ``.yml``): a list of such rows, or of
    mappings with those names.

    Raises
    ------
    ConfigError
        If the file cannot be read, or an entry is wrong; the message has the line.
    """
    path = Path(path)
    text = _text(path)
    entries = _yaml_entries(path, text) if path.suffix.lower() in (".yaml", ".yml") else _table_entries(path, text)
    if not entries:
        raise ConfigError(f"{path}: holds no velocity: {_HOW}")
    by_time = entries[0].names[0] == "time"
    times: list[float] = []
    end = 0.0
    for entry in entries:
        first = entry.values[0]
        if (entry.names[0] == "time") != by_time:
            _fail(path, entry.line, "times and durations in one file: choose one")
        if by_time:
            if first < end:
                _fail(path, entry.line, f"time {first:g} s is before that of the row above, {end:g} s")
            end = first
            times.append(end)
        else:
            if first < _SHORTEST_S:
                _fail(path, entry.line, f"duration {first:g} s: give at least {_SHORTEST_S:g} s")
            times.append(end)
            end += first
        if end > _LONGEST_S:
            _fail(path, entry.line, f"the drive is longer than {_LONGEST_S:g} s")
    twists = np.array([_twist(entry) for entry in entries])
    return VelocityScript(np.array(times), twists, end)


def _text(path: Path) -> str:
    if not path.is_file():
        raise ConfigError(f"{path}: no such file of velocities")
    if path.stat().st_size > _MOST_BYTES:
        raise ConfigError(f"{path}: too large for a file of velocities")
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read as text: {error}") from error


def _twist(entry: _Entry) -> tuple[float, float, float]:
    told = dict(zip(entry.names, entry.values, strict=True))
    return told["vx"], told.get("vy", 0.0), told["wz"]


def _table_entries(path: Path, text: str) -> list[_Entry]:
    entries: list[_Entry] = []
    header: Names | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        words = [word for word in re.split(r"\s*[,;]\s*|\s+", line.partition("#")[0].strip()) if word]
        if not words:
            continue
        if (
            header is None
            and not entries
            and re.fullmatch(r"[a-z_]+", words[0], re.IGNORECASE)
            and not _is_number(words[0])
        ):
            header = _header(path, number, words)
            continue
        entries.append(_entry(path, number, words, header))
    return entries


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _header(path: Path, line: int, words: Sequence[str]) -> Names:
    names = tuple(word.lower() for word in words)
    if names not in _COLUMNS:
        known = "; ".join(",".join(columns) for columns in _COLUMNS)
        _fail(path, line, f"{','.join(words)[:80]} are not the columns of velocities: {known}")
    return names


def _entry(path: Path, line: int, words: Sequence[str], names: Names | None) -> _Entry:
    if names is None:
        if len(words) not in (3, 4):
            _fail(path, line, f"{len(words)} value{'s' if len(words) != 1 else ''}: {_HOW}")
        names = _COLUMNS[0] if len(words) == 4 else _COLUMNS[3]
    if len(words) != len(names):
        _fail(path, line, f"{len(words)} value{'s' if len(words) != 1 else ''} for the columns {','.join(names)}")
    return _Entry(line, names, tuple(_number(path, line, *pair) for pair in zip(names, words, strict=True)))


def _number(path: Path, line: int, name: str, word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        _fail(path, line, f"{name} {word[:40]!r} is not a number")
    if not math.isfinite(value):
        _fail(path, line, f"{name} {word[:40]} is not finite")
    if name in ("time", "duration"):
        if value < 0.0:
            _fail(path, line, f"{name} {value:g} s is negative")
    elif abs(value) > _FASTEST:
        _fail(path, line, f"{name} {value:g} is no velocity of a robot")
    return value


def _yaml_entries(path: Path, text: str) -> list[_Entry]:
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        _fail(path, 1 if mark is None else mark.line + 1, f"cannot be read as YAML: {error.problem}")
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        said = " ".join(str(error).split())[:200] or type(error).__name__
        raise ConfigError(f"{path}: cannot be read as YAML: {said}") from error
    if root is None:
        return []
    if not isinstance(root, yaml.SequenceNode):
        _fail(
            path, root.start_mark.line + 1, "not a list: write - [duration, vx, wz] or - {duration: 2, vx: 0.3, wz: 0}"
        )
    return [_yaml_entry(path, node) for node in root.value]


def _yaml_entry(path: Path, node: yaml.Node) -> _Entry:
    line = node.start_mark.line + 1
    if isinstance(node, yaml.SequenceNode):
        return _entry(path, line, [_scalar(path, item) for item in node.value], None)
    if not isinstance(node, yaml.MappingNode):
        _fail(path, line, "neither a list nor a mapping: write [duration, vx, wz] or {duration: 2, vx: 0.3, wz: 0}")
    told = {_scalar(path, key): _scalar(path, value) for key, value in node.value}
    for name in told:
        if name not in _COLUMNS[0] and name != "duration":
            _fail(path, line, f"unknown key {name[:40]!r}: time or duration, vx, vy, wz")
    if len(told) != len(node.value) or ("time" in told) == ("duration" in told):
        _fail(path, line, "give each key once, and either time or duration")
    names = _COLUMNS[0] if "time" in told else _COLUMNS[2]
    return _entry(path, line, [told.get(name, "0") for name in names], names)


def _scalar(path: Path, node: yaml.Node) -> str:
    if not isinstance(node, yaml.ScalarNode):
        _fail(path, node.start_mark.line + 1, "a list or mapping where a number belongs")
    return str(node.value)


def _fail(path: Path, line: int, message: str) -> NoReturn:
    raise ConfigError(f"{path}:{line}: {message}")
