# SPDX-License-Identifier: MIT
"""Which nodes are looked for in which submaps, when the whole recording is known.

Batch work is free of the limits of real time (section V of Hess et al., ICRA 2016, searches each pair once, in the order
in which they come). Here pairs whose relative pose is known best are searched first, in windows as wide as the drift
between them; what is found is optimised, which narrows the windows of the others; and again until nothing is added.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.graph_2d import Loop, PoseGraph2d
from slamcli.cartographer.loop_search_2d import Found, Trial, search
from slamcli.geometry import se2
from slamcli.grids.submap_grid import SubmapGrid
from slamcli.posegraph.drift import Ways, relative_sigmas
from slamcli.runtime import RunLog

_SIGMAS = 3.0
_DOUBT = 4.0
"""Factor of the windows of the last search, for drift that is larger than the model says."""
_WINDOWS_M = (0.5, 1.0, 2.0, 4.0, 7.0, 14.0)
_LEAST_M, _LEAST_RAD = 0.1, 0.02
_SCOUTS, _SCOUTS_APART_M = 3, 1.0
_REPEATS = 3
_SURE_M = 1.0
"""Matches in windows up to this width need no second witness."""
_AGREE_M, _AGREE_RAD = 0.3, 0.05
_STRAINED_M, _STRAINED_RAD = 0.5, 0.1
_CLOSED_M, _CLOSED_RAD = 0.05, 0.01
"""How well two submaps are known to each other once a loop between them is closed."""


@dataclass(slots=True, eq=False)
class BatchClosing2d:
    """Finds loops in a graph and adjusts it, window by window."""

    graph: PoseGraph2d
    executor: Executor
    log: RunLog
    rejected: list[Found] = field(default_factory=list)
    num_trials: int = 0
    num_open: int = 0
    """Submaps at the end of the graph that scans are still drawn into: nothing is looked for in them."""
    _round: int = 0
    _sigmas_wide: float = _SIGMAS
    """Half width of windows in standard deviations."""
    _tried: dict[tuple[int, int], float] = field(default_factory=dict)
    """Widest window in which each pair of submaps was searched without success."""
    _failed: set[tuple[int, int]] = field(default_factory=set)
    """Pairs of submap and node that did not match where the graph says they should."""

    def run(self) -> None:
        """Close all loops that can be found; the graph is adjusted afterwards."""
        widest = self.graph.parameters.batch_search.widest_window
        for limit in (*(v for v in _WINDOWS_M if v < widest), widest):
            for _ in range(_REPEATS):
                if not self._add(self._scouts(limit, last=limit == widest)):
                    break
        self._sigmas_wide = _DOUBT * _SIGMAS
        while self._add(self._scouts(widest, last=True)):  # local SLAM may have drifted more than is usual
            pass
        self._sigmas_wide = _SIGMAS
        self._drop_strained()
        for _ in range(_REPEATS - 1):
            before = len(self.graph.loops)
            if self._add(self._everyone()) < 0.05 * before:
                break
        self._drop_strained()

    def _add(self, trials: dict[int, list[Trial]]) -> int:
        """Search, believe what holds, adjust the graph; returns the number of loops that were added."""
        if not trials:
            return 0
        self._round += 1
        self.num_trials += sum(len(part) for part in trials.values())
        found = search(self.graph, trials, self.executor, self._round)
        windows = {(submap, trial.node): trial.linear_m for submap, part in trials.items() for trial in part}
        self._failed |= windows.keys() - {(item.loop.submap, item.loop.node) for item in found if not item.rejected}
        believed = [item.loop for item in found if not item.rejected]
        alone = set() if not believed else self._without_witness(believed, windows)
        self.rejected += [item for item in found if item.rejected]
        self.rejected += [Found(loop, "no second match agrees") for k, loop in enumerate(believed) if k in alone]
        added = [loop for k, loop in enumerate(believed) if k not in alone]
        self.graph.loops += added
        if added:
            self.graph.optimise(self.graph.parameters.optimization_problem.ceres_solver_options.max_num_iterations)
        return len(added)

    def _scouts(self, limit: float, last: bool) -> dict[int, list[Trial]]:
        """Return a few nodes per pair of submaps that are not tied yet, where the window is not wider than the limit."""
        graph, b = self.graph, self.graph.parameters.constraint_builder
        tied = {(loop.submap, int(graph.home[loop.node])) for loop in graph.loops}
        trials = {}
        for submap, (nodes, linear, angular, distance) in self._candidates(limit, last).items():
            chosen = []
            for home in np.unique(graph.home[nodes]).tolist():
                part = np.flatnonzero(graph.home[nodes] == home)
                part = part[np.argsort(distance[part], kind="stable")]
                window = float(linear[part[0]])
                if (submap, home) in tied or self._tried.get((submap, home), 0.0) >= 0.9 * window:
                    continue
                self._tried[submap, home] = window
                picks = spread_out(graph.node_local[nodes[part], :2], _SCOUTS_APART_M, _SCOUTS)
                chosen += [
                    Trial(int(nodes[k]), float(linear[k]), float(angular[k]), b.min_score) for k in part[picks].tolist()
                ]
            if chosen:
                trials[submap] = chosen
        return trials

    def _everyone(self) -> dict[int, list[Trial]]:
        """Return all nodes near submaps, thinned by the sampling ratio, where little has to be searched."""
        graph, b = self.graph, self.graph.parameters.constraint_builder
        if b.sampling_ratio <= 0.0:
            return {}
        step = max(1, round(1.0 / b.sampling_ratio))
        done = {(loop.submap, loop.node) for loop in graph.loops} | self._failed
        trials = {}
        for submap, (nodes, linear, angular, _) in self._candidates(_SURE_M, False).items():
            chosen = [
                Trial(node, x, turn, b.min_score)
                for node, x, turn in zip(nodes.tolist(), linear.tolist(), angular.tolist(), strict=True)
                if (node + submap) % step == 0 and (submap, node) not in done
            ]
            if chosen:
                trials[submap] = chosen
        return trials

    def _candidates(
        self, limit: float, last: bool
    ) -> dict[int, tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]]:
        """Return by submap the nodes that may lie in it: rows, half windows in metres and radians, distances."""
        graph, b = self.graph, self.graph.parameters.constraint_builder
        window = self.graph.parameters.batch_search
        translation, rotation = self._sigmas()
        held = set(map(tuple, graph.membership.tolist()))
        frozen = np.array([part.frozen for part in graph.parts])
        everyone = np.arange(len(graph.node))
        found = {}
        for submap, grid in enumerate(graph.grids[: len(graph.grids) - self.num_open]):
            need = self._sigmas_wide * translation[submap, graph.home] + _LEAST_M
            linear = np.minimum(need, window.widest_window)
            angular = np.minimum(self._sigmas_wide * rotation[submap, graph.home] + _LEAST_RAD, window.widest_turn)
            distance = np.hypot(*(graph.node[:, :2] - graph.submap[submap, :2]).T)
            near = (distance < b.max_constraint_distance + linear) & np.isfinite(need)
            near &= last | (need <= limit)
            if frozen[graph.submap_part[submap]]:
                near &= ~frozen[graph.node_part]
            nodes = everyone[near]
            inside = _within(grid, graph.prior(submap, nodes), linear[nodes])
            nodes = np.array([n for n in nodes[inside].tolist() if (submap, n) not in held], dtype=np.int64)
            if len(nodes):
                found[submap] = (nodes, linear[nodes], angular[nodes], distance[nodes])
        return found

    def _sigmas(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return how uncertain submaps (S, S) are about each other: position and heading."""
        graph, search_ = self.graph, self.graph.parameters.batch_search
        first, second, translation, rotation = [], [], [], []
        begins = _first_nodes(graph)
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(graph.node_local[:, :2], axis=0).T))])
        turn = np.concatenate([[0.0], np.cumsum(np.abs(se2.wrap_angle(np.diff(graph.node_local[:, 2]))))])
        slack = np.concatenate([part.slack_m for part in graph.parts]) ** 2
        for s in np.flatnonzero(np.diff(graph.submap_part) == 0).tolist():
            a, b = begins[s], begins[s + 1]
            travelled, turned = abs(way[b] - way[a]), abs(turn[b] - turn[a])
            lost = float(slack[a + 1 : b + 1].sum())
            first.append(s)
            second.append(s + 1)
            translation.append(search_.drift_translation**2 * travelled + 0.01**2 + lost)
            rotation.append(search_.drift_rotation**2 * travelled + (0.01 * turned) ** 2 + 0.001**2 + 0.1 * lost)
        for submap, home in sorted({(loop.submap, int(graph.home[loop.node])) for loop in graph.loops}):
            if submap != home:
                first.append(submap)
                second.append(home)
                translation.append(_CLOSED_M**2)
                rotation.append(_CLOSED_RAD**2)
        a, b = np.array(first, dtype=np.int64), np.array(second, dtype=np.int64)
        return relative_sigmas(
            len(graph.submap),
            Ways(
                first=a, second=b, distance_m=np.hypot(*(graph.submap[b, :2] - graph.submap[a, :2]).T),
                translation_m2=np.array(translation), rotation_rad2=np.array(rotation),
            ),
        )  # fmt: skip

    def _without_witness(self, loops: Sequence[Loop], windows: dict[tuple[int, int], float]) -> set[int]:
        """Return which loops from wide windows no other loop nearby agrees with."""
        graph = self.graph
        everyone = [*loops, *graph.loops]
        by_pair: dict[tuple[int, int], list[int]] = {}
        for k, loop in enumerate(everyone):
            by_pair.setdefault((loop.submap, int(graph.home[loop.node])), []).append(k)
        alone = set()
        for k, loop in enumerate(loops):
            if windows[loop.submap, loop.node] <= _SURE_M:
                continue
            home = int(graph.home[loop.node])
            others = [
                j
                for i in (-1, 0, 1)
                for h in (-1, 0, 1)
                for j in by_pair.get((loop.submap + i, home + h), ())
                if j != k
            ]
            if not any(self._agree(loop, everyone[j]) for j in others):
                alone.add(k)
        return alone

    def _agree(self, one: Loop, other: Loop) -> bool:
        """Whether two loops between neighbouring submaps say the same, as far as they say it."""
        graph = self.graph
        if graph.submap_part[one.submap] != graph.submap_part[other.submap]:
            return False
        if graph.node_part[one.node] != graph.node_part[other.node]:
            return False
        T_one_other = se2.between(graph.submap_local[one.submap], graph.submap_local[other.submap])
        via = se2.compose(
            se2.compose(T_one_other, other.relative),
            se2.between(graph.node_local[other.node], graph.node_local[one.node]),
        )
        error = se2.between(one.relative, via)
        spread = one.covariance + other.covariance + _AGREE_M**2 * np.eye(2)
        return float(error[:2] @ np.linalg.solve(spread, error[:2])) < 1.0 and abs(error[2]) < _AGREE_RAD

    def _drop_strained(self) -> None:
        """Take out the loops that the rest of the graph contradicts, the worst first, in at most three rounds."""
        for _ in range(_REPEATS):
            distance, turn = self.graph.residuals()
            bad = (distance > _STRAINED_M) | (turn > _STRAINED_RAD)
            if not bad.any():
                return
            strain = np.maximum(distance / _STRAINED_M, turn / _STRAINED_RAD)
            worst = bad & (strain > 0.5 * strain.max())
            loops = self.graph.loops
            self.rejected += [
                Found(loop, "contradicts the graph") for loop, out in zip(loops, worst, strict=True) if out
            ]
            self.graph.loops = [loop for loop, out in zip(loops, worst, strict=True) if not out]
            self.graph.optimise(self.graph.parameters.optimization_problem.ceres_solver_options.max_num_iterations)


def spread_out(points: NDArray[np.float64], apart_m: float, most: int) -> list[int]:
    """Return rows of points (N, 2), from the first on, each at least `apart_m` from those before; at most `most`."""
    chosen: list[int] = []
    for k, point in enumerate(points):
        if all(math.hypot(*(point - points[j])) > apart_m for j in chosen):
            chosen.append(k)
            if len(chosen) == most:
                break
    return chosen


def _first_nodes(graph: PoseGraph2d) -> NDArray[np.int64]:
    """Return the row of the first node that each submap (S,) holds."""
    firsts = np.full(len(graph.submap), len(graph.node) - 1, dtype=np.int64)
    np.minimum.at(firsts, graph.membership[:, 0], graph.membership[:, 1])
    return firsts


def _within(grid: SubmapGrid, poses: NDArray[np.float64], margins: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which poses (K, 3) lie within a grid widened by margins (K,)."""
    rows, columns = grid.cells.shape
    low = np.array(grid.origin)
    high = low + np.array([columns, rows]) * grid.resolution_m
    return np.all((poses[:, :2] > low - margins[:, None]) & (poses[:, :2] < high + margins[:, None]), axis=1)
