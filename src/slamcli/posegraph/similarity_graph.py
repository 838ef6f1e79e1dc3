# SPDX-License-Identifier: MIT
"""Graphs of similarities: loops closed with the drift of the scale (Strasdat et al., RSS 2010, "Scale drift-aware")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, EstimationError
from slamcli.geometry import quaternion, se3
from slamcli.posegraph.levenberg_marquardt import Terms, minimise
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.normal_equations import components

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
NUMBERS = 7  # of a residual: rotation vector, translation, logarithm of the scale


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Similarities:
    """N similarities S_a_b: p_a = scale * rotation @ p_b + translation."""

    rotations: Floats
    """float64 (N, 3, 3)."""
    translations: Floats
    """float64 (N, 3)."""
    scales: Floats
    """float64 (N,), positive."""

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self.scales)

    def __getitem__(self, index: Integers | NDArray[np.bool_]) -> Similarities:
        """Return the chosen ones."""
        return Similarities(
            rotations=self.rotations[index], translations=self.translations[index], scales=self.scales[index]
        )

    def __matmul__(self, other: Similarities) -> Similarities:
        """Return S_a_c of self S_a_b and other S_b_c, row by row."""
        turned = np.einsum("nij,nj->ni", self.rotations, other.translations)
        return Similarities(
            rotations=self.rotations @ other.rotations, scales=self.scales * other.scales,
            translations=self.scales[:, None] * turned + self.translations,
        )  # fmt: skip

    def inverse(self) -> Similarities:
        """Return S_b_a of S_a_b."""
        turned = np.einsum("nji,nj->ni", self.rotations, self.translations)
        return Similarities(
            rotations=np.swapaxes(self.rotations, 1, 2), translations=-turned / self.scales[:, None], scales=1 / self.scales
        )  # fmt: skip

    def transform(self, points: Floats) -> Floats:
        """Return points (N, 3), one by each similarity."""
        turned = np.einsum("nij,nj->ni", self.rotations, points)
        return self.scales[:, None] * turned + self.translations

    def poses(self) -> Floats:
        """Return T_a_b (N, 4, 4) with the scale of frame b: rotation and translation / scale.

        For S_camera_map this is the camera in the map's own units: its centre is where the similarity has it.
        """
        return se3.from_rotation_translation(self.rotations, self.translations / self.scales[:, None])

    @staticmethod
    def from_poses(T_a_b: Floats, scale: float = 1.0) -> Similarities:
        """Return poses (N, 4, 4) as similarities of one scale, so that :meth:`poses` gives them back."""
        T_a_b = np.asarray(T_a_b, np.float64)
        return Similarities(
            rotations=T_a_b[:, :3, :3].copy(), translations=scale * T_a_b[:, :3, 3], scales=np.full(len(T_a_b), float(scale))
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimilarityEdges:
    """N measured similarities between vertices, as arrays."""

    first: Integers
    """int64 (N,)."""
    second: Integers
    """int64 (N,)."""
    measured: Similarities
    """S_second_first: p_second = measured p_first, between the vertices' own frames."""
    information: Floats | None = None
    """float64 (N, 7, 7), of (rotation vector, translation, logarithm of the scale) along the axes of `second`; None: one."""

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self.first)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimilaritySolution:
    """The adjusted graph."""

    vertices: Similarities
    cost_before: float
    """Half the sum of the losses."""
    cost_after: float
    iterations: int
    converged: bool
    residual_norms: Floats
    """float64 (N,)."""


def relative(vertices: Similarities, first: Integers, second: Integers) -> Similarities:
    """Return S_second_first between vertices S_vertex_map, as edges measure it."""
    return vertices[second] @ vertices[first].inverse()


def optimise_similarities(
    vertices: Similarities,
    fixed: NDArray[np.bool_],
    edges: SimilarityEdges,
    *,
    fix_scale: bool,
    max_iterations: int = 20,
    loss: Loss | None = None,
    tolerance: float = 1e-6,
) -> SimilaritySolution:
    """Return the similarities S_vertex_map that agree best with those measured between them.

    Parameters
    ----------
    vertices : S_camera_map of V keyframes, where to begin.
    fixed : bool (V,). A connected part of the graph without a fixed vertex keeps its first one.
    edges : between the vertices.
    fix_scale : 6 numbers each instead of 7: scales stay as they are given (maps of stereo, RGB-D and inertial cameras).
    max_iterations : Levenberg-Marquardt steps.
    loss : of every edge; None: squared, as in ORB-SLAM.
    tolerance : relative decrease of the cost at which it has converged.

    Raises
    ------
    DataError
        If shapes do not fit.
    EstimationError
        If a number is not finite, a scale not positive, or an edge names no vertex.

    Notes
    -----
    The residual of an edge is (log R, t, log s) of E = measured S_first S_second^-1, which is 1 where they agree: unlike
    g2o's logarithm of E its translation is not bent by rotation and scale. A vertex moves by (phi, rho, sigma) in its own
    axes, p' = e^sigma Exp(phi) p + rho. With measured = (s, R, t) and E = (s_e, R_e, t_e), the increment of `first` acts on
    E from the left as (R phi, s R rho - R phi x t - sigma t, sigma), that of `second` from the right as its negative; the
    derivatives of log R_e are the inverse left and right Jacobians of the exponential (Solà et al., arXiv:1812.01537).
    """
    _check(vertices, fixed, edges)
    count = len(vertices)
    parts = components(count, [np.stack([edges.first, edges.second], axis=1).astype(np.int64)])
    anchored = np.zeros(int(parts.max(initial=-1)) + 1, np.bool_)
    anchored[parts[fixed]] = True
    _, firsts = np.unique(parts, return_index=True)
    stays = np.array(fixed, np.bool_)
    stays[firsts[~anchored]] = True
    held = np.zeros((count, 3, 3), np.bool_)
    held[:, 2, 1:] = True  # the third variable of a vertex holds one number
    held[:, 2, 0] = fix_scale
    held[stays] = True
    terms = _terms(edges, Loss() if loss is None else loss)
    found = minimise(_packed(vertices), [terms], held.reshape(-1, 3), _retract, max_iterations, tolerance, together=3)
    return SimilaritySolution(
        vertices=_unpacked(found.state), cost_before=found.cost_before, cost_after=found.cost_after,
        iterations=found.iterations, converged=found.converged, residual_norms=found.norms[0],
    )  # fmt: skip


def _check(vertices: Similarities, fixed: NDArray[np.bool_], edges: SimilarityEdges) -> None:
    count = len(edges)
    if fixed.shape != (len(vertices),) or edges.second.shape != (count,) or len(edges.measured) != count:
        raise DataError(
            f"similarity graph: {len(vertices)} vertices and {count} edges do not fit fixed {fixed.shape}, "
            f"second {edges.second.shape}, {len(edges.measured)} measured"
        )
    if edges.information is not None and edges.information.shape != (count, NUMBERS, NUMBERS):
        raise DataError(f"similarity graph: information is {edges.information.shape}, {(count, 7, 7)} is wanted")
    for name, group in (("vertex", vertices), ("edge", edges.measured)):
        packed = np.column_stack([group.rotations.reshape(-1, 9), group.translations, group.scales])
        wrong = np.flatnonzero(~(np.isfinite(packed).all(axis=1) & (group.scales > 0)))
        if len(wrong):
            raise EstimationError(f"similarity graph: {name} {wrong[0]} is not finite or its scale not positive")
    ends = np.stack([edges.first, edges.second], axis=1)
    wrong = np.flatnonzero(((ends < 0) | (ends >= len(vertices))).any(axis=1))
    if len(wrong):
        raise EstimationError(
            f"similarity graph: edge {wrong[0]} (from {ends[wrong[0], 0]} to {ends[wrong[0], 1]}) names no vertex: "
            f"there are {len(vertices)}"
        )


def _packed(group: Similarities) -> Floats:
    """Return the state float64 (V, 13): rotation row by row, translation, logarithm of the scale."""
    return np.column_stack([group.rotations.reshape(-1, 9), group.translations, np.log(group.scales)])


def _unpacked(state: Floats) -> Similarities:
    return Similarities(
        rotations=state[:, :9].reshape(-1, 3, 3).copy(), translations=state[:, 9:12].copy(), scales=np.exp(state[:, 12])
    )


def _retract(state: Floats, steps: Floats) -> Floats:
    """Return the state after steps (3 V, 3): rotation vectors, translations, and scales in the first number of a third."""
    group, step = _unpacked(state), steps.reshape(-1, 9)
    turn = _exponential(step[:, :3])
    scale = np.exp(step[:, 6])
    turned = scale[:, None] * np.einsum("nij,nj->ni", turn, group.translations) + step[:, 3:6]
    return np.column_stack([(turn @ group.rotations).reshape(-1, 9), turned, state[:, 12] + step[:, 6]])


def _exponential(vectors: Floats) -> Floats:
    """Return the rotations (N, 3, 3) of rotation vectors (N, 3)."""
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    half = np.where(angle < 1e-6, 0.5 - angle**2 / 48, np.sin(0.5 * angle) / np.where(angle < 1e-6, 1.0, angle))
    return quaternion.to_matrix(quaternion.normalise(np.concatenate([half * vectors, np.cos(0.5 * angle)], axis=1)))


def _logarithm(rotations: Floats) -> Floats:
    """Return the rotation vectors (N, 3), no longer than pi, of rotations (N, 3, 3)."""
    quat = quaternion.from_matrix(rotations)
    quat = np.where(quat[:, 3:] < 0, -quat, quat)
    sine = np.linalg.norm(quat[:, :3], axis=1, keepdims=True)
    angle = 2 * np.arctan2(sine, quat[:, 3:])
    return np.where(sine < 1e-8, 2.0, angle / np.where(sine < 1e-8, 1.0, sine)) * quat[:, :3]


def _cross(vectors: Floats) -> Floats:
    """Return the matrices [v]x (N, 3, 3)."""
    out = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -z, y, -x
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = z, -y, x
    return out


def _inverse_left_jacobian(vectors: Floats) -> Floats:
    """Return the inverses (N, 3, 3) of the left Jacobian of the exponential; transposed, of the right one."""
    angle = np.linalg.norm(vectors, axis=1)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    second = np.where(small, 1 / 12 + angle**2 / 720, (1 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)
    cross = _cross(vectors)
    return np.eye(3) - 0.5 * cross + second[:, None, None] * (cross @ cross)


def _terms(edges: SimilarityEdges, loss: Loss) -> Terms:
    """Return the edges as residuals of the descent."""
    count, measured = len(edges), edges.measured
    roots = None
    if edges.information is not None:
        values, vectors = np.linalg.eigh(edges.information)
        roots = np.sqrt(np.maximum(values, 0.0))[:, :, None] * vectors.transpose(0, 2, 1)

    def errors(state: Floats) -> Similarities:
        group = _unpacked(state)
        return measured @ group[edges.first] @ group[edges.second].inverse()

    def residuals(state: Floats) -> Floats:
        error = errors(state)
        out = np.column_stack([_logarithm(error.rotations), error.translations, np.log(error.scales)])
        return out if roots is None else np.einsum("nij,nj->ni", roots, out)

    def jacobians(state: Floats) -> Floats:
        error = errors(state)
        inverse = _inverse_left_jacobian(_logarithm(error.rotations))
        out = np.zeros((count, NUMBERS, 18))
        turn = measured.rotations
        out[:, :3, :3] = inverse @ turn
        out[:, 3:6, :3] = (_cross(measured.translations) - _cross(error.translations)) @ turn
        out[:, 3:6, 3:6] = measured.scales[:, None, None] * turn
        out[:, 3:6, 6] = error.translations - measured.translations
        out[:, 6, 6] = 1.0
        out[:, :3, 9:12] = -np.swapaxes(inverse, 1, 2)
        out[:, 3:6, 12:15] = -error.scales[:, None, None] * error.rotations
        out[:, 6, 15] = -1.0
        return out if roots is None else roots @ out

    ends = np.stack([edges.first, edges.second], axis=1).astype(np.int64)
    variables = (3 * ends[:, :, None] + np.arange(3)).reshape(count, 6)
    return Terms(
        variables=variables, residuals=residuals, jacobians=jacobians, loss=loss, robust=np.ones(count, np.bool_)
    )
