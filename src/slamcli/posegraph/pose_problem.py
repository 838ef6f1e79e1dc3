# SPDX-License-Identifier: MIT
"""A graph of poses as GTSAM is given it, and what comes back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Method = Literal["levenberg", "gauss_newton", "dogleg"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseEdges:
    """E measured poses of one pose seen from another, as columns."""

    first: Integers
    """int64 (E,), row of a pose."""
    second: Integers
    """int64 (E,), row of the pose that is seen."""
    T_first_second: Floats
    """float64 (E, 4, 4)."""
    information: Floats
    """float64 (E, 6, 6), translation before rotation vector, along the axes of `first`."""
    robust: NDArray[np.bool_]
    """bool (E,): whether the edge may be wrong altogether."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseKnowledge:
    """K poses of which something is known without another pose, as columns."""

    row: Integers
    """int64 (K,)."""
    T_map_pose: Floats
    """float64 (K, 4, 4)."""
    information: Floats
    """float64 (K, 6, 6), as that of edges, along the axes of the map."""
    gravity: NDArray[np.bool_]
    """bool (K,): only which way is down is known, as well as `gravity_sigma` says."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GtsamSettings:
    """How it is minimised."""

    method: Method = "gauss_newton"
    iterations: int = 20
    epsilon: float = 1e-5
    """Decrease of the error at which it ends."""
    planar: bool = False
    """Only x, y and yaw are looked at and moved; the result lies in the plane."""
    gravity_sigma: float = 0.3
    """rad."""
    relinearise_threshold: float = 0.01
    """m and rad, of iSAM2."""
    relinearise_skip: int = 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseProblem:
    """A graph, all of it tied to its root."""

    keys: Integers
    """int64 (N,), distinct, not negative: the same pose has the same key in the next graph."""
    T_map_pose: Floats
    """float64 (N, 4, 4), where to begin."""
    root: int
    """Row that stays."""
    edges: PoseEdges
    known: PoseKnowledge


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseSolution:
    """The minimum."""

    T_map_pose: Floats
    """float64 (N, 4, 4), with the root where it was."""
    error_before: float
    """Half the sum of the weighted squares."""
    error_after: float
    iterations: int
    weights: Floats
    """float64 (E,), how much each edge counted in the end: 1 fully, 0 not at all."""


def check_problem(problem: PoseProblem) -> None:
    """Refuse a graph with numbers that are not finite.

    Raises
    ------
    EstimationError
        If there is one; the message names the edge.
    """
    for name, values in (
        ("pose", problem.T_map_pose), ("edge", problem.edges.T_first_second), ("information of edge", problem.edges.information)
    ):  # fmt: skip
        bad = np.flatnonzero(~np.isfinite(values).all(axis=(1, 2)))
        if len(bad):
            raise EstimationError(f"{name} {bad[0]} of the graph is not finite")
