# SPDX-License-Identifier: MIT
"""The search for nodes in submaps that they are not part of (Hess et al., ICRA 2016, V)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.graph_2d import Loop, PoseGraph2d
from slamcli.cartographer.parameters import ConstraintBuilder
from slamcli.geometry import se2
from slamcli.registration.branch_and_bound import PrecomputedGrids
from slamcli.registration.grid_matching import (
    LeastSquaresMatch,
    match_least_squares,
    mean_probability,
    position_spread,
)

_NEAR_M, _NEAR_RAD = 0.25, 0.05
"""Within such a window least squares find the match without a search."""
_MIN_POINTS = 10
_WIDEST_SPREAD_M = 3.0
_USELESS_M = 1.0
"""A match that is ambiguous by so much in every direction says nothing."""


@dataclass(frozen=True, slots=True)
class Trial:
    """A node to be looked for in a submap."""

    node: int
    linear_m: float
    """Half width of the window about where the node is believed to be; infinite for the whole submap."""
    angular_rad: float
    min_score: float


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What one trial found."""

    loop: Loop
    rejected: str
    """Why it is not believed; empty if it is."""


def search(
    graph: PoseGraph2d,
    trials: Mapping[int, Sequence[Trial]],
    executor: Executor,
    round_: int,
    *,
    ambiguity: bool = True,
) -> list[Found]:
    """Return what trials by submap (its row) found, by submap and in the order of the trials, whatever the executor.

    Without `ambiguity` every match counts in all directions alike, and that of the search before the refinement decides.
    """

    def work(submap: int) -> list[Found]:
        return _Searcher(graph, submap, round_, ambiguity).search(trials[submap])

    return [found for part in executor.map(work, sorted(trials)) for found in part]


class _Searcher:
    """Looks for nodes in one submap; its precomputed grids live as long as it does."""

    def __init__(self, graph: PoseGraph2d, submap: int, round_: int, ambiguity: bool) -> None:
        self._graph, self._submap, self._round, self._ambiguity = graph, submap, round_, ambiguity
        self._grid = graph.grids[submap]
        self._precomputed: PrecomputedGrids | None = None
        builder: ConstraintBuilder = graph.parameters.constraint_builder
        self._depth = builder.fast_correlative_scan_matcher.branch_and_bound_depth
        ceres = builder.ceres_scan_matcher
        self._match = LeastSquaresMatch(
            occupied_space_weight=ceres.occupied_space_weight,
            translation_weight=ceres.translation_weight,
            rotation_weight=ceres.rotation_weight,
            max_num_iterations=ceres.ceres_solver_options.max_num_iterations,
        )

    def search(self, trials: Sequence[Trial]) -> list[Found]:
        priors = self._graph.prior(self._submap, np.array([trial.node for trial in trials], dtype=np.int64))
        found = (self._try(trial, prior) for trial, prior in zip(trials, priors, strict=True))
        return [item for item in found if item is not None]

    def _try(self, trial: Trial, prior: NDArray[np.float64]) -> Found | None:
        points = self._graph.points[trial.node]
        if len(points) < _MIN_POINTS:
            return None
        start, near = prior, True
        if trial.linear_m > _NEAR_M or trial.angular_rad > _NEAR_RAD:
            coarse = self._coarse(points, prior, trial)
            if coarse is None:
                return None
            start, near = coarse, False
        pose, _ = match_least_squares(self._grid, points, start, start, self._match)
        score = mean_probability(self._grid, points, pose)
        if near and score < trial.min_score:
            return None
        relative = se2.between(self._graph.submap_local[self._submap], pose)
        if not self._ambiguity:
            return Found(Loop(self._submap, trial.node, relative, np.zeros((2, 2)), score, self._round), "")
        window = min(max(trial.linear_m, 1.0), _WIDEST_SPREAD_M)
        spread = position_spread(self._grid, points, pose, window)
        c, s = math.cos(relative[2]), math.sin(relative[2])
        axes = np.array([[c, -s], [s, c]])
        loop = Loop(self._submap, trial.node, relative, axes.T @ spread @ axes, score, self._round)
        if score < trial.min_score:
            return Found(loop, "score")
        if math.sqrt(float(np.linalg.eigvalsh(spread)[0])) > _USELESS_M:
            return Found(loop, "ambiguous")
        return Found(loop, "")

    def _coarse(
        self, points: NDArray[np.float64], prior: NDArray[np.float64], trial: Trial
    ) -> NDArray[np.float64] | None:
        if self._precomputed is None:
            self._precomputed = PrecomputedGrids(self._grid, self._depth)
        if math.isinf(trial.linear_m):
            best = self._precomputed.search_everywhere(points, min_score=trial.min_score)
        else:
            best = self._precomputed.search(
                points, prior, linear_m=trial.linear_m, angular_rad=trial.angular_rad, min_score=trial.min_score
            )
        return None if best is None else best[0]
