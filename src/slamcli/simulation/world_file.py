# SPDX-License-Identifier: MIT
"""World files: a small YAML that declares walls, what stands between them, and what the robot does there.

docs/generate.md lists all keys. Every message names the file and the entry.
"""

from __future__ import annotations

import math
import re
import reprlib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import yaml
from numpy.typing import NDArray

from slamcli.errors import ConfigError
from slamcli.grids import OccupancyGrid
from slamcli.parameters import declarations, unknown_name
from slamcli.simulation import shapes
from slamcli.simulation.parameters import SimulationParameters, resolve_settings
from slamcli.simulation.world import Walker, World

ReadGrid = Callable[[Path], OccupancyGrid]

_EXPONENT = re.compile(r"[-+]?\d{1,9}[eE][-+]?\d{1,3}")
_MAX_BYTES = 4_000_000
_MAX_SHAPES = 200_000
_SECTIONS = tuple(dict.fromkeys(d.name.split(".")[0] for d in declarations(SimulationParameters)))
_KEYS = ("name", "description", "walls", "rooms", "doors", "boxes", "circles", "grid", "start", "route", "walkers")


def is_world_file(path: Path) -> bool:
    """Whether a YAML file is a world (and not a map.yaml, which names an image)."""
    return not (isinstance(document := _load(path), Mapping) and "image" in document)


def load_world(path: Path, read_grid: ReadGrid | None = None) -> World:
    """Read a world file.

    Parameters
    ----------
    path
        The YAML file.
    read_grid
        Reads the map.yaml that the key ``grid`` names (``slamcli.formats.maps`` does it).

    Raises
    ------
    ConfigError
        If the file is missing or no YAML, a key is unknown (the message names the nearest one), or a value is not
        what its key needs.
    """
    return _Reader(path, read_grid).world(_load(path))


def _load(path: Path) -> Any:
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise ConfigError(f"{path}: {path.stat().st_size} bytes is no world file (limit {_MAX_BYTES})")
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"cannot read world {path}: {error.strerror or error}") from error
    except (UnicodeDecodeError, RecursionError, ValueError) as error:
        raise ConfigError(f"{path} is not a YAML text file") from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark else ""
        raise ConfigError(f"{path}{where}: no valid YAML: {getattr(error, 'problem', error)}") from error


class _Reader:
    """Turns the document of one file into a World; knows the file's name for its messages."""

    def __init__(self, path: Path, read_grid: ReadGrid | None) -> None:
        self.path, self.read_grid = path, read_grid

    def world(self, document: Any) -> World:
        self.mapping(document, "the file", (*_KEYS, *_SECTIONS))
        segments, circles = self.shapes(document)
        grid = self.grid(document.get("grid"))
        if not len(segments) and not len(circles) and grid is None:
            self.fail("", "there is nothing in this world: give walls, rooms, boxes, circles or grid")
        route = self.mapping(document.get("route", {}), "route", ("waypoints", "rounds"))
        return World(
            name=self.text(document.get("name", self.path.stem), "name"),
            description=self.text(document.get("description", ""), "description").strip(),
            segments=segments,
            circles=circles,
            grid=grid,
            start=self.start(document.get("start")),
            waypoints=self.points(route["waypoints"], "route.waypoints", 2)
            if "waypoints" in route
            else np.zeros((0, 2)),
            rounds=int(self.number(route.get("rounds", 1), "route.rounds", 1, 1000)),
            walkers=tuple(self.walker(w, f"walkers[{i}]") for i, w in enumerate(self.items(document, "walkers"))),
            settings=self.settings(document),
        )

    def shapes(self, document: Mapping[str, Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        walls: list[NDArray[np.float64]] = []
        for i, wall in enumerate(self.items(document, "walls")):
            walls.append(shapes.polyline(self.points(wall, f"walls[{i}]", 2)))
        for i, room in enumerate(self.items(document, "rooms")):
            walls.append(shapes.rectangle(self.numbers(room, f"rooms[{i}]", 4, "[x0, y0, x1, y1]")))
        segments = shapes.stack(walls, 4)
        for i, door in enumerate(self.items(document, "doors")):
            segments = self.door(segments, door, f"doors[{i}]")
        boxes = [self.box(b, f"boxes[{i}]") for i, b in enumerate(self.items(document, "boxes"))]
        circles = [self.circle(c, f"circles[{i}]") for i, c in enumerate(self.items(document, "circles"))]
        segments, round_ones = shapes.stack([segments, *boxes], 4), shapes.stack(circles, 3)
        if len(segments) + len(round_ones) > _MAX_SHAPES:
            self.fail(
                "", f"{len(segments) + len(round_ones)} walls are more than the {_MAX_SHAPES} that one world can hold"
            )
        return segments, round_ones

    def door(self, segments: NDArray[np.float64], value: Any, where: str) -> NDArray[np.float64]:
        door = self.mapping(value, where, ("at", "width", "open"), ("at",))
        at = self.numbers(door["at"], f"{where}.at", 2, "[x, y]")
        width = self.number(door.get("width", 0.9), f"{where}.width", 0.05, 1000)
        opened, cuts = shapes.cut_door(segments, at, width)
        if not cuts:
            self.fail(
                where, f"no wall of `walls` or `rooms` passes through {at[0]:g}, {at[1]:g} on a width of {width:g} m"
            )
        if "open" in door:
            leaf = shapes.door_leaf(cuts[0], math.radians(self.number(door["open"], f"{where}.open", -180, 180)))
            opened = np.concatenate([opened, leaf])
        return opened

    def box(self, value: Any, where: str) -> NDArray[np.float64]:
        box = self.mapping(value, where, ("at", "size", "yaw", "repeat", "step"), ("at", "size"))
        at = self.numbers(box["at"], f"{where}.at", 2, "[x, y] of the centre")
        size = self.numbers(box["size"], f"{where}.size", 2, "[length, width]")
        if min(size) <= 0:
            self.fail(f"{where}.size", f"{size.tolist()} is not two lengths above 0")
        one = shapes.box(at, size, math.radians(self.number(box.get("yaw", 0), f"{where}.yaw")))
        return shapes.stack([one + np.tile(offset, 2) for offset in self.repeats(box, where)], 4)

    def circle(self, value: Any, where: str) -> NDArray[np.float64]:
        circle = self.mapping(value, where, ("at", "radius", "repeat", "step"), ("at", "radius"))
        at = self.numbers(circle["at"], f"{where}.at", 2, "[x, y] of the centre")
        radius = self.number(circle["radius"], f"{where}.radius", 0.001, 1e4)
        one = np.array([[at[0], at[1], radius]])
        return shapes.stack([one + np.append(offset, 0.0) for offset in self.repeats(circle, where)], 3)

    def repeats(self, entry: Mapping[str, Any], where: str) -> NDArray[np.float64]:
        if "repeat" not in entry:
            return np.zeros((1, 2))
        if "step" not in entry:
            self.fail(where, "`repeat` needs `step: [dx, dy]`")
        counts = self.numbers(entry["repeat"], f"{where}.repeat", 2, "[along x, along y]")
        if min(counts) < 1 or counts.prod() > _MAX_SHAPES or (counts % 1).any():
            self.fail(f"{where}.repeat", f"{counts.tolist()} is not two whole numbers from 1 on")
        step = self.numbers(entry["step"], f"{where}.step", 2, "[dx, dy]")
        rows, columns = np.meshgrid(np.arange(counts[1]), np.arange(counts[0]), indexing="ij")
        return np.column_stack([columns.ravel() * step[0], rows.ravel() * step[1]])

    def grid(self, value: Any) -> OccupancyGrid | None:
        if value is None:
            return None
        if not isinstance(value, str):
            self.fail("grid", f"{_shown(value)} is not the name of a map.yaml")
        if self.read_grid is None:
            raise ConfigError(f"{self.path}: grid: maps cannot be read here")
        return self.read_grid(self.path.parent / value)

    def start(self, value: Any) -> tuple[float, float, float] | None:
        if value is None:
            return None
        x, y, yaw = self.numbers(value, "start", 3, "[x, y, yaw in degrees]").tolist()
        return x, y, math.radians(yaw)

    def walker(self, value: Any, where: str) -> Walker:
        walker = self.mapping(value, where, ("points", "speed"), ("points",))
        speed = self.number(walker.get("speed", 0.9), f"{where}.speed", 0.05, 10)
        return Walker(self.points(walker["points"], f"{where}.points", 2), speed)

    def settings(self, document: Mapping[str, Any]) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for section in _SECTIONS:
            for key, value in self.mapping(document.get(section, {}), section, None).items():
                if not isinstance(value, (bool, int, float, str)) or _is_huge(value):
                    self.fail(f"{section}.{key}", f"{_shown(value)} is not one value")
                values[f"{section}.{key}"] = value
        resolve_settings(values, source=str(self.path))
        return values

    # Values of one kind, or an error that says which entry is wrong.

    def fail(self, where: str, message: str) -> NoReturn:
        raise ConfigError(f"{self.path}: {where}: {message}" if where else f"{self.path}: {message}")

    def mapping(
        self, value: Any, where: str, known: Iterable[str] | None, needed: Iterable[str] = ()
    ) -> Mapping[str, Any]:
        names = tuple(known) if known is not None else ()
        if not isinstance(value, Mapping):
            self.fail(
                where, f"is {_kind(value)}, not a table of keys" + (f" ({', '.join(names[:6])} ...)" if names else "")
            )
        for key in value:
            if not isinstance(key, str):
                self.fail(where, f"the key {_shown(key)} is not text")
            if known is not None and key not in names:
                message = unknown_name(key, names).replace("parameter", "key").split("; `slamcli")[0]
                self.fail(where, message if "did you mean" in message else f"{message}; known are {', '.join(names)}")
        for key in needed:
            if key not in value:
                self.fail(where, f"`{key}` is missing")
        return dict(value)

    def items(self, document: Mapping[str, Any], key: str) -> list[Any]:
        value = document.get(key) or []
        if not isinstance(value, list):
            self.fail(key, f"is {_kind(value)}, not a list")
        if len(value) > _MAX_SHAPES:
            self.fail(key, f"{len(value)} entries are more than {_MAX_SHAPES}")
        return value

    def text(self, value: Any, where: str) -> str:
        if not isinstance(value, (str, int, float)) or _is_huge(value):
            self.fail(where, f"{_shown(value)} is not text")
        return str(value)

    def number(self, value: Any, where: str, low: float = -1e6, high: float = 1e6) -> float:
        if isinstance(value, str) and _EXPONENT.fullmatch(value):
            value = float(value)  # YAML 1.1 reads 1e3 as text
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
            self.fail(where, f"{_shown(value)} is not a number between {low:g} and {high:g}")
        return float(value)

    def numbers(self, value: Any, where: str, count: int, meaning: str) -> NDArray[np.float64]:
        if not isinstance(value, list) or len(value) != count:
            self.fail(where, f"{_shown(value)} is not {meaning}")
        return np.array([self.number(v, where) for v in value])

    def points(self, value: Any, where: str, least: int) -> NDArray[np.float64]:
        if not isinstance(value, list) or len(value) < least:
            self.fail(where, f"is not a list of at least {least} points [x, y]")
        return np.array([self.numbers(p, f"{where}[{i}]", 2, "a point [x, y]") for i, p in enumerate(value)])


def _kind(value: Any) -> str:
    return "empty" if value is None else "a list" if isinstance(value, list) else _shown(value)


def _is_huge(value: Any) -> bool:
    """Whether a value is a whole number of hundreds of digits, which cannot even be printed."""
    return isinstance(value, int) and abs(value) > 1 << 64


def _shown(value: Any) -> str:
    """Return a short text for a value of any size or depth."""
    return "a number of hundreds of digits" if _is_huge(value) else _BRIEFLY.repr(value)


class _Brief(reprlib.Repr):
    def repr_int(self, x: int, level: int) -> str:  # noqa: ARG002 - the interface of Repr
        return "..." if _is_huge(x) else repr(x)


_BRIEFLY = _Brief()
_BRIEFLY.maxlist, _BRIEFLY.maxdict, _BRIEFLY.maxlevel, _BRIEFLY.maxstring, _BRIEFLY.maxother = 5, 4, 3, 60, 60
