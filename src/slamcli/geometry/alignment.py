# SPDX-License-Identifier: MIT
"""The transform that lays one set of points on another: rigid, with scale, or about the vertical only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamcli.errors import DataError, EstimationError
from slamcli.geometry import se3


@dataclass(frozen=True, slots=True, eq=False)
class Similarity:
    """A transform ``p_target = scale * rotation @ p_source + translation_m``."""

    rotation: NDArray[np.float64]
    """float64 (3, 3)."""
    translation_m: NDArray[np.float64]
    """float64 (3,), metres, target frame."""
    scale: float = 1.0

    @property
    def matrix(self) -> NDArray[np.float64]:
        """float64 (4, 4), with the scale multiplied into the rotation."""
        return se3.from_rotation_translation(self.scale * self.rotation, self.translation_m)

    def transform_points(self, points_source: ArrayLike) -> NDArray[np.float64]:
        """Return points (N, 3), metres, of the source frame in the target frame."""
        return self.scale * np.asarray(points_source, dtype=np.float64) @ self.rotation.T + self.translation_m

    def transform_poses(self, T_source_child: ArrayLike) -> NDArray[np.float64]:
        """Return poses (N, 4, 4) of the source frame in the target frame: positions are scaled, rotations are not."""
        scaled = np.array(T_source_child, dtype=np.float64)
        scaled[..., :3, 3] *= self.scale
        return se3.from_rotation_translation(self.rotation, self.translation_m) @ scaled


def umeyama(points_source: ArrayLike, points_target: ArrayLike, *, with_scale: bool = False) -> Similarity:
    """Return the transform of least squares that lays source points on target points.

    Parameters
    ----------
    points_source, points_target
        float64 (N, 3), metres, paired.
    with_scale
        Estimate the scale too (Sim(3)); otherwise it is 1 (SE(3)).

    Raises
    ------
    EstimationError
        If the points lie on one line or in one point, so that the rotation is not determined.
    DataError
        If the shapes do not fit.

    References
    ----------
    S. Umeyama, "Least-squares estimation of transformation parameters between two point patterns", IEEE PAMI 13(4), 1991,
    doi:10.1109/34.88573.

    Examples
    --------
    >>> points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> umeyama(points, 2 * points + 1, with_scale=True).translation_m.round(9).tolist()
    [1.0, 1.0, 1.0]
    """
    source, target = _paired(points_source, points_target)
    mean_source, mean_target = source.mean(axis=0), target.mean(axis=0)  # eq. 34, 35
    source, target = source - mean_source, target - mean_target
    covariance = target.T @ source / len(source)  # eq. 38
    u, singular, vt = np.linalg.svd(covariance)
    if singular[1] <= max(np.finfo(np.float64).eps, 1e-15 * singular[0]):
        raise EstimationError(
            f"the {len(source)} matched positions lie on one line or in one point: the rotation between the two"
            " trajectories is not determined (align the origin, the yaw, or nothing)"
        )
    signs = np.array([1.0, 1.0, 1.0 if np.linalg.det(u) * np.linalg.det(vt) > 0 else -1.0])  # eq. 43
    rotation = (u * signs) @ vt  # eq. 40
    scale = float(singular @ signs / (source**2).sum(axis=1).mean()) if with_scale else 1.0  # eq. 36, 42
    return Similarity(rotation, mean_target - scale * rotation @ mean_source, scale)  # eq. 41


def yaw_and_position(points_source: ArrayLike, points_target: ArrayLike) -> Similarity:
    """Return the transform of least squares with a rotation about z only ("posyaw": four degrees of freedom).

    This is what a visual-inertial or planar system cannot observe. The rotation maximises ``trace(Rz(yaw) C)`` where C is
    the correlation of the centred points.

    Parameters
    ----------
    points_source, points_target
        float64 (N, 3), metres, paired.

    Raises
    ------
    EstimationError
        If all points stand above one another, so that the yaw is not determined.
    DataError
        If the shapes do not fit.

    References
    ----------
    Z. Zhang and D. Scaramuzza, "A tutorial on quantitative trajectory evaluation for visual(-inertial) odometry", IROS 2018,
    doi:10.1109/IROS.2018.8593941, section III.
    """
    source, target = _paired(points_source, points_target)
    mean_source, mean_target = source.mean(axis=0), target.mean(axis=0)
    correlation = (source - mean_source).T @ (target - mean_target)
    rotation = _rotation_about_z(correlation)
    if rotation is None:
        raise EstimationError(
            f"the {len(source)} matched positions stand above one another: the yaw between the two trajectories is not"
            " determined (align the origin or nothing)"
        )
    return Similarity(rotation, mean_target - rotation @ mean_source)


def yaw_and_position_of_pose(T_source_child: ArrayLike, T_target_child: ArrayLike) -> Similarity:
    """Return the transform that lays one pose (4, 4) on another as far as a rotation about z can ("posyaw", one frame)."""
    source, target = np.asarray(T_source_child, dtype=np.float64), np.asarray(T_target_child, dtype=np.float64)
    rotation = _rotation_about_z(source[:3, :3] @ target[:3, :3].T)
    rotation = np.eye(3) if rotation is None else rotation
    return Similarity(rotation, target[:3, 3] - rotation @ source[:3, 3])


def pose_to_pose(T_source_child: ArrayLike, T_target_child: ArrayLike) -> Similarity:
    """Return the rigid transform that lays one pose (4, 4) exactly on another."""
    T = np.asarray(T_target_child, dtype=np.float64) @ se3.inverse(T_source_child)
    return Similarity(T[:3, :3], T[:3, 3])


def _rotation_about_z(correlation: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the rotation about z that maximises ``trace(Rz C)``, None where every one does."""
    sine, cosine = correlation[0, 1] - correlation[1, 0], correlation[0, 0] + correlation[1, 1]
    if np.hypot(sine, cosine) <= np.finfo(np.float64).eps:
        return None
    yaw = np.arctan2(sine, cosine)
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _paired(a: ArrayLike, b: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    first, second = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if first.shape != second.shape or first.ndim != 2 or first.shape[1] != 3 or not len(first):
        raise DataError(f"alignment: points {first.shape} and {second.shape} are not paired points (N, 3)")
    return first, second
