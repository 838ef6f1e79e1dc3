# SPDX-License-Identifier: MIT
"""A small room without symmetry, scans of it, and a drive through it."""

from __future__ import annotations

import numpy as np

from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid
from slamcli.measurements import LaserScan
from slamcli.simulation import raycast
from slamcli.simulation.world import World

BEAMS = 180


def furnished_room() -> OccupancyGrid:
    """Return 8 m x 6 m with walls, a wall into the room and two boxes; the corner of the grid is at -1, -1."""
    cells = np.zeros((120, 160), dtype=np.int8)
    cells[:2] = cells[-2:] = cells[:, :2] = cells[:, -2:] = 100
    cells[:55, 100:103] = 100
    cells[80:92, 20:40] = 100
    cells[95:103, 130:136] = 100
    return OccupancyGrid(cells, 0.05, (-1.0, -1.0, 0.0))


def scan_at(
    grid: OccupancyGrid, pose, stamp_s: float = 0.0, *, mount=(0.1, 0.0, 0.0), clockwise: bool = False, topic: str = "/scan"
) -> LaserScan:  # fmt: skip
    """Return an exact scan from a pose (3,) of the robot."""
    increment = 2.0 * np.pi / BEAMS * (-1.0 if clockwise else 1.0)
    first = -np.pi if not clockwise else np.pi
    laser = se2.compose(pose, mount)
    angles = laser[2] + first + increment * np.arange(BEAMS)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    ranges = raycast.cast(World(name="room", grid=grid), np.tile(laser[:2], (BEAMS, 1)), directions, 12.0)
    return LaserScan(
        stamp_ns=round(stamp_s * 1e9), frame_id="laser", angle_min_rad=first, angle_increment_rad=increment,
        range_min_m=0.05, range_max_m=12.0, ranges_m=ranges.astype(np.float32), topic=topic,
    )  # fmt: skip


def round_trip(num: int = 60) -> np.ndarray:
    """Return poses (num, 3) on an arc through the free part of the room."""
    turns = np.linspace(0.0, 1.5, num)
    x, y = 1.8 + 1.2 * np.cos(turns * 2.0 + 2.0), 1.5 + 1.0 * np.sin(turns * 2.0 + 2.0)
    yaw = np.arctan2(np.gradient(y), np.gradient(x))
    return np.column_stack([x, y, yaw])
