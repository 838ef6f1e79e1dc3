# SPDX-License-Identifier: MIT
"""A database of RTAB-Map to a trajectory file or a pose graph."""

from __future__ import annotations

import time
from pathlib import Path

from slamcli.errors import UsageError
from slamcli.formats.g2o import write_g2o
from slamcli.formats.trajectories import WRITERS
from slamcli.pipelines.convert_state import StateConversion, recorded
from slamcli.pipelines.database_poses import read_database_graph, read_database_poses
from slamcli.pipelines.trajectories import parse_source
from slamcli.runtime import RunLog

_FORMATS = {".tum": "tum", ".txt": "tum", ".kitti": "kitti", ".csv": "euroc", ".g2o": "g2o"}


def convert_database(source: str, target: Path, log: RunLog) -> StateConversion:
    """Write the trajectory of a database, or its graph, to a file that is named for its format.

    Parameters
    ----------
    source
        ``rtabmap.db``, or ``rtabmap.db:odometry`` and ``rtabmap.db:truth`` for other poses than the optimised ones.
    target
        ``.tum`` or ``.txt`` (TUM), ``.kitti``, ``.csv`` (EuRoC), or ``.g2o``: all links, with the optimised poses.
    log
        Takes notes on what is left out.

    Raises
    ------
    FormatError
        If the source is no such database, a damaged one, or has no such poses.
    UsageError
        If the target is named otherwise or is the source.
    """
    began = time.perf_counter()
    found = parse_source(source)
    kind = _FORMATS.get(target.suffix.lower())
    if kind is None:
        raise UsageError(f"{target}: a database becomes a trajectory (.tum, .kitti, .csv) or a graph (.g2o)")
    if target.resolve() == found.path.resolve():
        raise UsageError(f"{target}: source and target are the same")
    if kind == "g2o":
        if found.part:
            raise UsageError(f"{source}: a graph is written with the optimised poses; name the file alone")
        graph = read_database_graph(found.path, log)
        write_g2o(target, graph)
        poses = len(graph.ids)
    else:
        trajectory = read_database_poses(found.path, found.part, log=log)
        WRITERS[kind](target, trajectory)
        poses = len(trajectory)
    return recorded(found, target, kind, poses, began, log)
