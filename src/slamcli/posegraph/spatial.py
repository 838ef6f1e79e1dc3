# SPDX-License-Identifier: MIT
"""Sparse pose adjustment in space with what an IMU says (Konolige et al., IROS 2010; Hess et al., ICRA 2016, V-A)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion
from slamcli.posegraph import _spatial_kernels as kernels
from slamcli.posegraph.graph_checks import check_graph
from slamcli.posegraph.inertial import Inertia, check_inertia, inertial_terms
from slamcli.posegraph.levenberg_marquardt import Terms, minimise
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.normal_equations import components

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
YAW_AND_PLACE = np.array([0, 1, 2, 5])  # what a graph without gravity's direction, or with it, cannot know


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpatialEdges:
    """N measured poses of one pose seen from another, a struct of arrays.

    The residual of an edge is W e, with e = (translation of `second` seen from `first` minus the measured one, along the
    axes of `first`; rotation vector from the measured rotation to the seen one). W is diag(translation weight three
    times, rotation weight three times) as in Cartographer, or, with `information` Ω, a root of Ω whose translation lies
    along the axes of the *measured* second pose.
    """

    first: Integers
    """int64 (N,), index of a pose: of a submap, a node, or a frame that is estimated as well."""
    second: Integers
    """int64 (N,), index of the pose that is seen: a node or a landmark."""
    measured: Floats
    """float64 (N, 7), x, y, z in metres and quaternion xyzw of the second in the first."""
    translation_weight: Floats
    """float64 (N,), 1/m: multiplies the residual."""
    rotation_weight: Floats
    """float64 (N,), 1/rad."""
    robust: NDArray[np.bool_]
    """bool (N,): whether the loss applies; without, the residual is squared."""
    information: Floats | None = None
    """float64 (N, 6, 6), translation before rotation, symmetric and positive semidefinite: instead of the weights."""
    until: Integers | None = None
    """int64 (N,): the observer is `ratio` of the way from `first` to this pose, as when a landmark is seen between two
    nodes."""
    ratio: Floats | None = None
    """float64 (N,), 0 to 1; with `until` only."""

    def __len__(self) -> int:
        return len(self.first)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpatialSolution:
    """The adjusted poses."""

    poses: Floats
    """float64 (P, 7)."""
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
    """bool (P, 6), what of each pose did not move."""
    gravity_m_s2: Floats
    """float64 (I,), by IMU."""
    extrinsics_xyzw: Floats
    """float64 (I, 4), rotations from each IMU's axes to those of its nodes."""


def optimise_spatial(
    poses: Floats,
    fixed: NDArray[np.bool_],
    edges: SpatialEdges,
    *,
    loss: Loss,
    max_iterations: int,
    more: Sequence[tuple[SpatialEdges, Loss]] = (),
    inertia: Inertia | None = None,
    tolerance: float = 1e-6,
) -> SpatialSolution:
    """Return the poses that minimise half the sum of the losses of all edges and of the IMU's residuals.

    Parameters
    ----------
    poses : float64 (P, 7), where to begin: x, y, z, quaternion xyzw of submaps, nodes, landmarks and estimated frames.
    fixed : bool (P,), poses that must not move, or (P, 6), their translation along and rotation about the map's x, y, z:
        z of all poses for Cartographer's fix_z_in_3d, rotation about x and y for a fixed frame that is estimated in yaw
        only. A component of the graph in which no pose has its place and yaw fixed keeps those of its first pose, and
        without an IMU also that pose's roll and pitch.
    edges : between the poses.
    loss : of the edges that are `robust`.
    max_iterations : of each round of the descent.
    more : further edges with a loss of their own, as landmarks and fixed-frame poses have in Cartographer.
    inertia : what IMUs say between nodes.
    tolerance : relative decrease of the cost at which it has converged.

    Raises
    ------
    EstimationError
        If a number is not finite or an index names no pose; the message names the edge.

    Notes
    -----
    Poses move by a translation and a left-multiplied rotation vector in the map's axes: with observer R, t and seen pose
    S, s the derivatives of R'(s - t) by them are -R', R'[s - t]x, R' and 0, those of log(M'R'S) are 0, -J S', 0 and J S',
    with J the inverse right Jacobian of the exponential at the error (Solà et al., arXiv:1812.01537, 143 and 144).
    """
    groups = [(edges, loss), *more]
    poses = _checked(poses, [group for group, _ in groups])
    state, count = poses, len(poses)
    terms = [_terms(group, of) for group, of in groups]
    if inertia is not None:
        check_inertia(inertia, count)
        state = np.concatenate([poses, inertia.rows()])
        terms += inertial_terms(inertia, count)
    held = _held(np.asarray(fixed, np.bool_), count, terms, inertia)
    minimum = minimise(state, terms, held.reshape(-1, 3), _retract, max_iterations, tolerance, together=2)
    return SpatialSolution(
        poses=minimum.state[:count].copy(), cost_before=minimum.cost_before, cost_after=minimum.cost_after,
        iterations=minimum.iterations, converged=minimum.converged, residual_norms=minimum.norms[0],
        weights=minimum.weights[0], held=held[:count], gravity_m_s2=minimum.state[count:, 0].copy(),
        extrinsics_xyzw=minimum.state[count:, 3:].copy(),
    )  # fmt: skip


def _retract(state: Floats, steps: Floats) -> Floats:
    moved = np.empty_like(state)
    kernels.retract(state, steps, moved)
    return moved


def _held(fixed: NDArray[np.bool_], count: int, terms: Sequence[Terms], inertia: Inertia | None) -> NDArray[np.bool_]:
    """Return what is held of each row of the state, bool (P + I, 6): what is fixed, and the freedom of the whole."""
    imus = 0 if inertia is None else len(inertia.gravity_m_s2)
    held = np.zeros((count + imus, 6), np.bool_)
    held[:count] = fixed if fixed.ndim == 2 else fixed[:, None]
    rows = [np.where(term.variables < 0, -1, term.variables // 2) for term in terms]
    apart = [np.where(row < count, row, -1) for row in rows]  # an IMU alone does not tell two places apart
    parts = components(count, apart)
    size = int(parts.max(initial=-1)) + 1
    anchored, level = np.zeros(size, np.bool_), np.zeros(size, np.bool_)
    anchored[parts[held[:count][:, YAW_AND_PLACE].all(axis=1)]] = True
    level[parts[held[:count][:, 3:].all(axis=1)]] = True
    if inertia is not None:
        level[parts[inertia.acceleration_nodes.ravel()]] = True
    firsts = np.full(size, count, np.int64)
    np.minimum.at(firsts, parts, np.arange(count))
    held[firsts[~anchored][:, None], YAW_AND_PLACE] = True
    tilted = firsts[~anchored & ~level]
    held[tilted[:, None], np.array([3, 4])] = True
    if inertia is not None:
        held[count:, 1:3] = True
        held[count:, 0] = not inertia.estimate_gravity
        held[count:, 3:] = not inertia.estimate_extrinsics
    return held


def _checked(poses: Floats, groups: Sequence[SpatialEdges]) -> Floats:
    """Return the poses as a contiguous copy with unit quaternions, if all input is usable."""
    poses = np.array(poses, np.float64, order="C").reshape(-1, 7)
    check_graph(poses, groups)
    poses[:, 3:] = quaternion.normalise(poses[:, 3:])
    return poses


def _whitening(edges: SpatialEdges, measured: Floats) -> Floats:
    """Return the matrices W float64 (N, 6, 6)."""
    matrices = np.zeros((len(edges), 6, 6))
    if edges.information is None:
        matrices[:, [0, 1, 2], [0, 1, 2]] = edges.translation_weight[:, None]
        matrices[:, [3, 4, 5], [3, 4, 5]] = edges.rotation_weight[:, None]
        return matrices
    values, vectors = np.linalg.eigh(edges.information)  # a root also where a direction has no information
    roots = np.sqrt(np.maximum(values, 0.0))[:, :, None] * vectors.transpose(0, 2, 1)
    matrices[:, :3, :3] = quaternion.to_matrix(measured[:, 3:]).transpose(0, 2, 1)
    matrices[:, [3, 4, 5], [3, 4, 5]] = 1.0
    return np.ascontiguousarray(roots @ matrices)


def _terms(edges: SpatialEdges, loss: Loss) -> Terms:
    """Return the edges as residuals of the descent."""
    count = len(edges)
    between = edges.until is not None
    until = edges.first if edges.until is None else edges.until
    pairs = np.stack([edges.first, until, edges.second], axis=1).astype(np.int64)
    ratio = np.zeros(count) if edges.ratio is None else np.ascontiguousarray(edges.ratio, np.float64)
    measured = np.array(edges.measured, np.float64, order="C").reshape(-1, 7)
    measured[:, 3:] = quaternion.normalise(measured[:, 3:])
    whitening = _whitening(edges, measured)
    seen = pairs if between else pairs[:, [0, 2]]
    variables = (2 * seen[:, :, None] + np.arange(2)).reshape(count, -1)

    def residuals(state: Floats) -> Floats:
        out = np.empty((count, 6))
        kernels.residuals(state, pairs, ratio, measured, whitening, out)
        return out

    def jacobians(state: Floats) -> Floats:
        out = np.empty((count, 6, 3 * variables.shape[1]))
        kernels.jacobians(state, pairs, ratio, measured, whitening, out)
        return out

    robust = np.ascontiguousarray(edges.robust, np.bool_)
    return Terms(variables=variables, residuals=residuals, jacobians=jacobians, loss=loss, robust=robust)


def warm() -> None:
    """Compile the kernels of this module with a graph of two poses."""
    one, pose = np.ones(1), np.array([[0.0, 0, 0, 0, 0, 0, 1]])
    for until in (None, np.array([1])):
        edges = SpatialEdges(
            first=np.array([0]), second=np.array([1]), measured=pose, translation_weight=one, rotation_weight=one,
            robust=np.zeros(1, np.bool_), until=until, ratio=None if until is None else one / 2,
        )  # fmt: skip
        optimise_spatial(np.repeat(pose, 2, axis=0), np.zeros(2, np.bool_), edges, loss=Loss(), max_iterations=2)
