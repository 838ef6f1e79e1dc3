# SPDX-License-Identifier: MIT
"""How well a planar pose graph knows its poses: marginal and relative covariances."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.posegraph.levenberg_marquardt import Descent
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.normal_equations import components
from slamcli.posegraph.planar import PlanarEdges, checked, held_poses, optimise_planar, rows, terms_of

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class PlanarCovariances:
    """The inverse of a graph's normal matrix, of which blocks are asked for.

    The graph is linearised and factorised once; the marginals of all poses then cost about as much as a factorisation,
    those of all poses relative to one as much as three solutions (2000 nodes: 0.2 ms). The unit is that of the edges'
    weights: 1 means one standard deviation only if they are inverse standard deviations.

    Parameters
    ----------
    poses : float64 (P, 3), the adjusted poses.
    fixed : bool (P,), poses taken as known; a component without one takes its first pose as known.
    edges : of the graph.
    weights : float64 (N,), how much each edge counts, as in :class:`~slamcli.posegraph.planar.PlanarSolution`.

    Raises
    ------
    EstimationError
        If the edges leave a pose undetermined that they connect with others.
    """

    def __init__(
        self, poses: Floats, fixed: NDArray[np.bool_], edges: PlanarEdges, weights: Floats | None = None
    ) -> None:
        self._poses = checked(poses, [edges])
        fixed = np.asarray(fixed, np.bool_)
        known = np.flatnonzero(fixed)
        joined = np.stack([known[:-1], known[1:]], axis=1)  # what is fixed is known relative to each other
        self._parts = components(len(poses), [rows(edges), joined])
        held = held_poses(fixed, [rows(edges)])
        term = terms_of(edges, Loss())
        descent = Descent([term], held, np.add)
        counts = np.ones(len(edges)) if weights is None else np.ascontiguousarray(weights, np.float64)
        descent.linearise(self._poses, [term.residuals(self._poses)], [counts])
        self._equations = descent.equations
        if not self._equations.factorise(np.zeros_like(self._equations.gradient)):
            raise EstimationError("the edges of the graph leave a pose undetermined: its normal matrix is singular")
        self.marginals: Floats = np.zeros((len(poses), 3, 3))
        """float64 (P, 3, 3), covariances of x, y, yaw along the map's axes, with the fixed poses known."""
        self.marginals[self._equations.variables] = self._equations.inverse_diagonal()

    def relative(self, first: int, others: Integers) -> Floats:
        """Return the covariances float64 (K, 3, 3) of the poses `others` seen from `first`: x, y, yaw along its axes.

        Poses that no edges connect with `first` get infinite variances.
        """
        others = np.asarray(others, np.int64)
        covariance = np.zeros((len(self._poses), 3, 3))  # of every pose with the first
        place = np.flatnonzero(self._equations.variables == first)
        if len(place):
            covariance[self._equations.variables] = self._equations.inverse_columns(int(place[0]))
        yaw = self._poses[first, 2]
        c, s = np.cos(yaw), np.sin(yaw)
        axes = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        seen = (self._poses[others] - self._poses[first]) @ axes.T
        by_first = np.tile(-axes, (len(others), 1, 1))
        by_first[:, 0, 2], by_first[:, 1, 2] = seen[:, 1], -seen[:, 0]
        cross = axes @ covariance[others] @ by_first.transpose(0, 2, 1)
        own = by_first @ self.marginals[first] @ by_first.transpose(0, 2, 1)
        result = axes @ self.marginals[others] @ axes.T + own + cross + cross.transpose(0, 2, 1)
        result[others == first] = 0.0
        result[self._parts[others] != self._parts[first]] = np.diag([np.inf] * 3)
        return result


def relative_covariances(
    poses: Floats, edges: PlanarEdges, first: int, others: Integers, *, weights: Floats | None = None
) -> Floats:
    """Return :meth:`PlanarCovariances.relative` of a graph of which nothing is known but its edges."""
    return PlanarCovariances(poses, np.arange(len(poses)) == first, edges, weights).relative(first, others)


def warm() -> None:
    """Compile the kernels of planar graphs with one of two poses."""
    one, poses, fixed = np.ones(1), np.zeros((2, 3)), np.array([True, False])
    edges = PlanarEdges(
        first=np.array([0]), second=np.array([1]), measured=np.ones((1, 3)), translation_weight=one, rotation_weight=one,
        robust=np.zeros(1, np.bool_),
    )  # fmt: skip
    optimise_planar(poses, fixed, edges, loss=Loss(), max_iterations=2)
    PlanarCovariances(poses, fixed, edges).relative(0, np.array([1]))
