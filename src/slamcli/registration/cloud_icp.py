# SPDX-License-Identifier: MIT
"""Alignment of clouds in space by ICP: to points, to planes, or plane to plane (generalised ICP), with small_gicp.

Clouds of a planar scanner are no case for it: their neighbourhoods span the plane of the scan, so that all normals stand on it and
tell nothing (small_gicp's point-to-plane stops at its guess, and GICP becomes point-to-point). `merged_scans` aligns those.

References
----------
A. Segal, D. Haehnel, S. Thrun: Generalized-ICP, RSS 2009, doi:10.15607/RSS.2009.V.021. K. Koide: small_gicp, JOSS 2024,
doi:10.21105/joss.06948.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.geometry import quaternion, se3

Floats = NDArray[np.float64]
Method = Literal["point", "plane", "gicp"]

_NAMES: dict[Method, str] = {"point": "ICP", "plane": "PLANE_ICP", "gicp": "GICP"}
_FEWEST = 10
_ROUNDS = 3
"""How often an alignment begins again with what was left of the source (trimmed) or of the motion (level)."""
_UNTOLD_M2 = 1.0
"""Variance along axes that a target does not tell."""
_UNSURE = 1e-6
"""Relative eigenvalue under which a normal matrix tells nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CloudIcpSettings:
    """Settings of an alignment; they follow RTAB-Map's `Icp` parameters."""

    method: Method = "plane"
    voxel_m: float = 0.05
    """Clouds are thinned to one point (their mean) per voxel; 0: not."""
    step: int = 1
    """Before that every so many points are taken."""
    filters: int = 3
    """Which clouds are thinned: 1 the target, 2 the source, 3 both, 0 none."""
    max_distance_m: float = 0.1
    """Points up to this far apart are matched."""
    inlier_m: float = 0.0
    """In the end those up to this far apart count as inliers; 0: all that are matched."""
    iterations: int = 30
    epsilon: float = 0.0
    """Metres and radians; 0: 1e-4."""
    neighbours: int = 10
    """Of a point, of which its normal or covariance is made."""
    radius_m: float = 0.0
    """Where positive: as many neighbours as half of the points have within this distance."""
    trimmed: float = 1.0
    """Share of the source's matched points, the nearest ones, that is kept."""
    reciprocal: bool = False
    """Whether only points that are each other's nearest count as inliers."""
    level: bool = False
    """Whether roll and pitch stay as they are in the guess (4 degrees of freedom)."""
    planar: bool = False
    """Whether height, roll and pitch stay (3 degrees of freedom)."""
    min_complexity: float = 0.0
    """Least structure of the target (`PreparedCloud.complexity`) at which all axes are corrected."""
    sure_axes_only: bool = False
    """Whether, below it, axes along which normals are few keep the guess."""


@dataclass(frozen=True, slots=True, eq=False)
class PreparedCloud:
    """A thinned cloud with normals, covariances and a tree of its points."""

    points: Floats
    """float64 (N, 3), metres."""
    cloud: Any
    tree: Any
    has_normals: bool
    axes: Floats
    """float64 (3, 3), columns: directions in which normals point most, then less."""
    shares: Floats
    """float64 (3,), decreasing, how much they point there: 1 in all; zeros without normals."""

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.points)

    @property
    def complexity(self) -> float:
        """0 where all normals lie in one plane (a straight corridor), 1 where they point everywhere alike."""
        return float(3.0 * self.shares[2])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CloudAlignment:
    """How the source lies in the target."""

    T_target_source: Floats
    """float64 (4, 4)."""
    num_points: int
    """Of the source, after thinning."""
    num_inliers: int
    """Of them, those that have a match."""
    rmse_m: float
    """Of the inliers' distances from their matches."""
    covariance: Floats
    """float64 (6, 6), m and rad, translation before rotation vector, along the target's axes, if the matches' errors were
    independent; large where nothing is told."""
    converged: bool
    complexity: float
    """Of the target."""

    @property
    def inlier_ratio(self) -> float:
        """0 to 1."""
        return self.num_inliers / max(self.num_points, 1)


def prepare_cloud(points: NDArray[np.floating], settings: CloudIcpSettings, *, side: int = 3) -> PreparedCloud:
    """Return a cloud (N, 3) as alignments take it; `side` is 1 for a target, 2 for a source (see `filters`).

    Raises
    ------
    EstimationError
        If fewer than ten points are left.
    """
    import small_gicp

    s = settings
    kept = np.ascontiguousarray(points, np.float64)
    kept = kept[np.isfinite(kept).all(axis=1)]
    if s.filters & side:
        kept = kept[:: s.step]
        if s.voxel_m > 0.0 and len(kept):
            kept = np.asarray(small_gicp.voxelgrid_sampling(kept, s.voxel_m, num_threads=1).points())[:, :3]
    if len(kept) < _FEWEST:
        raise EstimationError(f"a cloud of {len(kept)} points cannot be aligned: at least {_FEWEST} are needed")
    cloud = small_gicp.PointCloud(np.ascontiguousarray(kept))
    tree = small_gicp.KdTree(cloud, num_threads=1)
    bare = PreparedCloud(kept, cloud, tree, False, np.eye(3), np.zeros(3))
    return with_normals(bare, s) if side & 1 or s.method == "gicp" else bare


def with_normals(prepared: PreparedCloud, settings: CloudIcpSettings) -> PreparedCloud:
    """Return a cloud with normals and covariances of its points, and where they point."""
    import small_gicp

    if prepared.has_normals:
        return prepared
    points, cloud, tree = prepared.points, prepared.cloud, prepared.tree
    small_gicp.estimate_normals_covariances(
        cloud, tree, num_neighbors=_neighbours(points, tree, settings), num_threads=1
    )
    normals = np.asarray(cloud.normals())[:, :3]
    values, axes = np.linalg.eigh(normals.T @ normals / len(normals))
    return PreparedCloud(points, cloud, tree, True, axes[:, ::-1], values[::-1] / max(float(values.sum()), 1e-12))


def align_clouds(
    target: NDArray[np.floating],
    source: NDArray[np.floating],
    T_target_source_guess: Floats,
    settings: CloudIcpSettings,
) -> CloudAlignment:
    """Return how one cloud (M, 3) lies in another (N, 3), beginning at a guess. See `align_prepared`."""
    return align_prepared(
        prepare_cloud(target, settings, side=1),
        prepare_cloud(source, settings, side=2),
        T_target_source_guess,
        settings,
    )


def align_prepared(
    target: PreparedCloud, source: PreparedCloud, T_target_source_guess: Floats, settings: CloudIcpSettings
) -> CloudAlignment:
    """Return how the source lies in the target.

    The result depends on the input alone: small_gicp runs on one thread. A failure to find enough matches is told by
    `num_inliers` and `converged`.
    """
    s = settings
    T = _rigid(T_target_source_guess.astype(np.float64))
    kept, rounds = source, _ROUNDS if s.trimmed < 1.0 or s.level or s.planar else 1
    result: Any = None
    for turn in range(rounds):
        result = _align(target, kept, T, s)
        T = _constrained(_rigid(np.asarray(result.T_target_source)), T_target_source_guess, s)
        if s.trimmed < 1.0 and turn + 1 < rounds:
            kept = _nearest(target, source, T, s)
    covariance = _covariance(result, T)
    if s.sure_axes_only and target.complexity < s.min_complexity:
        unsure = target.axes[:, 3.0 * target.shares < s.min_complexity]
        T = T.copy()
        T[:3, 3] -= unsure @ (unsure.T @ (T[:3, 3] - T_target_source_guess[:3, 3]))
        covariance[:3, :3] += _UNTOLD_M2 * unsure @ unsure.T
    matched, squared = _matches(target, source, T, s, s.inlier_m or s.max_distance_m)
    return CloudAlignment(
        T_target_source=T, num_points=len(source), num_inliers=int(matched.sum()),
        rmse_m=float(np.sqrt(squared[matched].mean())) if matched.any() else 0.0,
        covariance=covariance, converged=bool(result.converged) and bool(result.num_inliers), complexity=target.complexity,
    )  # fmt: skip


def _align(target: PreparedCloud, source: PreparedCloud, T: Floats, s: CloudIcpSettings) -> Any:
    import small_gicp

    epsilon = s.epsilon or 1e-4
    return small_gicp.align(
        target.cloud, source.cloud, target.tree, T, registration_type=_NAMES[s.method], max_correspondence_distance=s.max_distance_m,
        num_threads=1, max_iterations=s.iterations, rotation_epsilon=epsilon, translation_epsilon=epsilon,
    )  # fmt: skip


def _neighbours(points: Floats, tree: Any, s: CloudIcpSettings) -> int:
    """Return the number of neighbours that make a normal, at least the five without which small_gicp makes none."""
    if s.radius_m <= 0.0:
        return max(5, s.neighbours)
    some = points[:: max(1, len(points) // 200)]
    most = min(100, len(points))
    distances = np.asarray(tree.batch_knn_search(some, most, num_threads=1)[1])
    return int(np.clip(np.median((distances <= s.radius_m**2).sum(axis=1)), 5, most))


def _matches(
    target: PreparedCloud, source: PreparedCloud, T: Floats, s: CloudIcpSettings, reach_m: float
) -> tuple[NDArray[np.bool_], Floats]:
    """Return which points of the source are matched, and their squared distances from the nearest point of the target."""
    moved = source.points @ T[:3, :3].T + T[:3, 3]
    indices, squared = (np.asarray(a) for a in target.tree.batch_nearest_neighbor_search(moved, num_threads=1))
    matched = squared <= reach_m**2
    if s.reciprocal and matched.any():
        seen = (target.points[indices[matched].astype(np.int64)] - T[:3, 3]) @ T[:3, :3]
        back = np.asarray(source.tree.batch_nearest_neighbor_search(seen, num_threads=1)[1])
        # neighbours that lie within a voxel of each other are as good as mutual
        matched[matched] = np.sqrt(back) + s.voxel_m >= np.sqrt(squared[matched])
    return matched, squared


def _nearest(target: PreparedCloud, source: PreparedCloud, T: Floats, s: CloudIcpSettings) -> PreparedCloud:
    """Return the source without those of its matched points that lie farthest from their matches."""
    import small_gicp

    matched, squared = _matches(target, source, T, s, s.max_distance_m)
    if matched.sum() < 2 * _FEWEST:
        return source
    bound = float(np.quantile(squared[matched], s.trimmed))
    points = np.ascontiguousarray(source.points[matched & (squared <= bound)])
    if len(points) < _FEWEST:
        return source
    cloud = small_gicp.PointCloud(points)
    if s.method == "gicp":
        tree = small_gicp.KdTree(cloud, num_threads=1)
        small_gicp.estimate_covariances(cloud, tree, num_neighbors=max(5, s.neighbours), num_threads=1)
    return PreparedCloud(points, cloud, source.tree, s.method == "gicp", source.axes, source.shares)


def _rigid(T: Floats) -> Floats:
    """Return a transform whose rotation is one to the last digit: rounding would grow from one alignment to the next."""
    position, quat_xyzw = se3.to_position_quaternion(T)
    return se3.from_position_quaternion(position, quaternion.normalise(quat_xyzw))


def _constrained(T: Floats, guess: Floats, s: CloudIcpSettings) -> Floats:
    """Return T with what must not change taken from the guess."""
    if not (s.level or s.planar):
        return T
    correction = T[:3, :3] @ guess[:3, :3].T
    yaw = np.arctan2(correction[1, 0] - correction[0, 1], correction[0, 0] + correction[1, 1])
    kept = se3.from_se2(np.array([0.0, 0.0, yaw]))
    kept[:3, :3] = kept[:3, :3] @ guess[:3, :3]
    kept[:3, 3] = T[:3, 3]
    if s.planar:
        kept[2, 3] = guess[2, 3]
    return kept


def _covariance(result: Any, T: Floats) -> Floats:
    """Return the covariance of the motion along the target's axes.

    small_gicp's normal matrix is about ``T Exp(delta)``, rotation before translation, along the source's axes; its error is half
    the sum of squared residuals.
    """
    order = [3, 4, 5, 0, 1, 2]
    normal = np.asarray(result.H)[np.ix_(order, order)]
    variance = 2.0 * float(result.error) / max(int(result.num_inliers) - 6, 1)
    values, vectors = np.linalg.eigh(0.5 * (normal + normal.T))
    told = values > _UNSURE * max(float(values[-1]), 1e-12)
    inverse = np.where(told, variance / np.where(told, values, 1.0), 1.0)
    local = (vectors * np.maximum(inverse, 1e-12)) @ vectors.T
    axes = np.zeros((6, 6))
    axes[:3, :3] = axes[3:, 3:] = T[:3, :3]
    return axes @ local @ axes.T
