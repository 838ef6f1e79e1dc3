# SPDX-License-Identifier: MIT
"""Watches a closed loop and makes a film of it."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ProcessError
from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid
from slamcli.grids.crop import known_box
from slamcli.measurements import LaserScan, Odometry
from slamcli.navigation.cost_window import CostWindow
from slamcli.pipelines.loop_listener import LoopListener
from slamcli.reports.figures.plane import View
from slamcli.reports.film import write_film
from slamcli.reports.film_painter import FilmPainter
from slamcli.reports.snapshot import CostPatch, Snapshot

Array = NDArray[np.float64]

FRAME_S = 0.1
_MOST_FRAMES = 900
_MOST_PIXELS = 720
_MOST_PARTICLES = 400
_LEAST_M_PER_PX = 0.0125
_LEAST_HEIGHT_PX = 120
_MARGIN_M = 3.0
"""How much of the map is shown around what happens."""
_NO_POINTS: Array = np.zeros((0, 2))


class Animation(LoopListener):
    """Keeps ten moments of each simulated second, and draws them when the run has ended.

    Of a run of more than 90 s every second, third, … moment is shown, so that the film does not get longer than that.

    Parameters
    ----------
    T_base_laser, upside_down
        float64 (3,): where the scanner sits, and whether its z axis points down.
    """

    def __init__(self, T_base_laser: Array, *, upside_down: bool = False) -> None:
        self._T_base_laser = np.asarray(T_base_laser, dtype=np.float64)
        self._side = -1.0 if upside_down else 1.0
        self._maps: list[_PackedGrid] = []
        self._moments: list[Snapshot] = []
        self._every = 1
        self._seen = 0
        self._next_s = 0.0
        self._scan: LaserScan | None = None
        self._pose_odom: Array | None = None
        self._T_map_odom: Array | None = None
        self._window: CostWindow | None = None
        self._particles, self._plan, self._local_plan = _NO_POINTS, _NO_POINTS, _NO_POINTS
        self._people: Array = np.zeros((0, 5))
        self._goal: Array | None = None
        self._state = ""
        self._footprint: Array = 0.2 * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])

    def on_map(self, time_s: float, grid: OccupancyGrid) -> None:  # noqa: ARG002
        """Keep the map."""
        self._maps.append(_PackedGrid(grid))

    def on_odometry(self, time_s: float, odometry: Odometry) -> None:  # noqa: ARG002
        """Keep what the wheels told."""
        self._pose_odom = odometry.pose_se2

    def on_scan(self, time_s: float, scan: LaserScan) -> None:  # noqa: ARG002
        """Keep the scan."""
        self._scan = scan

    def on_localisation(self, time_s: float, T_map_odom: Array, covariance: Array, particles: Array) -> None:  # noqa: ARG002
        """Keep the correction, and some of the particles."""
        self._T_map_odom = np.array(T_map_odom)
        every = max(1, math.ceil(len(particles) / _MOST_PARTICLES))
        self._particles = np.array(particles[::every, :2])

    def on_costmap(self, time_s: float, name: str, costmap: CostWindow) -> None:  # noqa: ARG002
        """Keep the local costmap."""
        self._footprint = costmap.footprint
        if name == "local":
            self._window = CostWindow(
                costs=costmap.costs.copy(), origin_m=costmap.origin_m, resolution_m=costmap.resolution_m,
                frame=costmap.frame, footprint=costmap.footprint, inscribed_radius_m=costmap.inscribed_radius_m,
                circumscribed_radius_m=costmap.circumscribed_radius_m,
            )  # fmt: skip

    def on_plan(self, time_s: float, plan: Array) -> None:  # noqa: ARG002
        """Keep the plan."""
        self._plan = np.array(plan[:, :2])

    def on_local_plan(self, time_s: float, trajectory: Array) -> None:  # noqa: ARG002
        """Keep it."""
        self._local_plan = np.array(trajectory[:, :2])

    def on_people(self, time_s: float, discs: Array) -> None:  # noqa: ARG002
        """Keep where they are."""
        self._people = np.array(discs, dtype=np.float64).reshape(-1, 5)

    def on_goal(self, time_s: float, goal: Array) -> None:  # noqa: ARG002
        """Keep the goal."""
        self._goal = np.array(goal, dtype=np.float64)

    def on_status(self, time_s: float, state: str, message: str) -> None:  # noqa: ARG002
        """Keep what is being done, and why where it is not driving."""
        self._state = state if not message or state == "controlling" else f"{state}: {message}"

    def on_truth(self, time_s: float, pose_map: Array, twist: Array) -> None:
        """Take a moment, if it is time for one."""
        if time_s < self._next_s - 1e-6:
            return
        self._next_s = max(self._next_s + FRAME_S, time_s)
        self._seen += 1
        if (self._seen - 1) % self._every:
            return
        self._moments.append(self._snapshot(time_s, np.array(pose_map), np.array(twist)))
        if len(self._moments) > _MOST_FRAMES:
            self._every += self._every
            self._moments = self._moments[::2]

    @property
    def is_empty(self) -> bool:
        """Whether no time has passed, so that there is nothing to show."""
        return not self._moments

    def write(self, target: Path) -> int:
        """Write the film as the suffix of `target` says, and return the number of its frames.

        Raises
        ------
        UsageError, DependencyError, ProcessError
            As `slamcli.reports.film.write_film`; also if nothing happened.
        """
        if not self._moments:
            raise ProcessError(f"{target}: nothing happened that could be shown")
        write_film(target, self._frames(), frame_s=FRAME_S)
        return len(self._moments)

    def _snapshot(self, time_s: float, pose: Array, twist: Array) -> Snapshot:
        odom, T_map_odom = self._pose_odom, self._T_map_odom
        estimate = None if odom is None or T_map_odom is None else se2.compose(T_map_odom, odom)
        local_plan, patch = _NO_POINTS, None
        if T_map_odom is not None:
            local_plan = se2.transform_points(T_map_odom, self._local_plan)
            if self._window is not None:
                patch = CostPatch(
                    costs=self._window.costs, resolution_m=self._window.resolution_m,
                    T_map_corner=se2.compose(T_map_odom, np.array([*self._window.origin_m, 0.0])),
                )  # fmt: skip
        return Snapshot(
            time_s=time_s, pose=pose, speed=twist, estimate=estimate,
            scan_m=self._points(pose if estimate is None else estimate), particles_m=self._particles, patch=patch,
            plan_m=self._plan, local_plan_m=local_plan, people=self._people, goal=self._goal, state=self._state,
            map_number=len(self._maps) - 1,
        )  # fmt: skip

    def _points(self, T_map_base: Array) -> Array:
        """Return where the beams of the last scan ended, (N, 2) in map."""
        scan = self._scan
        if scan is None:
            return _NO_POINTS
        ranges = scan.ranges_m.astype(np.float64)
        hit = (ranges >= scan.range_min_m) & (ranges < scan.range_max_m)
        angles = scan.angles_rad[hit]
        ends = ranges[hit, None] * np.column_stack([np.cos(angles), self._side * np.sin(angles)])
        return se2.transform_points(se2.compose(T_map_base, self._T_base_laser), ends)

    def _frames(self) -> Iterator[NDArray[np.uint8]]:
        grids = [packed.grid() for packed in self._maps]
        trail = np.array([[m.time_s, *m.pose[:2]] for m in self._moments])
        shown = np.concatenate([trail[:, 1:], *(m.plan_m for m in self._moments), *self._goals()])
        view = _view(shown, grids[-1] if grids else None)
        painter = FilmPainter(grids, view, self._footprint, trail)
        return (painter.paint(moment) for moment in self._moments)

    def _goals(self) -> list[Array]:
        return [m.goal[None, :2] for m in self._moments if m.goal is not None]


class _PackedGrid:
    """A map that takes little room: one that is made as the robot drives is told many times."""

    def __init__(self, grid: OccupancyGrid) -> None:
        self._packed = zlib.compress(grid.cells.tobytes(), 1)
        self._shape, self._place = grid.cells.shape, (grid.resolution_m, grid.origin, grid.frame_id)

    def grid(self) -> OccupancyGrid:
        """Return it as it was."""
        cells = np.frombuffer(zlib.decompress(self._packed), dtype=np.int8).reshape(self._shape)
        return OccupancyGrid(cells, *self._place)


def _view(points_m: Array, grid: OccupancyGrid | None) -> View:
    """Return the part of the plane around points (N, 2), no more than the map where there is one."""
    low, high = points_m.min(axis=0) - _MARGIN_M, points_m.max(axis=0) + _MARGIN_M
    box = None if grid is None else known_box(grid)
    if grid is not None and box is not None:
        r0, c0, r1, c1 = box
        corners = grid.cell_to_map(np.array([[r, c] for r in (r0 - 1, r1) for c in (c0 - 1, c1)]))
        low = np.minimum(np.maximum(low, corners.min(axis=0)), points_m.min(axis=0))
        high = np.maximum(np.minimum(high, corners.max(axis=0)), points_m.max(axis=0))
    scale = max(float((high - low).max()) / _MOST_PIXELS, _LEAST_M_PER_PX)
    size = np.maximum(np.ceil((high - low) / scale), 1).astype(np.int64)
    return View(float(low[0]), float(low[1]), scale, int(size[0]), max(int(size[1]), _LEAST_HEIGHT_PX))
