# SPDX-License-Identifier: MIT
"""Whether two places whose motion was found see the same surfaces: where not, few matches agreed by chance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slamcli.geometry import se3
from slamcli.rtabmap.signature import Signature
from slamcli.vision.pinhole import Pinhole

Floats = NDArray[np.float64]

NEAR_PX = 12.0
"""Key points of b this near to where a's are expected are taken to be on the same surface."""
ALIKE = 0.1
"""Share of the depth by which the two may differ there: edges and foreshortened surfaces lie in between."""
NOISE_PX = 3.0
"""Error of the difference of two disparities that is nothing to wonder at."""
FEWEST = 40
"""Fewer points to compare say nothing."""


def depth_agreement(a: Signature, b: Signature, camera: Pinhole, T_base_camera: Floats, T_a_b: Floats) -> float:
    """Return the share, 0 to 1, of a's points that lie at the depth that b sees around them, mean of both directions.

    All key points whose depth is known count, matched or not: a right motion of places that share more than a corner of their
    views leaves 0.7 and more, in a wrong one surfaces lie before and behind each other. NaN: too few points to tell.
    """
    forward = _share(a, b, camera, se3.inverse(T_a_b @ T_base_camera), se3.inverse(T_base_camera))
    back = _share(b, a, camera, se3.inverse(se3.inverse(T_a_b) @ T_base_camera), se3.inverse(T_base_camera))
    return 0.5 * (forward + back)


def _share(a: Signature, b: Signature, camera: Pinhole, T_camera_a: Floats, T_camera_b: Floats) -> float:
    known = np.flatnonzero(np.isfinite(b.points).all(axis=1))
    local = a.points[np.isfinite(a.points).all(axis=1)] @ T_camera_a[:3, :3].T + T_camera_a[:3, 3]
    local = local[local[:, 2] > 1e-3]
    if not len(known) or not len(local):
        return float("nan")
    distances, nearest = cKDTree(b.features.pixels[known]).query(
        camera.project(local), distance_upper_bound=NEAR_PX
    )  # none: the number of points
    met = np.isfinite(distances)
    if np.count_nonzero(met) < FEWEST:
        return float("nan")
    seen = (b.points[known[nearest[met]]] @ T_camera_b[:3, :3].T + T_camera_b[:3, 3])[:, 2]
    expected = local[met, 2]
    alike = np.abs(seen - expected) <= ALIKE * np.maximum(expected, seen)
    if camera.bf > 0:
        alike |= np.abs(camera.bf / np.maximum(seen, 1e-3) - camera.bf / expected) <= NOISE_PX
    return float(np.mean(alike))
