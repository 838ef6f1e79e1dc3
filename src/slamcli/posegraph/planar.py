# SPDX-License-Identifier: MIT
"""Sparse pose adjustment in the plane (Konolige et al., IROS 2010; Hess et al., ICRA 2016, V-A)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.posegraph import _planar_kernels as kernels
from slamcli.posegraph.graph_checks import check_graph
from slamcli.posegraph.levenberg_marquardt import Terms, minimise
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.normal_equations import components

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanarEdges:
    """N measured poses of one pose seen from another, a struct of arrays.

    The residual of an edge is W e, with e = (x, y, yaw of `second` seen from `first`) - `measured`, its translation along
    the axes of `first`. W is diag(translation weight, translation weight, rotation weight) as in Cartographer, or, with
    `information` Ω, a root of Ω whose translation lies along the axes of the *measured* second pose, as g2o defines it.
    """

    first: Integers
    """int64 (N,), index of a pose: of a submap, a node, or a frame that is estimated as well."""
    second: Integers
    """int64 (N,), index of the pose that is seen: a node or a landmark."""
    measured: Floats
    """float64 (N, 3), x, y, yaw of the second in the first; metres, radians."""
    translation_weight: Floats
    """float64 (N,), 1/m: multiplies the residual."""
    rotation_weight: Floats
    """float64 (N,), 1/rad."""
    robust: NDArray[np.bool_]
    """bool (N,): whether the loss applies; without, the residual is squared."""
    information: Floats | None = None
    """float64 (N, 3, 3), symmetric and positive semidefinite: instead of the weights."""
    until: Integers | None = None
    """int64 (N,): the observer is `ratio` of the way from `first` to this pose, as when a landmark is seen between two
    nodes."""
    ratio: Floats | None = None
    """float64 (N,), 0 to 1; with `until` only."""

    def __len__(self) -> int:
        return len(self.first)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanarSolution:
    """The adjusted poses."""

    poses: Floats
    """float64 (P, 3), yaw between -pi and pi."""
    cost_before: float
    """Half the sum of the losses."""
    cost_after: float
    iterations: int
    converged: bool
    residual_norms: Floats
    """float64 (N,), norm of each edge's weighted residual at the end."""
    weights: Floats
    """float64 (N,), how much each edge counted in the end: 1 fully, 0 not at all."""
    held: NDArray[np.bool_]
    """bool (P,), poses that did not move: fixed ones, and the first of each component that has none."""


def optimise_planar(
    poses: Floats,
    fixed: NDArray[np.bool_],
    edges: PlanarEdges,
    *,
    loss: Loss,
    max_iterations: int,
    more: Sequence[tuple[PlanarEdges, Loss]] = (),
    tolerance: float = 1e-6,
) -> PlanarSolution:
    """Return the poses that minimise half the sum of the losses of all edges.

    Parameters
    ----------
    poses : float64 (P, 3), where to begin: x, y, yaw of submaps, nodes, landmarks and estimated frames, in any order.
    fixed : bool (P,), poses that must not move. A component of the graph without one keeps its first pose where it is.
    edges : between the poses.
    loss : of the edges that are `robust`.
    max_iterations : of each round of the descent.
    more : further edges with a loss of their own, as landmarks and fixed-frame poses have in Cartographer.
    tolerance : relative decrease of the cost at which it has converged.

    Raises
    ------
    EstimationError
        If a number is not finite or an index names no pose; the message names the edge.

    References
    ----------
    .. [1] K. Konolige et al.: Efficient Sparse Pose Adjustment for 2D Mapping, IROS 2010, doi:10.1109/IROS.2010.5649043.
    .. [2] W. Hess et al.: Real-Time Loop Closure in 2D LIDAR SLAM, ICRA 2016, doi:10.1109/ICRA.2016.7487258, equation 5.
    """
    groups = [(edges, loss), *more]
    poses = checked(poses, [group for group, _ in groups])
    held = held_poses(np.asarray(fixed, np.bool_), [rows(group) for group, _ in groups])
    terms = [terms_of(group, of) for group, of in groups]
    minimum = minimise(poses, terms, held, np.add, max_iterations, tolerance)
    result = minimum.state.copy()
    result[~held, 2] = np.remainder(result[~held, 2] + math.pi, 2 * math.pi) - math.pi
    return PlanarSolution(
        poses=result, cost_before=minimum.cost_before, cost_after=minimum.cost_after, iterations=minimum.iterations,
        converged=minimum.converged, residual_norms=minimum.norms[0], weights=minimum.weights[0], held=held,
    )  # fmt: skip


def rows(edges: PlanarEdges) -> Integers:
    """Return the variables of each edge, int64 (N, 3): from, until (-1 for none), seen."""
    until = np.full(len(edges), -1) if edges.until is None else edges.until
    return np.stack([edges.first, until, edges.second], axis=1).astype(np.int64)


def held_poses(fixed: NDArray[np.bool_], rows: Sequence[Integers]) -> NDArray[np.bool_]:
    """Return which poses to hold: the fixed ones and the first pose of every component of the graph that has no fixed one."""
    parts = components(len(fixed), rows)
    count = int(parts.max(initial=-1)) + 1
    anchored = np.zeros(count, np.bool_)
    anchored[parts[fixed]] = True
    firsts = np.full(count, len(fixed), np.int64)
    np.minimum.at(firsts, parts, np.arange(len(fixed)))
    held = fixed.copy()
    held[firsts[~anchored]] = True
    return held


def checked(poses: Floats, groups: Sequence[PlanarEdges]) -> Floats:
    """Return the poses as a contiguous copy, if all input is usable."""
    poses = np.array(poses, np.float64, order="C")
    check_graph(poses, groups)
    return poses


def _whitening(edges: PlanarEdges) -> Floats:
    """The matrices W float64 (N, 3, 3)."""
    matrices = np.zeros((len(edges), 3, 3))
    if edges.information is None:
        matrices[:, 0, 0] = matrices[:, 1, 1] = edges.translation_weight
        matrices[:, 2, 2] = edges.rotation_weight
        return matrices
    values, vectors = np.linalg.eigh(edges.information)  # a root also where a direction has no information
    roots = np.sqrt(np.maximum(values, 0.0))[:, :, None] * vectors.transpose(0, 2, 1)
    c, s = np.cos(edges.measured[:, 2]), np.sin(edges.measured[:, 2])
    matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 0], matrices[:, 1, 1] = c, s, -s, c
    matrices[:, 2, 2] = 1.0
    return np.ascontiguousarray(roots @ matrices)


def terms_of(edges: PlanarEdges, loss: Loss) -> Terms:
    """Return the edges as residuals of the descent."""
    variables = rows(edges)
    observed = np.where(variables < 0, variables[:, :1], variables)
    measured = np.ascontiguousarray(edges.measured, np.float64).reshape(-1, 3)
    ratio = np.zeros(len(edges)) if edges.ratio is None else np.ascontiguousarray(edges.ratio, np.float64)
    whitening = _whitening(edges)

    def residuals(poses: Floats) -> Floats:
        out = np.empty((len(edges), 3))
        kernels.residuals(poses, observed, ratio, measured, whitening, out)
        return out

    def jacobians(poses: Floats) -> Floats:
        out = np.empty((len(edges), 3, 9))
        kernels.jacobians(poses, observed, ratio, whitening, out)
        return out

    robust = np.ascontiguousarray(edges.robust, np.bool_)
    return Terms(variables=variables, residuals=residuals, jacobians=jacobians, loss=loss, robust=robust)
