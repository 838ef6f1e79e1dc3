# SPDX-License-Identifier: MIT
"""The map that is in a state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.geometry import se2, se3
from slamcli.grids import OccupancyGrid
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.grids.submap_drawing import draw_submaps
from slamcli.grids.tsdf_grid import TsdfGrid
from slamcli.posegraph.map_state import MapState, Submap

_MOST_TSD = 32766.0


def draw_state(state: MapState, frame_id: str = "map") -> OccupancyGrid:
    """Return the submaps' grids at their optimised poses as one trinary grid, in the finest of their resolutions.

    Raises
    ------
    EstimationError
        If no submap has a planar grid with a known cell.
    """
    chosen = [submap for submap in state.submaps if submap.grid is not None]
    if not chosen:
        raise EstimationError("no map can be drawn: the state has no submap with a planar grid")
    grids = [_probability_grid(submap) for submap in chosen]
    T_map_submap = se3.to_se2(np.array([submap.T_map_submap for submap in chosen]))
    T_local_submap = se3.to_se2(np.array([submap.T_local_submap for submap in chosen]))
    resolution = min(grid.resolution_m for grid in grids)
    tidy = float(f"{resolution:.6g}")  # Cartographer's 0.05 is 0.05000000074505806
    return draw_submaps(grids, se2.compose(T_map_submap, se2.inverse(T_local_submap)), tidy, frame_id)


def _probability_grid(submap: Submap) -> ProbabilityGrid:
    if isinstance(submap.grid, TsdfGrid):
        return _from_distances(submap.grid)
    if submap.grid is None:
        raise EstimationError(f"submap {submap.id.number} of trajectory {submap.id.trajectory} has no planar grid")
    return submap.grid


def _from_distances(grid: TsdfGrid) -> ProbabilityGrid:
    """Return cells as occupied within half a cell of a surface, free in front of it and unknown behind it."""
    step = 2.0 * grid.truncation_distance_m / _MOST_TSD
    distances = (grid.tsd.astype(np.float64) - 1.0) * step - grid.truncation_distance_m
    known = (grid.tsd > 0) & (grid.weights > 0) & (distances > -grid.resolution_m / 2)
    # Linear from surely occupied on the surface over even odds half a cell in front of it to surely free a cell away.
    away = np.clip(np.abs(distances) / grid.resolution_m, 0.0, 1.0)
    costs: NDArray[np.uint16] = np.where(known, np.rint(1.0 + away * 32766.0), 0.0).astype(np.uint16)
    return ProbabilityGrid(costs, grid.resolution_m, grid.origin)
