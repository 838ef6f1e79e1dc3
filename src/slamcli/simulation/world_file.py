# SPDX-License-Identifier: MIT
"""World files: a small YAML that declares walls, what stands between them, and what the robot does there.

docs/generate.md lists all keys. Every message names the file and the entry.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from slamcli.errors import ConfigError
from slamcli.grids import OccupancyGrid
from slamcli.parameters import declarations
from slamcli.simulation import shapes
from slamcli.simulation.file_values import MAX_ENTRIES, FileValues, is_huge, shown
from slamcli.simulation.parameters import SimulationParameters, resolve_settings
from slamcli.simulation.relief_file import Doorway, Plan, ReliefReader, Thing
from slamcli.simulation.world import CarriedPath, Cart, Walker, World

ReadGrid = Callable[[Path], OccupancyGrid]

_MAX_BYTES = 4_000_000
_OVERHEAD_M = 1.5  # what begins higher above the ground is in nobody's way
_SECTIONS = tuple(dict.fromkeys(d.name.split(".")[0] for d in declarations(SimulationParameters)))
_KEYS = (
    "name", "description", "walls", "rooms", "doors", "boxes", "circles", "grid", "relief", "start", "route", "path", "walkers", "obstacles",
)  # fmt: skip
_IN_SPACE = ("height", "above", "reflectivity")


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


class _Reader(FileValues):
    """Turns the document of one file into a World."""

    def __init__(self, path: Path, read_grid: ReadGrid | None) -> None:
        super().__init__(path)
        self.read_grid = read_grid

    def world(self, document: Any) -> World:
        self.mapping(document, "the file", (*_KEYS, *_SECTIONS))
        plan = self.plan(document)
        segments, circles = plan.obstacles(_OVERHEAD_M)
        if len(segments) + len(circles) > MAX_ENTRIES:
            self.fail(
                "", f"{len(segments) + len(circles)} walls are more than the {MAX_ENTRIES} that one world can hold"
            )
        grid = self.grid(document.get("grid"))
        if not len(segments) and not len(circles) and grid is None and "relief" not in document:
            self.fail("", "there is nothing in this world: give walls, rooms, boxes, circles, grid or relief")
        route = self.mapping(document.get("route", {}), "route", ("waypoints", "rounds"))
        world = World(
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
            path=self.path_in_space(document) if "path" in document else None,
            walkers=tuple(self.walker(w, f"walkers[{i}]") for i, w in enumerate(self.items(document, "walkers"))),
            carts=tuple(self.cart(o, f"obstacles[{i}]") for i, o in enumerate(self.items(document, "obstacles"))),
            settings=self.settings(document),
        )
        if "relief" not in document:
            return world
        return dataclasses.replace(world, relief=ReliefReader(self.path).relief(document["relief"], plan, world))

    def path_in_space(self, document: Mapping[str, Any]) -> CarriedPath:
        for key in [k for k in ("start", "route") if k in document]:
            self.fail(key, "is for robots that drive; a world with `path` has none")
        path = self.mapping(document["path"], "path", ("poses", "closed", "rounds"), ("poses",))
        rows = []
        for i, row in enumerate(self.items(path, "poses")):
            size = len(row) if isinstance(row, list) and len(row) in (4, 5, 6) else 4
            x, y, z, yaw, *rest = self.numbers(
                row, f"path.poses[{i}]", size, "[x, y, z, yaw] and perhaps pitch and roll"
            )
            pitch, roll = [*rest, 0.0, 0.0][:2]
            rows.append([x, y, z, *np.radians([roll, pitch, yaw])])
        if len(rows) < 3:
            self.fail("path.poses", f"{len(rows)} poses are too few: give at least 3")
        closed = path.get("closed", False)
        if not isinstance(closed, bool):
            self.fail("path.closed", f"{shown(closed)} is neither true nor false")
        return CarriedPath(np.array(rows), closed, self.number(path.get("rounds", 1), "path.rounds", 0.01, 1000))

    def plan(self, document: Mapping[str, Any]) -> Plan:
        walls: list[NDArray[np.float64]] = []
        for i, wall in enumerate(self.items(document, "walls")):
            walls.append(shapes.polyline(self.points(wall, f"walls[{i}]", 2)))
        for i, room in enumerate(self.items(document, "rooms")):
            walls.append(shapes.rectangle(self.numbers(room, f"rooms[{i}]", 4, "[x0, y0, x1, y1]")))
        segments = shapes.stack(walls, 4)
        known = ("at", "width", "open", "height") if "relief" in document else ("at", "width", "open")
        doors = []
        for i, value in enumerate(self.items(document, "doors")):
            segments, door = self.door(segments, value, f"doors[{i}]", known)
            doors.append(door)
        in_space = _IN_SPACE if "relief" in document else ()
        things: list[Thing] = []
        for i, value in enumerate(self.items(document, "boxes")):
            things.extend(self.boxes(value, f"boxes[{i}]", in_space))
        for i, value in enumerate(self.items(document, "circles")):
            things.extend(self.circles(value, f"circles[{i}]", in_space))
        return Plan(segments, tuple(doors), tuple(things))

    def door(
        self, segments: NDArray[np.float64], value: Any, where: str, known: tuple[str, ...]
    ) -> tuple[NDArray[np.float64], Doorway]:
        door = self.mapping(value, where, known, ("at",))
        at = self.numbers(door["at"], f"{where}.at", 2, "[x, y]")
        width = self.number(door.get("width", 0.9), f"{where}.width", 0.05, 1000)
        opened, cuts = shapes.cut_door(segments, at, width)
        if not cuts:
            self.fail(
                where, f"no wall of `walls` or `rooms` passes through {at[0]:g}, {at[1]:g} on a width of {width:g} m"
            )
        leaf = np.zeros((0, 4))
        if "open" in door:
            leaf = shapes.door_leaf(cuts[0], math.radians(self.number(door["open"], f"{where}.open", -180, 180)))
        height = self.number(door.get("height", 2.0), f"{where}.height", 0.1, 1000)
        return opened, Doorway(np.array(cuts), leaf, height)

    def boxes(self, value: Any, where: str, in_space: tuple[str, ...]) -> list[Thing]:
        box = self.mapping(value, where, ("at", "size", "yaw", "repeat", "step", *in_space), ("at", "size"))
        at = self.numbers(box["at"], f"{where}.at", 2, "[x, y] of the centre")
        size = self.numbers(box["size"], f"{where}.size", 2, "[length, width]")
        if min(size) <= 0:
            self.fail(f"{where}.size", f"{size.tolist()} is not two lengths above 0")
        yaw = math.radians(self.number(box.get("yaw", 0), f"{where}.yaw"))
        return [Thing(at + offset, size, yaw, **self.in_space(box, where)) for offset in self.repeats(box, where)]

    def circles(self, value: Any, where: str, in_space: tuple[str, ...]) -> list[Thing]:
        circle = self.mapping(value, where, ("at", "radius", "repeat", "step", *in_space), ("at", "radius"))
        at = self.numbers(circle["at"], f"{where}.at", 2, "[x, y] of the centre")
        radius = self.number(circle["radius"], f"{where}.radius", 0.001, 1e4)
        return [
            Thing(at + offset, radius, 0.0, **self.in_space(circle, where)) for offset in self.repeats(circle, where)
        ]

    def in_space(self, entry: Mapping[str, Any], where: str) -> dict[str, float | None]:
        limits = {"height": (0.001, 1000.0), "above": (0.0, 1000.0), "reflectivity": (0.0, 1.0)}
        height, above, reflectivity = (
            self.number(entry[key], f"{where}.{key}", *limits[key]) if key in entry else None for key in _IN_SPACE
        )
        if height is not None and above is not None and above >= height:
            self.fail(where, f"`above` {above:g} m is not below `height` {height:g} m")
        return {"height_m": height, "above_m": above, "reflectivity": reflectivity}

    def grid(self, value: Any) -> OccupancyGrid | None:
        if value is None:
            return None
        if not isinstance(value, str):
            self.fail("grid", f"{shown(value)} is not the name of a map.yaml")
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

    def cart(self, value: Any, where: str) -> Cart:
        known = ("at", "points", "size", "radius", "yaw", "speed", "appears", "leaves")
        cart = self.mapping(value, where, known)
        if ("at" in cart) == ("points" in cart) or ("size" in cart) == ("radius" in cart):
            self.fail(where, "give `at` (it stands) or `points` (it moves), and `size` or `radius`")
        if "at" in cart:
            points = self.numbers(cart["at"], f"{where}.at", 2, "[x, y] of the centre")[None]
        else:
            points = self.points(cart["points"], f"{where}.points", 2)
        radius = self.number(cart["radius"], f"{where}.radius", 0.001, 1000) if "radius" in cart else 0.0
        size = (0.0, 0.0)
        if "size" in cart:
            length, width = self.numbers(cart["size"], f"{where}.size", 2, "[length, width]").tolist()
            size = (length, width)
            if min(size) <= 0:
                self.fail(f"{where}.size", f"{list(size)} is not two lengths above 0")
        appears = self.number(cart.get("appears", 0), f"{where}.appears", 0, 1e6)
        leaves = self.number(cart["leaves"], f"{where}.leaves", 0, 1e9) if "leaves" in cart else math.inf
        if leaves <= appears:
            self.fail(where, f"it leaves at {leaves:g} s, not after it appears at {appears:g} s")
        yaw = math.radians(self.number(cart.get("yaw", 0), f"{where}.yaw"))
        speed = self.number(cart.get("speed", 0.5), f"{where}.speed", 0.01, 10)
        return Cart(points, size, radius, yaw, speed, appears, leaves)

    def settings(self, document: Mapping[str, Any]) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for section in _SECTIONS:
            for key, value in self.mapping(document.get(section, {}), section, None).items():
                if not isinstance(value, (bool, int, float, str)) or is_huge(value):
                    self.fail(f"{section}.{key}", f"{shown(value)} is not one value")
                values[f"{section}.{key}"] = value
        resolve_settings(values, source=str(self.path))
        return values
