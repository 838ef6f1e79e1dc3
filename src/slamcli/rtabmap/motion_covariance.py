# SPDX-License-Identifier: MIT
"""How sure a motion is."""

from __future__ import annotations

import numpy as np

from slamcli.rtabmap.frame_matching import FrameMatch
from slamcli.rtabmap.local_map import Floats

_DRIFT = 4.0
"""Variance of a frame's motion over that of its pose beside the map: the map's own errors, which its points share."""


def motion_covariance(match: FrameMatch, T_base_camera: Floats) -> Floats:
    """Return float64 (6, 6), covariance (m^2, rad^2; translation, rotation vector) of the base's motion since the frame before.

    That of the pose on its inliers, with the errors that they really have, carried from the camera's axes to the base's.
    """
    at_camera = np.linalg.pinv(match.information, hermitian=True) * max(match.mean_chi2, 1e-3)
    R, p = T_base_camera[:3, :3], T_base_camera[:3, 3]
    cross = np.array([[0.0, -p[2], p[1]], [p[2], 0.0, -p[0]], [-p[1], p[0], 0.0]])
    carry = np.zeros((6, 6))  # from (phi, rho) of the camera to (translation, rotation) of the base
    carry[:3, :3], carry[:3, 3:], carry[3:, :3] = cross @ R, R, R
    covariance: Floats = _DRIFT * carry @ at_camera @ carry.T
    return 0.5 * (covariance + covariance.T)
