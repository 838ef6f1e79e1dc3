# SPDX-License-Identifier: MIT
"""Which nodes are looked for in which submaps as the original does it: each once, in the order in which they come."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass, field

import numpy as np

from slamcli.cartographer.graph_2d import PoseGraph2d, TrajectoryPart
from slamcli.cartographer.joining_2d import tied_parts
from slamcli.cartographer.loop_search_2d import Found, Trial, search
from slamcli.geometry import se2
from slamcli.runtime import RunLog


@dataclass(slots=True)
class FixedRatioSampler:
    """Lets a fixed share of what comes pass, spread evenly, without chance."""

    ratio: float
    num_pulses: int = 0
    num_passed: int = 0

    def pulse(self) -> bool:
        """Count one more and return whether it passes."""
        self.num_pulses += 1
        passes = self.num_passed < self.ratio * self.num_pulses
        self.num_passed += passes
        return passes


@dataclass(slots=True, eq=False)
class OnlineClosing2d:
    """Finds loops node by node (Hess et al., ICRA 2016, V), adjusting what is known from time to time.

    Each new node is looked for in all finished submaps, each newly finished submap is searched for all earlier nodes, in
    whole windows; every match counts, in all directions alike. Searches between two adjustments start from the same poses
    and run in parallel, and all of them end before the next adjustment, so that results do not depend on threads.
    """

    graph: PoseGraph2d
    executor: Executor
    log: RunLog
    rejected: list[Found] = field(default_factory=list)
    """Stays empty: a match that reaches the least score is believed."""
    num_trials: int = 0
    _round: int = 0
    _samplers: dict[int, FixedRatioSampler] = field(default_factory=dict)
    """By the submap's row."""

    def run(self) -> None:
        """Go through the nodes of the last trajectory; the last adjustment is left to the caller."""
        graph = self.graph
        part, own = graph.parts[-1], len(graph.parts) - 1
        placed, _ = tied_parts(graph)
        nearby = np.array([k == own or (own in placed and k in placed) for k in range(len(graph.parts))])
        first_node, first_submap = len(graph.node) - len(part.node_ids), len(graph.submap) - len(part.submap_ids)
        finishing = _finishing(part)
        finished, pairs, since = np.flatnonzero(nearby[graph.submap_part[:first_submap]]).tolist(), [], 0
        others = np.flatnonzero(nearby[graph.node_part[:first_node]]).tolist()
        for k in range(len(part.node_ids)):
            new = [first_submap + row for row in finishing.get(k, ())]
            pairs += [(submap, first_node + k) for submap in finished]
            pairs += [(submap, node) for submap in new for node in (*others, *range(first_node, first_node + k + 1))]
            finished += new
            since += 1
            if since > graph.parameters.optimize_every_n_nodes > 0:
                self.search(pairs)
                begun = max(row for held in part.members[: k + 1] for row in held) + 1
                self._optimise(first_submap + begun, first_node + k + 1)
                pairs, since = [], 0
        self.search(pairs)

    def search(self, pairs: list[tuple[int, int]]) -> None:
        """Look for nodes in submaps, pairs of rows, of which distance and sampling leave some."""
        graph, b = self.graph, self.graph.parameters.constraint_builder
        window, held = b.fast_correlative_scan_matcher, set(map(tuple, graph.membership.tolist()))
        trials: dict[int, list[Trial]] = {}
        for submap, node in pairs:
            dx, dy = graph.node[node, :2] - graph.submap[submap, :2]
            if (submap, node) in held or np.hypot(dx, dy) > b.max_constraint_distance:
                continue
            if self._samplers.setdefault(submap, FixedRatioSampler(b.sampling_ratio)).pulse():
                trial = Trial(node, window.linear_search_window, window.angular_search_window, b.min_score)
                trials.setdefault(submap, []).append(trial)
        if trials:
            self._round += 1
            self.num_trials += sum(len(part) for part in trials.values())
            found = search(graph, trials, self.executor, self._round, ambiguity=False)
            graph.loops += [item.loop for item in found]

    def _optimise(self, submaps: int, nodes: int) -> None:
        """Adjust what the first submaps and nodes know; what comes after moves along with the newest of these submaps."""
        graph = self.graph
        known = np.concatenate(
            [
                np.arange(len(graph.submap)) < submaps,
                np.arange(len(graph.node)) < nodes,
                np.ones(len(graph.extra), np.bool_),
            ]
        )
        graph.optimise(graph.parameters.optimization_problem.ceres_solver_options.max_num_iterations, known)
        newest = submaps - 1
        T_map_local = se2.compose(graph.submap[newest], se2.inverse(graph.submap_local[newest]))
        graph.submap[submaps:] = se2.compose(T_map_local, graph.submap_local[submaps:])
        graph.node[nodes:] = se2.compose(T_map_local, graph.node_local[nodes:])


def _finishing(part: TrajectoryPart) -> dict[int, list[int]]:
    """Return which submaps, rows in the part, are finished with each node; those that the last node found open never are."""
    last: dict[int, int] = {row: node for node, held in enumerate(part.members) for row in held}
    finishing: dict[int, list[int]] = {}
    for row in sorted(last):
        if last[row] < len(part.members) - 1:
            finishing.setdefault(last[row], []).append(row)
    return finishing
