# SPDX-License-Identifier: MIT
"""Pose of one camera from known points (Mur-Artal and Tardós, T-RO 2017, "motion-only bundle adjustment")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision import _pose_kernels as kernels
from slamcli.vision.pinhole import Pinhole

Floats = NDArray[np.float64]
FEWEST_POINTS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseEstimate:
    """Where a camera stands, and which of the points agree."""

    T_camera_map: Floats
    """float64 (4, 4)."""
    inliers: NDArray[np.bool_]
    """bool (N,): ahead of the camera and with chi2 within the 95 % bound (5.991 mono, 7.815 stereo)."""
    chi2: Floats
    """float64 (N,), squared residual over squared sigma; inf behind the camera."""
    information: Floats
    """float64 (6, 6): J'J of the inliers, of the increment (phi, rho) in the camera's axes, rotation vector (rad) before
    translation (m): T_camera_map becomes [Exp(phi) | rho] @ T_camera_map."""

    @property
    def num_inliers(self) -> int:
        """How many points agree."""
        return int(np.count_nonzero(self.inliers))


def optimise_pose(
    T_camera_map: Floats,
    points: Floats,
    pixels: Floats,
    right: Floats,
    sigmas: Floats,
    camera: Pinhole,
    *,
    rounds: int = 4,
    iterations: int = 10,
) -> PoseEstimate:
    """Return the pose that minimises the reprojection error of points that stay where they are.

    Parameters
    ----------
    T_camera_map : float64 (4, 4), where to begin.
    points : float64 (N, 3), map frame, metres.
    pixels : float64 (N, 2), where they were seen.
    right : float64 (N,), column in the right image, pixels; NaN: seen by one camera only.
    sigmas : float64 (N,), standard deviation of `pixels` and `right`, pixels.
    camera : of the pixels.
    rounds : after each, the points are sorted anew into inliers, which the next round works with, and outliers. All but
        the last have a Huber loss with the inliers' bound.
    iterations : of each round, at most; a round ends when the cost falls by less than 1e-6 of itself.

    Returns
    -------
    PoseEstimate
        With fewer than three points the pose is the one given and there are no inliers.

    Notes
    -----
    Unlike in the original each round begins where the last one ended, not at the first pose. 0.2 ms for 500
    points.
    """
    points, pixels = np.ascontiguousarray(points, np.float64), np.ascontiguousarray(pixels, np.float64)
    right, sigmas = np.ascontiguousarray(right, np.float64), np.ascontiguousarray(sigmas, np.float64)
    count = len(points)
    if points.shape != (count, 3) or pixels.shape != (count, 2) or right.shape != (count,) or sigmas.shape != (count,):
        raise DataError(
            "pose from points: points (N, 3), pixels (N, 2), right (N,) and sigmas (N,) are wanted, not "
            f"{points.shape}, {pixels.shape}, {right.shape}, {sigmas.shape}"
        )
    pose = np.array(T_camera_map, np.float64, order="C")
    inliers, chi2, information = np.zeros(count, np.bool_), np.full(count, np.inf), np.zeros((6, 6))
    if count >= FEWEST_POINTS:
        kernels.optimise(
            pose, points, pixels, right, sigmas, camera.array, rounds, iterations, inliers, chi2, information
        )
    return PoseEstimate(T_camera_map=pose, inliers=inliers, chi2=chi2, information=information)


def warm() -> None:
    """Compile the kernels of this module with four points."""
    points = np.array([[0.0, 0, 2], [1, 0, 3], [0, 1, 4], [1, 1, 3]])
    camera = Pinhole(fx=100.0, fy=100.0, cx=50.0, cy=50.0, width=100, height=100)
    optimise_pose(np.eye(4), points, camera.project(points), np.full(4, np.nan), np.ones(4), camera)
