# SPDX-License-Identifier: MIT
"""What is drawn of a database of RTAB-Map: the map that its last session left, and the nodes on it."""

from __future__ import annotations

from pathlib import Path

from slamcli.grids import OccupancyGrid
from slamcli.pipelines.database_poses import read_database_poses
from slamcli.rtabmap.database import Database
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory


def read_database_map(path: Path, log: RunLog) -> tuple[OccupancyGrid | None, Trajectory]:
    """Return the assembled map, None where there is none, and the poses of the nodes by id.

    They are those of the last optimisation; with a note those of odometry where nothing was optimised, and then no map belongs to them.

    Raises
    ------
    FormatError
        If the file is no database of RTAB-Map, or its nodes have no poses.
    """
    nodes = read_database_poses(path, log=log)
    with Database.read(path) as database:
        stored = None if database.optimised() is None else database.grid()
    if stored is None:
        return None, nodes
    return OccupancyGrid(stored.cells, stored.resolution_m, (stored.x_min_m, stored.y_min_m, 0.0)), nodes
