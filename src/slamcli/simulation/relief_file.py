# SPDX-License-Identifier: MIT
"""The heights of a world file: its key ``relief``, and the heights of what stands on the plan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.simulation import relief, shapes
from slamcli.simulation.file_values import FileValues
from slamcli.simulation.relief import Relief, Terrain
from slamcli.simulation.world import World

Array = NDArray[np.float64]

_KEYS = ("wall_height", "ceiling", "area", "margin", "cell", "ramps", "bumps", "hills")
_MAX_NODES = 16_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Doorway:
    """What a door made of the walls."""

    cuts: Array
    """float64 (N, 4): what was cut out of walls; there is wall above it."""
    leaf: Array
    """float64 (0 or 1, 4), the open leaf."""
    height_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Thing:
    """A box or a pillar, metres and radians in the map."""

    at: Array
    size: Array | float
    """Length and width of a box (2,), or the radius of a pillar."""
    yaw_rad: float
    height_m: float | None
    """From the ground to its top; None: as high as walls."""
    above_m: float | None
    """From the ground to its underside; None: it stands on the ground."""
    reflectivity: float | None

    @property
    def outline(self) -> tuple[Array, Array]:
        """Segments (N, 4) and circles (M, 3) on the plan."""
        if isinstance(self.size, float):
            return np.zeros((0, 4)), np.array([[*self.at, self.size]])
        return shapes.box(self.at, self.size, self.yaw_rad), np.zeros((0, 3))


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Everything that a world file puts on the plan."""

    walls: Array
    """float64 (S, 4), doors cut out."""
    doors: tuple[Doorway, ...]
    things: tuple[Thing, ...]

    def obstacles(self, overhead_m: float) -> tuple[Array, Array]:
        """Return segments (S, 4) and circles (C, 3) of all that begins less than `overhead_m` above the ground."""
        low = [thing.outline for thing in self.things if thing.above_m is None or thing.above_m < overhead_m]
        segments = [self.walls, *(door.leaf for door in self.doors), *(lines for lines, _ in low)]
        return shapes.stack(segments, 4), shapes.stack([circles for _, circles in low], 3)


class ReliefReader(FileValues):
    """Turns the key ``relief`` of one file into a Relief."""

    def relief(self, value: Any, plan: Plan, world: World) -> Relief:
        """Return the heights of `world`, whose shapes are `plan`.

        Raises
        ------
        ConfigError
            If a key is unknown or a value is not what its key needs.
        """
        table = self.mapping(value, "relief", _KEYS)
        terrain = self.level(table, world)
        for i, ramp in enumerate(self.items(table, "ramps")):
            terrain = self.ramp(terrain, ramp, f"relief.ramps[{i}]")
        ceiling = None
        if table.get("ceiling") is not None:
            height = self.number(table["ceiling"], "relief.ceiling", 0.1, 1000)
            ceiling = Terrain(terrain.heights + height, terrain.cell_m, terrain.x0, terrain.y0)
        for i, bump in enumerate(self.items(table, "bumps")):
            terrain = self.bump(terrain, bump, f"relief.bumps[{i}]")
        for i, hills in enumerate(self.items(table, "hills")):
            terrain = self.hills(terrain, hills, f"relief.hills[{i}]")
        default = table.get("ceiling") or relief.WALL_HEIGHT_M
        wall_height = self.number(table.get("wall_height", default), "relief.wall_height", 0.01, 1000)
        return _raised(plan, terrain, ceiling, wall_height)

    def level(self, table: Any, world: World) -> Terrain:
        """Return level ground over the world, or over `area`."""
        cell = self.number(table.get("cell", 0.25), "relief.cell", 0.02, 10)
        margin = self.number(table.get("margin", 2.0), "relief.margin", 0.5, 1000)
        bounds = (0.0, 0.0, 0.0, 0.0)
        if "area" in table:
            x0, y0, x1, y1 = self.numbers(table["area"], "relief.area", 4, "[x0, y0, x1, y1]").tolist()
            if x1 <= x0 or y1 <= y0:
                self.fail(
                    "relief.area", f"{table['area']} is not [x0, y0, x1, y1] from the lower left to the upper right"
                )
            bounds, margin = (x0, y0, x1, y1), 0.0
        elif len(world.segments) or len(world.circles) or len(world.waypoints) or world.grid is not None:
            bounds = world.bounds
        else:
            self.fail("relief", "`area: [x0, y0, x1, y1]` is needed where there are no walls and no waypoints")
        nodes = (bounds[2] - bounds[0] + 2 * margin) / cell * (bounds[3] - bounds[1] + 2 * margin) / cell
        if nodes > _MAX_NODES:
            self.fail("relief.cell", f"{nodes:.0f} heights are more than {_MAX_NODES}: choose larger cells")
        return relief.level(bounds, margin, cell)

    def ramp(self, terrain: Terrain, value: Any, where: str) -> Terrain:
        """Return `terrain` with one entry of ``ramps``."""
        ramp = self.mapping(value, where, ("from", "to", "rise", "within"), ("from", "to", "rise"))
        begin, end = (self.numbers(ramp[key], f"{where}.{key}", 2, "[x, y]") for key in ("from", "to"))
        if np.hypot(*(end - begin)) < 0.01:
            self.fail(where, "`from` and `to` are the same point")
        within = self.numbers(ramp["within"], f"{where}.within", 4, "[x0, y0, x1, y1]") if "within" in ramp else None
        return relief.raise_ramp(terrain, begin, end, self.number(ramp["rise"], f"{where}.rise", -1000, 1000), within)

    def bump(self, terrain: Terrain, value: Any, where: str) -> Terrain:
        """Return `terrain` with one entry of ``bumps``."""
        bump = self.mapping(value, where, ("at", "radius", "height", "repeat", "step"), ("at", "radius", "height"))
        at = self.numbers(bump["at"], f"{where}.at", 2, "[x, y] of the middle")
        radius = self.number(bump["radius"], f"{where}.radius", 0.01, 1000)
        height = self.number(bump["height"], f"{where}.height", -1000, 1000)
        for offset in self.repeats(bump, where):
            terrain = relief.raise_bump(terrain, at + offset, radius, height)
        return terrain

    def hills(self, terrain: Terrain, value: Any, where: str) -> Terrain:
        """Return `terrain` with one entry of ``hills``."""
        hills = self.mapping(value, where, ("height", "wavelength", "seed"), ("height", "wavelength"))
        height = self.number(hills["height"], f"{where}.height", 0, 1000)
        wavelength = self.number(hills["wavelength"], f"{where}.wavelength", 0.1, 1e5)
        return relief.raise_hills(
            terrain, height, wavelength, int(self.number(hills.get("seed", 0), f"{where}.seed", 0))
        )


def _raised(plan: Plan, ground: Terrain, ceiling: Terrain | None, wall_height_m: float) -> Relief:
    below = float(ground.heights.min()) - 1.0
    panels = [_panel(row, ground, below, wall_height_m) for row in plan.walls]
    for door in plan.doors:
        panels.extend(_panel(leaf, ground, below, door.height_m) for leaf in door.leaf)
        for cut in door.cuts:
            lintel = _panel(cut, ground, below, wall_height_m)
            lintel[4] = float(ground.at((cut[None, :2] + cut[None, 2:]) / 2)[0]) + door.height_m
            panels.extend([lintel] if lintel[4] < lintel[5] else [])
    boxes, cylinders = [], []
    for thing in plan.things:
        base = float(ground.at(thing.at[None])[0])
        top = base + (wall_height_m if thing.height_m is None else thing.height_m)
        upright = [below if thing.above_m is None else base + thing.above_m, top]
        shine = relief.THING if thing.reflectivity is None else thing.reflectivity
        if isinstance(thing.size, float):
            cylinders.append(np.array([*thing.at, thing.size, *upright, shine]))
        else:
            turn = np.cos(thing.yaw_rad), np.sin(thing.yaw_rad)
            boxes.append(np.array([*thing.at, *turn, *(thing.size / 2), *upright, shine]))
    return Relief(
        ground,
        ceiling,
        np.array(panels).reshape(-1, 7),
        np.array(boxes).reshape(-1, 9),
        np.array(cylinders).reshape(-1, 6),
    )


def _panel(wall: Array, ground: Terrain, below_m: float, height_m: float) -> Array:
    """Return an upright panel (7,) over a segment (4,): from under the ground to a height above its highest ground."""
    count = int(np.hypot(*(wall[2:] - wall[:2])) / ground.cell_m) + 2
    line = wall[:2] + np.linspace(0.0, 1.0, count)[:, None] * (wall[2:] - wall[:2])
    return np.array([*wall, below_m, ground.highest(line) + height_m, relief.WALL])
