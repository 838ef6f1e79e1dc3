# SPDX-License-Identifier: MIT
"""Pose graphs in the plane and in space by GTSAM: in one go, or by increments (iSAM2)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.posegraph.gtsam_factors import fingerprints, library, pose_factors, pose_values, solved_poses
from slamcli.posegraph.pose_problem import GtsamSettings, Method, PoseProblem, PoseSolution, check_problem

Floats = NDArray[np.float64]

INLIER_PROBABILITY = 0.99
"""Share of right edges that errors of their size leave in, where edges may be wrong."""


def optimise_poses(problem: PoseProblem, settings: GtsamSettings) -> PoseSolution:
    """Return the poses that agree best with the edges.

    Parameters
    ----------
    problem
        Weak directions of the information are held by nothing: give them a little.

    Raises
    ------
    EstimationError
        If GTSAM cannot solve it; the message says what it said.

    Notes
    -----
    Where Gauss and Newton's steps or those of the dogleg lead upwards, Levenberg's are taken. Edges that may be wrong are
    sorted by graduated non-convexity with a truncated loss (Yang et al., RA-L 2020, doi:10.1109/LRA.2020.2965893), which
    asks for no good start; the switchable constraints of Vertigo, which RTAB-Map has, drop right closures of a long drift.
    """
    gtsam = library()
    check_problem(problem)
    graph = gtsam.NonlinearFactorGraph()
    for factor in pose_factors(problem, settings):
        graph.push_back(factor)
    values = pose_values(problem, np.arange(len(problem.keys)), settings.planar)
    before = float(graph.error(values))
    weights = np.ones(len(problem.edges.first))
    if problem.edges.robust.any():
        result, weights = _sorted_out(graph, values, settings, problem.edges.robust)
        kept = gtsam.NonlinearFactorGraph()
        for row in range(graph.size()):
            if row >= len(weights) or weights[row] > 0.5:
                kept.push_back(graph.at(row))
        graph, values = kept, result
    result, after, iterations = _descended(graph, values, settings)
    return PoseSolution(
        T_map_pose=solved_poses(problem, result, settings.planar), error_before=before, error_after=after,
        iterations=iterations, weights=weights,
    )  # fmt: skip


def _descended(graph: Any, values: Any, settings: GtsamSettings) -> tuple[Any, float, int]:
    """Return the values at the minimum, their error and the number of steps, by Levenberg's steps where others fail."""
    before = float(graph.error(values))
    try:
        found = _minimised(graph, values, settings, settings.method)
        if settings.method == "levenberg" or found[1] <= before * (1.0 + 1e-9) + 1e-9:
            return found
    except RuntimeError as said:
        if settings.method == "levenberg":
            raise _unsolved(said) from None
    try:
        return _minimised(graph, values, settings, "levenberg")
    except RuntimeError as said:
        raise _unsolved(said) from None


def _sorted_out(graph: Any, values: Any, settings: GtsamSettings, robust: NDArray[np.bool_]) -> tuple[Any, Floats]:
    """Return the values that the right edges agree on, and the weights (E,) of all."""
    gtsam = library()
    lm = settings.method == "levenberg"
    inner: Any = gtsam.LevenbergMarquardtParams() if lm else gtsam.GaussNewtonParams()
    inner.setMaxIterations(settings.iterations)
    told: Any = gtsam.GncLMParams(inner) if lm else gtsam.GncGaussNewtonParams(inner)
    trusted = np.ones(graph.size(), np.bool_)
    trusted[: len(robust)] = ~robust
    told.setKnownInliers(np.flatnonzero(trusted).tolist())
    told.setLossType(gtsam.GncLossType.TLS)
    run = (gtsam.GncLMOptimizer if lm else gtsam.GncGaussNewtonOptimizer)(graph, values, told)
    run.setInlierCostThresholdsAtProbability(INLIER_PROBABILITY)
    try:
        result = run.optimize()
    except RuntimeError as said:
        raise _unsolved(said) from None
    return result, np.array(run.getWeights(), np.float64)[: len(robust)]


class IncrementalPoses:
    """A graph that grows: poses and edges that it has are kept, with what was solved so far (Kaess et al., IJRR 2012).

    All edges count: where some may be wrong, :func:`optimise_poses` has to look at the whole.
    """

    def __init__(self, settings: GtsamSettings) -> None:
        self._settings = settings
        self._clear()

    def _clear(self) -> None:
        gtsam = library()
        parameters = gtsam.ISAM2Params()
        inner = gtsam.ISAM2DoglegParams() if self._settings.method == "dogleg" else gtsam.ISAM2GaussNewtonParams()
        parameters.setOptimizationParams(inner)
        parameters.setRelinearizeThreshold(self._settings.relinearise_threshold)
        parameters.relinearizeSkip = self._settings.relinearise_skip
        self._isam = gtsam.ISAM2(parameters)
        self._keys: set[int] = set()
        self._known: dict[bytes, int] = {}
        """What each factor is made of, and its place in GTSAM's list."""
        self._root = -1

    def optimise(self, problem: PoseProblem) -> PoseSolution:
        """Return the poses that agree best with the edges, from those of the last call where they were in it.

        Edges that are gone are taken out. Where a pose is gone or another is the root all begins anew.

        Raises
        ------
        EstimationError
            If GTSAM cannot solve it; the next call begins anew.
        """
        gtsam = library()
        check_problem(problem)
        keys = problem.keys.tolist()
        if not self._keys <= set(keys) or self._root != keys[problem.root]:
            self._clear()
            self._root = keys[problem.root]
        made_of = fingerprints(problem)
        wanted = set(made_of)
        gone = [print_ for print_ in self._known if print_ not in wanted]
        fresh = [row for row, print_ in enumerate(made_of) if print_ not in self._known]
        graph = gtsam.NonlinearFactorGraph()
        for factor in pose_factors(problem, self._settings, fresh):
            graph.push_back(factor)
        new = np.array([row for row, key in enumerate(keys) if key not in self._keys], np.int64)
        values = pose_values(problem, new, self._settings.planar)
        start = pose_values(problem, np.arange(len(keys)), self._settings.planar)
        try:
            done = self._isam.update(graph, values, [self._known[print_] for print_ in gone])
            steps = 1
            for _ in range(self._settings.iterations - 1):
                if done.getVariablesRelinearized() == 0:
                    break
                steps += 1
                if self._isam.update().getVariablesRelinearized() == 0:
                    break
            result = self._isam.calculateBestEstimate()
        except RuntimeError as said:
            self._clear()
            raise _unsolved(said) from None
        places = done.getNewFactorsIndices()
        for print_ in gone:
            del self._known[print_]
        self._known.update({made_of[row]: int(place) for row, place in zip(fresh, places, strict=True)})
        self._keys = set(keys)
        graph = self._isam.getFactorsUnsafe()
        return PoseSolution(
            T_map_pose=solved_poses(problem, result, self._settings.planar), error_before=float(graph.error(start)),
            error_after=float(graph.error(result)), iterations=steps, weights=np.ones(len(problem.edges.first)),
        )  # fmt: skip


def _unsolved(said: RuntimeError) -> EstimationError:
    line = " ".join(str(said).split())
    return EstimationError(f"GTSAM could not solve the graph of poses: {line[:200]}")


def _minimised(graph: Any, values: Any, settings: GtsamSettings, method: Method) -> tuple[Any, float, int]:
    """Return the values, their error and the number of steps."""
    gtsam = library()
    parameters, optimiser = {
        "levenberg": (gtsam.LevenbergMarquardtParams, gtsam.LevenbergMarquardtOptimizer),
        "gauss_newton": (gtsam.GaussNewtonParams, gtsam.GaussNewtonOptimizer),
        "dogleg": (gtsam.DoglegParams, gtsam.DoglegOptimizer),
    }[method]
    told = parameters()
    told.setMaxIterations(settings.iterations)
    told.setAbsoluteErrorTol(settings.epsilon)
    told.setRelativeErrorTol(0.0)
    run = optimiser(graph, values, told)
    result = run.optimize()
    return result, float(run.error()), int(run.iterations())
