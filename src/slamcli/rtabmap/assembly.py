# SPDX-License-Identifier: MIT
"""Local grids put together where their nodes are in the end."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.grids.odds_plane import OddsPlane, OddsSettings
from slamcli.rtabmap.local_grid import LocalGrid, levelled
from slamcli.rtabmap.node_points import moved


@dataclass(frozen=True, slots=True, kw_only=True)
class AssemblySettings:
    """What the assembled grid is like; named as RTAB-Map's ``GridGlobal/`` parameters are."""

    odds: OddsSettings = field(default_factory=OddsSettings)
    min_size_m: float = 0.0
    """Edge of the square about the map's origin that the grid covers at least."""
    eroded: bool = False
    footprint_radius_m: float = 0.0
    """Half edge of the square that is free about every node, where it has been; less than one and a half cells: none."""
    max_nodes: int = 0
    """Only so many of the last nodes; 0: all."""
    altitude_delta_m: float = 0.0
    """Only nodes whose height differs by no more from that of the last; 0: all."""

    def chosen(self, T_map_base: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the rows of the poses (N, 4, 4), which are in the order of their ids, that the maps are made of."""
        rows = np.arange(len(T_map_base))
        if self.altitude_delta_m > 0.0 and len(rows):
            heights = T_map_base[:, 2, 3]
            rows = rows[np.abs(heights - heights[-1]) <= self.altitude_delta_m]
        return rows[-self.max_nodes :] if self.max_nodes > 0 else rows


class GridAssembly:
    """The occupancy grid of the plane; nodes are added in the order of their ids, and memory grows with the map alone."""

    def __init__(self, cell_size_m: float, settings: AssemblySettings) -> None:
        self._settings, self._cell = settings, cell_size_m
        self._plane = OddsPlane(cell_size_m, settings.odds)
        self._places: list[NDArray[np.float64]] = []

    def add(self, grid: LocalGrid, T_map_base: NDArray[np.float64]) -> None:
        """Add what a node at `T_map_base` (4, 4) saw: ground and empty space are free."""
        T = T_map_base if grid.spatial else levelled(T_map_base)
        ground, obstacles, empty = (moved(points, T)[:, :2] for points in (grid.ground, grid.obstacles, grid.empty))
        self._plane.include(T_map_base[None, :2, 3])
        self._plane.add(np.concatenate([ground, empty]), obstacles)
        self._places.append(T_map_base[:2, 3].copy())

    def grid(self, frame_id: str) -> OccupancyGrid | None:
        """Return the grid of everything added; None where nothing was seen."""
        settings = self._settings
        if settings.min_size_m > 0.0:
            self._plane.include(np.array([[-0.5, -0.5], [0.5, 0.5]]) * settings.min_size_m)
        if settings.footprint_radius_m >= 1.5 * self._cell:
            for place in self._places:
                self._plane.clear(place, settings.footprint_radius_m)
        return self._plane.grid(frame_id, eroded=settings.eroded)
