# SPDX-License-Identifier: MIT
"""What is computed once for a world and used by every robot that is placed in it."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import PlanningError
from slamcli.simulation import _flow_kernels
from slamcli.simulation.free_space import FreeSpace
from slamcli.simulation.walls import Walls, build_walls
from slamcli.simulation.world import World

Array = NDArray[np.float64]

PERSON_ROOM_M = 0.3
_PLACES = 32
_FINE_M = 0.15
_KEPT = 4  # sites in memory
_FAR = np.iinfo(np.int32).max


class Site:
    """Walls as kernels want them, and where people can walk to. Depends on the world alone, never on a seed."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._walls = {False: build_walls(world)}
        self._destinations: dict[int, Destinations] = {}

    def walls(self, *, unknown_is_wall: bool = False) -> Walls:
        """Return the walls; cells that nobody knows count as walls if `unknown_is_wall`."""
        if unknown_is_wall not in self._walls:
            self._walls[unknown_is_wall] = build_walls(self.world, unknown_is_wall=unknown_is_wall)
        return self._walls[unknown_is_wall]

    @cached_property
    def space(self) -> FreeSpace:
        """Where people have room."""
        return FreeSpace(self.world, PERSON_ROOM_M)

    @cached_property
    def room(self) -> NDArray[np.float32]:
        """float32 (H, W), metres to the nearest wall (or cell that nobody knows), on the fine cells of `space`."""
        return np.ascontiguousarray(self.space.distance_m, dtype=np.float32)

    def destinations(self, near: Array) -> Destinations:
        """Return where people walk in the area of the point `near` (2,), in the largest area if it is in none.

        Raises
        ------
        PlanningError
            If no place in the world has room for a person.
        """
        try:
            row, column = self.space.nearest(near, "the robot")
        except PlanningError:
            row, column = self.space.nearest(self.space.roomiest(), "the roomiest place")
        area = int(self.space.cells[1][row, column])
        if area not in self._destinations:
            self._destinations[area] = _spread(self.space, area)
        return self._destinations[area]


@dataclass(eq=False)
class Destinations:
    """Places spread over an area, and how to get to each of them from anywhere."""

    cells: NDArray[np.int64]
    """int64 (N, 2), row and column of every coarse cell of the area."""
    places: NDArray[np.int64]
    """int64 (K, 2), row and column of the places in `prices`."""
    points: Array
    """float64 (K, 2), the places in the map."""
    prices: NDArray[np.uint8]
    """uint8 (h, w), price of walking over a cell, 0 where nobody can."""
    cell_m: float
    """Size of the cells of `prices` and `fields`; their grid has the corner of the space's."""
    fields: NDArray[np.int32]
    """int32 (K, h, w), cost to each place; computed when it is first walked to."""
    _ready: set[int] = field(default_factory=set)

    def prepare(self, place: int) -> None:
        """Compute the field of a place unless it is there."""
        if place not in self._ready:
            row, column = (int(v) for v in self.places[place])
            _flow_kernels.distances_to(row, column, self.prices, _FAR, self.fields[place])
            self._ready.add(place)


def _spread(space: FreeSpace, area: int) -> Destinations:
    room, areas, (x0, y0, size) = space.cells
    cells = np.argwhere(areas == area)
    rng = np.random.default_rng(0)
    drawn = cells[rng.integers(0, len(cells), 4 * _PLACES)]
    chosen = [0]
    far = np.full(len(drawn), np.inf)
    while len(chosen) < min(_PLACES, len(cells)):
        far = np.minimum(far, np.hypot(*(drawn - drawn[chosen[-1]]).T))
        chosen.append(int(np.argmax(far)))
    places = drawn[chosen]
    points = np.array([x0, y0]) + (places[:, ::-1] + 0.5) * size
    near = np.maximum(room - space.clearance_m, 0.0)
    prices = np.where(areas == area, np.rint(4.0 * (1.0 + 2.0 * np.exp(-near / 0.3))), 0.0).astype(np.uint8)
    if size <= _FINE_M:
        prices, places, size = _pooled(prices), places // 2, 2.0 * size
    return Destinations(cells, places, points, prices, size, np.empty((len(places), *prices.shape), np.int32))


def _pooled(prices: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the cheapest price of each two by two cells where anybody can walk in them; odd edges are padded with walls.

    Walls and the room beside them are wider than two of these cells, so that no way opens through them.
    """
    padded = np.pad(prices, ((0, prices.shape[0] % 2), (0, prices.shape[1] % 2))) - np.uint8(1)  # 0 becomes 255
    blocks = padded.reshape(padded.shape[0] // 2, 2, padded.shape[1] // 2, 2)
    return np.ascontiguousarray(blocks.min(axis=(1, 3)) + np.uint8(1))


_SITES: OrderedDict[bytes, Site] = OrderedDict()


def site_of(world: World) -> Site:
    """Return the site of a world: the same one for worlds of the same content, as long as few others are asked for."""
    key = _content(world)
    if key not in _SITES:
        _SITES[key] = Site(world)
    _SITES.move_to_end(key)
    while len(_SITES) > _KEPT:
        _SITES.popitem(last=False)
    return _SITES[key]


def _content(world: World) -> bytes:
    """Return a digest of everything that a site depends on."""
    digest = hashlib.blake2b(repr((world.name, world.bounds)).encode())
    for array in (world.segments, world.circles):
        digest.update(repr(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    if world.grid is not None:
        grid = world.grid
        digest.update(repr((grid.cells.shape, grid.resolution_m, grid.origin)).encode())
        digest.update(grid.cells.tobytes())
    return digest.digest()


def warm() -> None:
    """Compile the kernels of this module."""
    _flow_kernels.distances_to(0, 0, np.ones((2, 2), np.uint8), _FAR, np.empty((2, 2), np.int32))
