# SPDX-License-Identifier: MIT
"""The world that a simulated robot lives in: walls seen from above, and what the robot is to do there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.simulation.relief import Relief

OCCUPIED_FROM = 65
"""Cells of at least this occupancy (percent) are walls, as map_server's default threshold has it."""


@dataclass(frozen=True, slots=True, eq=False)
class Walker:
    """Somebody who walks to and fro along a line of points."""

    points: NDArray[np.float64]
    """float64 (N, 2), metres, map frame, N >= 2."""
    speed_m_s: float = 0.9


@dataclass(frozen=True, slots=True, eq=False)
class Cart:
    """A box or disc that comes at a time, stands or moves to and fro along its points, and goes."""

    points: NDArray[np.float64]
    """float64 (N, 2), metres, map frame; one point: it stands."""
    size_m: tuple[float, float] = (0.8, 0.5)
    """Length and width of a box."""
    radius_m: float = 0.0
    """Of a disc (its size is (0, 0) then)."""
    yaw_rad: float = 0.0
    """Heading of a box that stands; one that moves heads where it goes."""
    speed_m_s: float = 0.5
    appears_s: float = 0.0
    leaves_s: float = math.inf


@dataclass(frozen=True, slots=True, eq=False)
class CarriedPath:
    """Poses that a carried rig passes, in order."""

    poses: NDArray[np.float64]
    """float64 (N, 6), x, y, z (metres, map frame), roll, pitch (nose down), yaw (radians, not wrapped); N >= 3."""
    closed: bool = False
    """Whether the last is followed by the first."""
    rounds: float = 1.0
    """How often a closed path is passed."""


@dataclass(frozen=True, eq=False)
class World:
    """Walls as segments, circles and cells of a grid (any may be empty), the robot's start and its way.

    Without waypoints the robot drives at random.
    """

    name: str
    segments: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4)))
    """float64 (S, 4), x0, y0, x1, y1 in metres, map frame."""
    circles: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    """float64 (C, 3), x, y, radius in metres, map frame."""
    grid: OccupancyGrid | None = None
    """Occupied cells are walls, unknown ones let beams through, and the robot keeps off both."""
    start: tuple[float, float, float] | None = None
    """x, y (metres) and yaw (radians) of the robot, map frame; None: the first waypoint, or the place with most room."""
    waypoints: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    """float64 (N, 2), metres, map frame."""
    rounds: int = 1
    """How often the waypoints are driven through."""
    walkers: tuple[Walker, ...] = ()
    carts: tuple[Cart, ...] = ()
    """Seen and met by robots that obey velocities (`slamcli.simulation.plant`)."""
    path: CarriedPath | None = None
    """Where a carried rig flies, instead of a robot that drives."""
    relief: Relief | None = None
    """What stands how high on which ground; None: a level floor with walls of 2.5 m."""
    settings: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    """Values of `SimulationParameters` by native name that belong to this world."""
    description: str = ""

    @cached_property
    def occupied_cells(self) -> NDArray[np.uint8]:
        """uint8 (H, W), 1 where the grid has a wall."""
        if self.grid is None:
            return np.zeros((0, 0), np.uint8)
        return (self.grid.cells >= OCCUPIED_FROM).astype(np.uint8)

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """X and y (metres, map frame) of the lower left and upper right corner of everything there is."""
        points = [self.segments[:, :2], self.segments[:, 2:], self.waypoints]
        points += [self.circles[:, :2] - self.circles[:, 2:], self.circles[:, :2] + self.circles[:, 2:]]
        points += [np.array([self.start[:2]])] if self.start else []
        points += [self.path.poses[:, :2]] if self.path else []
        if self.grid is not None:
            h, w = self.grid.height, self.grid.width
            points.append(self.grid.cell_to_map(np.array([[0, 0], [0, w], [h, 0], [h, w]]) - 0.5))
        if self.relief is not None:
            points.append(np.array(self.relief.ground.corners))
        stacked = np.concatenate(points)
        low, high = stacked.min(axis=0), stacked.max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])
