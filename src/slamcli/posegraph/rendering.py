# SPDX-License-Identifier: MIT
"""The map that is in a state."""

from __future__ import annotations

import numpy as np

from slamcli.errors import EstimationError
from slamcli.geometry import se2, se3
from slamcli.grids import OccupancyGrid
from slamcli.grids.submap_drawing import draw_submaps
from slamcli.posegraph.map_state import MapState


def draw_state(state: MapState, frame_id: str = "map") -> OccupancyGrid:
    """Return the submaps' grids at their optimised poses as one trinary grid, in the finest of their resolutions.

    Raises
    ------
    EstimationError
        If no submap has a planar grid with a known cell.
    """
    chosen = [submap for submap in state.submaps if submap.grid is not None]
    grids = [submap.grid for submap in chosen if submap.grid is not None]
    if not grids:
        raise EstimationError("no map can be drawn: the state has no submap with a planar grid")
    T_map_submap = se3.to_se2(np.array([submap.T_map_submap for submap in chosen]))
    T_local_submap = se3.to_se2(np.array([submap.T_local_submap for submap in chosen]))
    resolution = min(grid.resolution_m for grid in grids)
    tidy = float(f"{resolution:.6g}")  # Cartographer's 0.05 is 0.05000000074505806
    return draw_submaps(grids, se2.compose(T_map_submap, se2.inverse(T_local_submap)), tidy, frame_id)
