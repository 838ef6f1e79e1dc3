# SPDX-License-Identifier: MIT
"""Who tells a closed loop where the robot is: AMCL, SLAM as it goes, or the truth."""

from __future__ import annotations

import dataclasses
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid
from slamcli.localization.amcl import Amcl
from slamcli.mapper import LiveMapper
from slamcli.measurements import LaserScan, Odometry

Array = NDArray[np.float64]
_NO_PARTICLES: Array = np.zeros((0, 3))
_AROUND_M = 3.0
"""How far a map reaches beyond its goals at least."""


class Localiser(Protocol):
    """Takes what the robot measured, in the order of time, and knows the correction of odometry."""

    @property
    def T_map_odom(self) -> Array:  # noqa: N802 - frames as everywhere
        """float64 (3,)."""

    def on_odometry(self, odometry: Odometry, true_pose: Array, pose_odom: Array) -> None:
        """Take what the wheels told; `true_pose` (3,) is for those that may look at it."""

    def on_scan(self, scan: LaserScan, pose_odom: Array, T_base_laser: Array) -> bool:
        """Take a scan, made at odometry's `pose_odom` (3,); return whether the correction is a new one."""

    @property
    def covariance(self) -> Array:
        """float64 (3, 3) of the pose in map."""

    @property
    def particles(self) -> Array:
        """float64 (N, 3), poses in map; N may be 0."""

    def new_map(self) -> OccupancyGrid | None:
        """Return the map if there is a newer one than at the last call, else None."""

    def reach_to(self, goal: Array) -> None:
        """Make maps that grow reach to a goal (3,)."""


class TrueLocaliser:
    """Knows the truth.

    Parameters
    ----------
    start
        float64 (3,): the robot in the map when odometry is at its origin.
    """

    def __init__(self, start: Array) -> None:
        self.T_map_odom: Array = start
        self.covariance: Array = np.zeros((3, 3))
        self.particles = _NO_PARTICLES

    def on_odometry(self, odometry: Odometry, true_pose: Array, pose_odom: Array) -> None:  # noqa: ARG002
        """Look at the truth."""
        self.T_map_odom = se2.compose(true_pose, se2.inverse(pose_odom))

    def on_scan(self, scan: LaserScan, pose_odom: Array, T_base_laser: Array) -> bool:  # noqa: ARG002
        """Report the correction with every scan."""
        return True

    def new_map(self) -> OccupancyGrid | None:
        """Return None."""
        return None

    def reach_to(self, goal: Array) -> None:
        """Do nothing."""


class AmclLocaliser:
    """Adaptive Monte Carlo Localization on the map."""

    def __init__(self, amcl: Amcl) -> None:
        self.amcl = amcl

    @property
    def T_map_odom(self) -> Array:  # noqa: N802 - frames as everywhere
        """float64 (3,)."""
        return self.amcl.T_map_odom

    @property
    def covariance(self) -> Array:
        """float64 (3, 3) of the pose in map."""
        return self.amcl.covariance

    @property
    def particles(self) -> Array:
        """float64 (N, 3), poses in map."""
        return self.amcl.particles

    def on_odometry(self, odometry: Odometry, true_pose: Array, pose_odom: Array) -> None:
        """Wait for the scan."""

    def on_scan(self, scan: LaserScan, pose_odom: Array, T_base_laser: Array) -> bool:
        """Filter, if the robot has moved enough."""
        return self.amcl.update(pose_odom, scan, T_base_laser)

    def new_map(self) -> OccupancyGrid | None:
        """Return None: the map stays as it is."""
        return None

    def reach_to(self, goal: Array) -> None:
        """Do nothing."""


class SlamLocaliser:
    """A tier that maps while the robot drives; its map is laid so that the robot begins at `start`.

    Parameters
    ----------
    mapper
        The tier.
    start
        float64 (3,): the robot in the map when odometry is first heard.
    map_period_s
        How often the map is drawn anew.
    """

    def __init__(self, mapper: LiveMapper, start: Array, map_period_s: float) -> None:
        self.mapper = mapper
        self.covariance: Array = np.zeros((3, 3))
        self.particles = _NO_PARTICLES
        self.T_map_odom: Array = np.zeros(3)
        self._start, self._period_ns = start, round(map_period_s * 1e9)
        self._T_map_slam: Array | None = None
        self._begun, self._now_ns, self._due_ns = False, 0, 0
        self._corners = [start[:2] - _AROUND_M, start[:2] + _AROUND_M]

    def on_odometry(self, odometry: Odometry, true_pose: Array, pose_odom: Array) -> None:  # noqa: ARG002
        """Hand it on."""
        self._begin(pose_odom)
        self.mapper.process(odometry)

    def on_scan(self, scan: LaserScan, pose_odom: Array, T_base_laser: Array) -> bool:  # noqa: ARG002
        """Hand it on."""
        self._begin(pose_odom)
        self.mapper.process(scan)
        if self._T_map_slam is None:
            self._T_map_slam = se2.compose(self.T_map_odom, se2.inverse(self.mapper.T_map_odom))
        self.T_map_odom = se2.compose(self._T_map_slam, self.mapper.T_map_odom)
        self._now_ns = scan.stamp_ns
        return True

    def _begin(self, pose_odom: Array) -> None:
        """Lay odometry so that the robot is at the start."""
        if not self._begun:
            self.T_map_odom = se2.compose(self._start, se2.inverse(pose_odom))
            self._begun = True

    def new_map(self) -> OccupancyGrid | None:
        """Return the map, drawn anew, once in every period."""
        if self._now_ns < self._due_ns or self._T_map_slam is None:
            return None
        try:
            grid = self.mapper.grid()
        except EstimationError:  # nothing in range yet
            return None
        self._due_ns = self._now_ns + self._period_ns
        return self._widened(self.placed(grid))

    def reach_to(self, goal: Array) -> None:
        """Make the map reach to a goal (3,) with unknown cells."""
        self._corners += [goal[:2] - _AROUND_M, goal[:2] + _AROUND_M]
        self._due_ns = 0

    def _widened(self, grid: OccupancyGrid) -> OccupancyGrid:
        """Return the map with a border of unknown cells as wide as the start and all goals ask for."""
        cells = grid.map_to_cell(np.array(self._corners))
        below, left = np.maximum(-cells.min(axis=0), 0).tolist()
        above, right = np.maximum(cells.max(axis=0) + 1 - [grid.height, grid.width], 0).tolist()
        if not (below or left or above or right):
            return grid
        wider = np.pad(grid.cells, ((below, above), (left, right)), constant_values=OccupancyGrid.UNKNOWN)
        x, y = grid.cell_to_map([[-below - 0.5, -left - 0.5]])[0].tolist()
        return OccupancyGrid(wider, grid.resolution_m, (x, y, grid.origin[2]))

    def placed(self, grid: OccupancyGrid) -> OccupancyGrid:
        """Return a map of the tier where it lies in the map frame."""
        if self._T_map_slam is None:
            return grid
        x, y, yaw = se2.compose(self._T_map_slam, grid.origin).tolist()
        return dataclasses.replace(grid, origin=(x, y, yaw))
