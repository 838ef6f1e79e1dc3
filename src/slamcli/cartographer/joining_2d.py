# SPDX-License-Identifier: MIT
"""Where trajectories lie in each other's maps, when nothing says so yet: some nodes are searched in whole submaps.

Cartographer does it as it goes, for a small share of all nodes (``global_sampling_ratio``). In batch a few nodes that lie
far apart are enough, because their placements must agree.
"""

from __future__ import annotations

import math
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.graph_2d import Loop, PoseGraph2d
from slamcli.cartographer.loop_search_2d import Trial, search
from slamcli.geometry import se2
from slamcli.runtime import RunLog

_PROBES = 12
"""Nodes of a trajectory that are searched."""
_AGREE_M, _AGREE_RAD = 0.5, 0.05
"""How far apart two probes may place the trajectory, seen at the second one, besides the drift between them."""
_DRIFT, _TURN = 0.03, 0.002
"""Drift along the path between two probes: metres and radians per metre."""
_ENOUGH = 3
"""So many probes that agree end the search."""
_ALONE = 0.1
"""A placement that no second probe confirms is believed if its score is so much over the least one."""


def join_trajectories(graph: PoseGraph2d, executor: Executor, log: RunLog) -> None:
    """Move each trajectory that no loop ties to the first one to where it is found in the others, and tie it by loops.

    Frozen trajectories are searched, not moved. What is not found stays where it is, with a warning. Which nodes are
    searched does not depend on the executor, nor does the result.
    """
    placed, open_ = tied_parts(graph)
    while open_ and placed:
        joined = [part for part in open_ if _join(graph, part, placed, executor)]
        if not joined:
            break
        placed, open_ = tied_parts(graph)
    for part in open_:
        if not graph.parts[part].frozen:
            log.warn(
                f"trajectory {graph.parts[part].trajectory} was not found in the loaded map: it is kept beside it, "
                "unconnected unless landmarks tie it (do they overlap?)"
            )


def tied_parts(graph: PoseGraph2d) -> tuple[set[int], list[int]]:
    """Return the parts (their rows) that loops tie to the first one or that are frozen, and all others."""
    placed = {0} | {k for k, part in enumerate(graph.parts) if part.frozen}
    pairs = {(int(graph.submap_part[loop.submap]), int(graph.node_part[loop.node])) for loop in graph.loops}
    while True:
        more = {k for a, b in pairs for k in (a, b) if a in placed or b in placed} - placed
        if not more:
            return placed, [k for k in range(len(graph.parts)) if k not in placed]
        placed |= more


def _join(graph: PoseGraph2d, part: int, placed: set[int], executor: Executor) -> bool:
    """Search one part in the placed ones; move it and add the loops that agree if it is found."""
    nodes = np.flatnonzero(graph.node_part == part)
    submaps = [k for k in range(len(graph.submap)) if int(graph.submap_part[k]) in placed and _is_finished(graph, k)]
    if not len(nodes):
        return False
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(graph.node_local[nodes, :2], axis=0).T))])
    wanted = np.linspace(0.0, way[-1], min(_PROBES, len(nodes)) + 2)[1:-1]
    probes = np.unique(np.searchsorted(way, wanted))
    ways = {int(nodes[probe]): float(way[probe]) for probe in probes.tolist()}
    least = graph.parameters.constraint_builder.global_localization_min_score
    loops: list[Loop] = []
    # Every third probe first: they lie far apart, and often they are enough.
    for few in (probes[0::3], probes[1::3], probes[2::3]):
        trials = {submap: [Trial(int(nodes[k]), math.inf, math.pi, least) for k in few.tolist()] for submap in submaps}
        loops += [found.loop for found in search(graph, trials, executor, 0) if not found.rejected]
        agreeing = _most_agreeing(graph, loops, ways)
        if len({loops[k].node for k in agreeing}) >= _ENOUGH:
            break
    witnesses = {loops[k].node for k in agreeing}
    if not witnesses or (len(witnesses) == 1 and loops[agreeing[0]].score < least + _ALONE):
        return False
    move = _placements(graph, loops)[agreeing[0]]
    rows = graph.submap_part == part
    graph.submap[rows] = se2.compose(move, graph.submap[rows])
    graph.node[nodes] = se2.compose(move, graph.node[nodes])
    graph.loops += [loops[k] for k in agreeing]
    graph.optimise(graph.parameters.optimization_problem.ceres_solver_options.max_num_iterations)
    return True


def _most_agreeing(graph: PoseGraph2d, loops: list[Loop], ways: dict[int, float]) -> list[int]:
    """Return the loops that agree with the one that most nodes agree with, that one first."""
    if not loops:
        return []
    moves = _placements(graph, loops)
    groups = [_agreeing(graph, loops, moves, k, ways) for k in range(len(loops))]
    best = max(
        range(len(loops)),
        key=lambda k: (len({loops[j].node for j in groups[k]}), sum(loops[j].score for j in groups[k]), -k),
    )
    return [best, *(k for k in groups[best] if k != best)]


def _is_finished(graph: PoseGraph2d, submap: int) -> bool:
    part = int(graph.submap_part[submap])
    return bool(graph.parts[part].finished[submap - int(np.searchsorted(graph.submap_part, part))])


def _placements(graph: PoseGraph2d, loops: list[Loop]) -> NDArray[np.float64]:
    """Return float64 (L, 3), how each loop moves the node's trajectory in the map."""
    submaps, nodes = (np.array([getattr(loop, name) for loop in loops]) for name in ("submap", "node"))
    seen = se2.compose(graph.submap[submaps], np.array([loop.relative for loop in loops]))
    return se2.compose(seen, se2.inverse(graph.node[nodes]))


def _agreeing(
    graph: PoseGraph2d, loops: list[Loop], moves: NDArray[np.float64], k: int, ways: dict[int, float]
) -> list[int]:
    """Return the loops that say the same as loop k, with drift between their nodes; k is among them."""
    nodes = graph.node[np.array([loop.node for loop in loops])]
    error = se2.between(se2.compose(moves[k], nodes), se2.compose(moves, nodes))
    apart = np.abs(np.array([ways[loop.node] for loop in loops]) - ways[loops[k].node])
    near = np.hypot(error[:, 0], error[:, 1]) < _AGREE_M + _DRIFT * apart
    return np.flatnonzero(near & (np.abs(error[:, 2]) < _AGREE_RAD + _TURN * apart)).tolist()
