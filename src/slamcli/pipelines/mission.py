# SPDX-License-Identifier: MIT
"""Missions: which places a robot is to go to, in which order, and how long it stays."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from slamcli.errors import ConfigError, UsageError
from slamcli.simulation.file_values import FileValues, shown

_MOST_BYTES = 1 << 22
_MOST_GOALS = 10_000
_LONGEST_S = 86_400.0
_KEYS = ("start", "waypoints", "repeat", "timeout")


@dataclass(frozen=True, slots=True, kw_only=True)
class Waypoint:
    """A place to go to."""

    name: str
    x: float
    """Metres in map, as y."""
    y: float
    yaw: float | None = None
    """Radians; None: as the way there ends."""
    wait_s: float = 0.0
    """How long the robot stays, simulated seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mission:
    """Waypoints in their order, all rounds of them, and where the robot begins."""

    waypoints: tuple[Waypoint, ...]
    start: tuple[float, ...] | None = None
    """x, y and perhaps yaw; None: not said."""
    timeout_s: float | None = None
    """For each way, simulated seconds; None: not said."""


def waypoints_of(goals: Sequence[Sequence[float]]) -> tuple[Waypoint, ...]:
    """Return waypoints from points x, y or x, y, yaw; they are named by their numbers.

    Raises
    ------
    UsageError
        If a point has another number of values, or one that is not finite.
    """
    return tuple(_waypoint(goal, str(i)) for i, goal in enumerate(goals, start=1))


def read_mission(path: str | os.PathLike[str]) -> Mission:
    """Read a mission file.

    ::

        start: [2.0, 8.75, 0.0]     # x, y, yaw (metres, radians); --start wins
        repeat: 2                   # rounds
        timeout: 120                # seconds for each way
        waypoints:
          - [6.5, 8.0]              # x, y or x, y, yaw
          - {name: kitchen, pose: [24.0, 8.0, 1.57], wait: 5}

    Raises
    ------
    ConfigError
        If the file cannot be read, or an entry is wrong; the message names it.
    """
    path = Path(path)
    values = FileValues(path)
    document = values.mapping(_document(path), "", _KEYS, ("waypoints",))
    rounds = values.number(document.get("repeat", 1), "repeat", 1, _MOST_GOALS)
    if rounds % 1:
        values.fail("repeat", f"{rounds:g} is not a whole number")
    listed = [_entry(values, entry, i) for i, entry in enumerate(values.items(document, "waypoints"))]
    if not listed:
        values.fail("waypoints", "there is none: write - [x, y] or - {name: kitchen, pose: [x, y, yaw], wait: 5}")
    if len(listed) * rounds > _MOST_GOALS:
        values.fail("repeat", f"{len(listed) * int(rounds)} goals are more than {_MOST_GOALS}")
    start = None if document.get("start") is None else _pose(values, document["start"], "start")
    timeout = document.get("timeout")
    return Mission(
        waypoints=tuple(listed * int(rounds)),
        start=start,
        timeout_s=None if timeout is None else values.number(timeout, "timeout", 0.1, _LONGEST_S),
    )


def _document(path: Path) -> Any:
    if not path.is_file():
        raise ConfigError(f"{path}: no such mission file")
    if path.stat().st_size > _MOST_BYTES:
        raise ConfigError(f"{path}: too large for a mission file")
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: cannot be read as YAML: {error or type(error).__name__}") from error
    except yaml.YAMLError as error:
        raise ConfigError(f"{path}: cannot be read as YAML: {' '.join(str(error).split())[:200]}") from error


def _entry(values: FileValues, entry: Any, index: int) -> Waypoint:
    where, name = f"waypoints[{index}]", str(index + 1)
    if isinstance(entry, list):
        return _waypoint(_pose(values, entry, where), name)
    table = values.mapping(entry, where, ("name", "pose", "wait"), ("pose",))
    return _waypoint(
        _pose(values, table["pose"], f"{where}.pose"),
        values.text(table.get("name", name), f"{where}.name"),
        values.number(table.get("wait", 0.0), f"{where}.wait", 0.0, _LONGEST_S),
    )


def _pose(values: FileValues, value: Any, where: str) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) not in (2, 3):
        values.fail(where, f"{shown(value)} is not [x, y] or [x, y, yaw] (metres, radians)")
    return tuple(values.number(v, where) for v in value)


def _waypoint(point: Sequence[float], name: str, wait_s: float = 0.0) -> Waypoint:
    numbers = [float(v) for v in point]
    if len(numbers) not in (2, 3) or not all(math.isfinite(v) and abs(v) < 1e6 for v in numbers):
        raise UsageError(f"goal {','.join(f'{v:g}' for v in numbers)}: write it as X,Y or X,Y,YAW (metres, radians)")
    yaw = numbers[2] if len(numbers) == 3 else None
    return Waypoint(name=name, x=numbers[0], y=numbers[1], yaw=yaw, wait_s=wait_s)
