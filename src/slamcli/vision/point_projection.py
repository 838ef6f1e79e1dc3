# SPDX-License-Identifier: MIT
"""Which points a camera can see, where, and how large."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.vision import _projection_kernels as kernels
from slamcli.vision.pinhole import Pinhole

Floats = NDArray[np.float64]
LEAST_COSINE = 0.5
SLACK = 1.2


class PointAppearance(NamedTuple):
    """Where points are and from where they can be recognised, as columns of P points."""

    positions: Floats
    """(P, 3), metres."""
    normals: Floats
    """(P, 3), mean direction from the cameras to the point."""
    near: Floats
    """(P,), metres: nearer it is too large for the finest level of the image pyramid."""
    far: Floats
    """(P,), metres: farther it is too small for the coarsest level."""


class SeenPoints(NamedTuple):
    """M points that fall into an image, as columns."""

    rows: NDArray[np.int64]
    """Of the points."""
    pixels: Floats
    """(M, 2), where they are to be looked for."""
    right: Floats
    """(M,), column in the right image."""
    octaves: NDArray[np.int64]
    """(M,), level of the image pyramid at which they look as they did when they were found."""
    cosines: Floats
    """(M,), of the angle to the mean direction from which they were seen."""
    depths: Floats
    """(M,), metres along z."""


def project_visible(
    points: PointAppearance, ids: NDArray[np.int64], T_camera_map: Floats, camera: Pinhole, scales: Floats,
    *, least_cosine: float = LEAST_COSINE,
) -> SeenPoints:  # fmt: skip
    """Return which of the points `ids` (N,) a camera at a pose sees; `rows` are those of `points`.

    A point counts as visible inside the image's limits, at a distance at which its scale is in the image pyramid (`scales` (L,) of its levels), and
    with at least `least_cosine` of the angle to its mean viewing direction (R. Mur-Artal et al., IEEE T-RO 31(5), 2015, section V-D).
    """
    log_scale = math.log(scales[1]) if len(scales) > 1 else 1.0
    rows, *columns = kernels.project_points(
        np.asarray(ids, dtype=np.int64), *points, np.ascontiguousarray(T_camera_map), camera.array, np.array(camera.limits), log_scale,
        len(scales), float(least_cosine), SLACK,
    )  # fmt: skip
    return SeenPoints(ids[rows], *columns)


def warm() -> None:
    """Compile the kernels of this module on tiny input."""
    one = np.ones(1)
    camera = Pinhole(fx=1.0, fy=1.0, cx=0.0, cy=0.0, width=2, height=2)
    points = PointAppearance(np.ones((1, 3)), np.ones((1, 3)), one, one)
    project_visible(points, np.zeros(1, dtype=np.int64), np.eye(4), camera, np.array([1.0, 1.2]))
