# SPDX-License-Identifier: MIT
"""Loop closure as it goes: a graph that grows, adjusted every so many nodes."""

from __future__ import annotations

from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.closing_2d import BatchClosing2d
from slamcli.cartographer.graph_2d import PoseGraph2d
from slamcli.cartographer.local_part_2d import trajectory_part
from slamcli.cartographer.local_slam_2d import LocalSlam2d
from slamcli.cartographer.odometry_terms_2d import odometry_term
from slamcli.cartographer.online_closing_2d import OnlineClosing2d
from slamcli.cartographer.parameters import PoseGraph
from slamcli.geometry import se2
from slamcli.runtime import RunLog


class LiveClosing2d:
    """Searches loops between what is there after every ``optimize_every_n_nodes`` nodes, and adjusts the graph.

    With ``batch_search`` windows are as wide as the drift, and loops are checked against each other, as for whole
    recordings: pairs of submaps that were searched before are not searched again. Without it nodes and submaps are searched
    as the original does it. What comes after an adjustment moves along with the newest submap that it knew. The original
    works in the background, and its adjustments come late by as much as they take; here they come at once.
    """

    def __init__(self, parameters: PoseGraph, executor: Executor, log: RunLog) -> None:
        self._parameters, self._executor, self._log = parameters, executor, log
        self._closing: BatchClosing2d | OnlineClosing2d | None = None
        self._pairs: list[tuple[int, int]] = []
        self._num_finished, self._since = 0, 0
        self.T_map_local = np.zeros(3)

    def add(self, local: LocalSlam2d, slack_m: list[float], wheels: list[NDArray[np.float64]] | None) -> bool:
        """Take the newest node of local SLAM; returns whether the graph was adjusted.

        `slack_m` is that of all scans, see `trajectory_part`; `wheels` are the poses (3,) that the odometry has at the
        nodes, None without odometry.
        """
        node = len(local.nodes) - 1
        if not self._parameters.batch_search.enabled:
            finished = _num_finished(local)
            self._pairs += [(submap, node) for submap in range(self._num_finished)]
            self._pairs += [(s, n) for s in range(self._num_finished, finished) for n in range(node + 1)]
            self._num_finished = finished
        self._since += 1
        if not self._since > self._parameters.optimize_every_n_nodes > 0:
            return False
        graph = self._adjust(local, slack_m, wheels).graph
        self.T_map_local = np.asarray(se2.compose(graph.submap[-1], se2.inverse(graph.submap_local[-1])))
        self._since = 0
        return True

    def end(
        self, local: LocalSlam2d, slack_m: list[float], wheels: list[NDArray[np.float64]] | None
    ) -> BatchClosing2d | OnlineClosing2d:
        """Search once more, with all submaps; returns what was found, with the graph."""
        return self._adjust(local, slack_m, wheels)

    def submaps(self, local: LocalSlam2d) -> NDArray[np.float64]:
        """Return how each submap's local frame lies in the map so far, float64 (S, 3): ``T_map_submap @ inverse(T_local_submap)``."""
        poses = np.tile(self.T_map_local, (len(local.submaps.all), 1))
        if self._closing is not None:
            graph = self._closing.graph
            poses[: len(graph.submap)] = se2.compose(graph.submap, se2.inverse(graph.submap_local))
        return poses

    def _adjust(
        self, local: LocalSlam2d, slack_m: list[float], wheels: list[NDArray[np.float64]] | None
    ) -> BatchClosing2d | OnlineClosing2d:
        graph = self._grown(local, slack_m)
        if self._parameters.optimization_problem.odometry_term == "always" and wheels and len(wheels) > 1:
            graph.add_terms([odometry_term(graph, np.array(wheels))], np.zeros((0, 3)))
        with self._log.stage("loop closure"):
            closing = self._closing = self._searched(graph, len(graph.grids) - _num_finished(local))
            if graph.loops or graph.more:
                graph.optimise(self._parameters.optimization_problem.ceres_solver_options.max_num_iterations)
        return closing

    def _searched(self, graph: PoseGraph2d, num_open: int) -> BatchClosing2d | OnlineClosing2d:
        """Look for loops in a graph whose last `num_open` submaps are still drawn into."""
        if self._parameters.batch_search.enabled:
            batch = self._closing if isinstance(self._closing, BatchClosing2d) else None
            batch = batch or BatchClosing2d(graph, self._executor, self._log)
            batch.graph, batch.num_open = graph, num_open
            batch.run()
            return batch
        online = self._closing if isinstance(self._closing, OnlineClosing2d) else None
        online = online or OnlineClosing2d(graph, self._executor, self._log)
        online.graph = graph
        online.search(self._pairs)
        self._pairs = []
        return online

    def _grown(self, local: LocalSlam2d, slack_m: list[float]) -> PoseGraph2d:
        """Return the graph of all there is, what was adjusted before where it was put."""
        graph = PoseGraph2d(self._parameters, [trajectory_part(local, np.array(slack_m), 0)])
        graph.submap = np.asarray(se2.compose(self.T_map_local, graph.submap_local))
        graph.node = np.asarray(se2.compose(self.T_map_local, graph.node_local))
        if self._closing is not None:
            before = self._closing.graph
            graph.submap[: len(before.submap)], graph.node[: len(before.node)] = before.submap, before.node
            graph.loops = before.loops
        return graph


def _num_finished(local: LocalSlam2d) -> int:
    """Return how many submaps nothing is drawn into any more: they are the first ones."""
    return sum(submap.finished for submap in local.submaps.all)
