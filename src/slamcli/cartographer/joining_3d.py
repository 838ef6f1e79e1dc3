# SPDX-License-Identifier: MIT
"""Where a new trajectory lies in the map of a loaded state: found by searching some of its nodes in whole submaps."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.constraints_3d import Candidate, SubmapMatcher
from slamcli.cartographer.graph_3d import Graph3D
from slamcli.cartographer.parameters import CartographerParameters
from slamcli.geometry import se3
from slamcli.runtime import RunLog

PROBES = 8
"""Nodes of the new trajectory that are searched."""
SUPPORT_M, SUPPORT_RAD = 0.5, 0.05
"""Two probes agree that place the trajectory at most so far apart, seen at the second one."""


def join(graph: Graph3D, trajectory: int, parameters: CartographerParameters, jobs: int, log: RunLog) -> bool:
    """Move a trajectory to where its nodes are found in the submaps of the others; whether that succeeded.

    Each probe is searched in every finished submap at all places and yaws (``global_localization_min_score``). The placement
    with which most probes agree wins; one that no second probe confirms is taken only if its score is 0.1 over the minimum.
    """
    rows = graph.trajectory_rows(trajectory)
    if not len(rows):
        return False
    probes = rows[np.unique(np.linspace(0, len(rows) - 1, PROBES).astype(np.int64))]
    submaps = [i for i, submap in enumerate(graph.submaps) if submap.finished and submap.id.trajectory != trajectory]
    members = graph.members()

    def work(row: int) -> list[tuple[float, int, NDArray[np.float64]]]:
        matcher = SubmapMatcher(graph, row, members[row], parameters)
        found = []
        for probe in probes:
            node = graph.nodes[probe]
            start = se3.inverse(graph.T_map_submap[row]) @ graph.T_map_node[probe]
            # Heights of two runs have nothing to do with each other: begin where the submap's own nodes are.
            own = [member.T_submap_node[2, 3] for member in members[row]]
            start[2, 3] = float(np.median(own)) if own else 0.0
            T, score, _ = matcher.match(node, start, Candidate(row, int(probe), anywhere=True))
            if T is not None:
                T_new = graph.T_map_submap[row] @ T @ se3.inverse(graph.T_map_node[probe])
                found.append((score, int(probe), T_new))
        return found

    with ThreadPoolExecutor(jobs) as pool:
        placements = [placement for found in pool.map(work, submaps) for placement in found]
    best = _most_supported(graph, placements)
    least = parameters.pose_graph.constraint_builder.global_localization_min_score
    if best is None or (best[0] < 2 and best[1] < least + 0.1):
        log.warn(
            f"trajectory {trajectory} was not found in the loaded map: it is kept beside it, unconnected (do they overlap?)"
        )
        return False
    graph.move_trajectory(trajectory, best[2])
    return True


def _most_supported(
    graph: Graph3D, placements: list[tuple[float, int, NDArray[np.float64]]]
) -> tuple[int, float, NDArray[np.float64]] | None:
    """Return how many probes agree, the score and the placement of the best; of equals the higher score, then the first."""
    best: tuple[int, float, NDArray[np.float64]] | None = None
    for score, probe, T in placements:
        agreeing = {probe}
        for _, other, T_other in placements:
            off = se3.inverse(T @ graph.T_map_node[other]) @ T_other @ graph.T_map_node[other]
            angle = np.arccos(np.clip((np.trace(off[:3, :3]) - 1.0) / 2.0, -1.0, 1.0))
            if np.linalg.norm(off[:3, 3]) < SUPPORT_M and angle < SUPPORT_RAD:
                agreeing.add(other)
        if best is None or (len(agreeing), score) > best[:2]:
            best = (len(agreeing), score, T)
    return best
