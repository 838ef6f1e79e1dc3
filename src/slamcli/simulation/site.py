# SPDX-License-Identifier: MIT
"""What is computed once for a world and used by every robot that is placed in it."""

from __future__ import annotations

import weakref
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
_FAR = np.iinfo(np.int32).max


class Site:
    """Walls as kernels want them, and where people can walk to. Depends on the world alone, never on a seed."""

    def __init__(self, world: World) -> None:
        self._walls = {False: build_walls(world)}
        self._world = weakref.ref(world)
        self._destinations: dict[int, Destinations] = {}

    def walls(self, *, unknown_is_wall: bool = False) -> Walls:
        """Return the walls; cells that nobody knows count as walls if `unknown_is_wall`."""
        if unknown_is_wall not in self._walls:
            self._walls[unknown_is_wall] = build_walls(self.world, unknown_is_wall=unknown_is_wall)
        return self._walls[unknown_is_wall]

    @property
    def world(self) -> World:
        """The world, which lives as long as somebody else holds it."""
        world = self._world()
        if world is None:
            raise ReferenceError("the world of this site is gone")
        return world

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
    """int64 (K, 2), the same of the places."""
    points: Array
    """float64 (K, 2), the places in the map."""
    prices: NDArray[np.uint8]
    """uint8 (h, w), price of walking over a cell, 0 where nobody can."""
    fields: NDArray[np.int32]
    """int32 (K, h, w), cost to each place; computed when it is first walked to."""
    _ready: set[int] = field(default_factory=set)

    def prepare(self, place: int) -> None:
        """Compute the field of a place unless it is there."""
        if place not in self._ready:
            row, column = self.places[place]
            _flow_kernels.distances_to(int(row), int(column), self.prices, _FAR, self.fields[place])
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
    near = np.maximum(room - space.clearance_m, 0.0)
    prices = np.where(areas == area, np.rint(4.0 * (1.0 + 2.0 * np.exp(-near / 0.3))), 0.0).astype(np.uint8)
    points = np.array([x0, y0]) + (places[:, ::-1] + 0.5) * size
    return Destinations(cells, places, points, prices, np.empty((len(places), *prices.shape), np.int32))


_SITES: weakref.WeakKeyDictionary[World, Site] = weakref.WeakKeyDictionary()


def site_of(world: World) -> Site:
    """Return the site of a world, the same one for as long as the world lives."""
    if world not in _SITES:
        _SITES[world] = Site(world)
    return _SITES[world]


def warm() -> None:
    """Compile the kernels of this module."""
    _flow_kernels.distances_to(0, 0, np.ones((2, 2), np.uint8), _FAR, np.empty((2, 2), np.int32))
