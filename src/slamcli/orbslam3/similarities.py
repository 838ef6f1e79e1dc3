# SPDX-License-Identifier: MIT
"""Similarities as float64 matrices (..., 4, 4), ``[s R | t]``: they chain and invert like poses.

``S_camera_map`` takes points of a map, in the map's units, to a camera's frame in the units of the map that the camera came from.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.geometry.alignment import Similarity
from slamcli.posegraph.similarity_graph import Similarities

Floats = NDArray[np.float64]


def scale_of(S: Floats) -> Floats:
    """Return scales (...,)."""
    return np.cbrt(np.linalg.det(S[..., :3, :3]))


def rigid_of(S_camera_map: Floats) -> Floats:
    """Return the poses T_camera_map (..., 4, 4) in the map's own units: the same images of all its points."""
    scale = scale_of(S_camera_map)[..., None]
    return se3.from_rotation_translation(S_camera_map[..., :3, :3] / scale[..., None], S_camera_map[..., :3, 3] / scale)


def inverse(S_a_b: Floats) -> Floats:
    """Return S_b_a (..., 4, 4)."""
    square = scale_of(S_a_b)[..., None, None] ** 2
    turn = np.swapaxes(S_a_b[..., :3, :3], -1, -2) / square
    return se3.from_rotation_translation(turn, -(turn @ S_a_b[..., :3, 3:])[..., 0])


def apply(S_a_b: Floats, points_b: Floats) -> Floats:
    """Return points (N, 3) of frame b in frame a: S_a_b is (4, 4), or (N, 4, 4) with one for each."""
    if S_a_b.ndim == 2:
        return points_b @ S_a_b[:3, :3].T + S_a_b[:3, 3]
    return (S_a_b[:, :3, :3] @ points_b[:, :, None])[..., 0] + S_a_b[:, :3, 3]


def as_similarity(S_a_b: Floats) -> Similarity:
    """Return one matrix (4, 4) as rotation, translation and scale."""
    scale = float(scale_of(S_a_b))
    return Similarity(S_a_b[:3, :3] / scale, S_a_b[:3, 3].copy(), scale)


def as_group(S: Floats) -> Similarities:
    """Return matrices (N, 4, 4) as the pose graph takes them."""
    scale = scale_of(S)
    return Similarities(rotations=S[:, :3, :3] / scale[:, None, None], translations=S[:, :3, 3].copy(), scales=scale)


def as_matrices(group: Similarities) -> Floats:
    """Return matrices (N, 4, 4)."""
    return se3.from_rotation_translation(group.scales[:, None, None] * group.rotations, group.translations)
