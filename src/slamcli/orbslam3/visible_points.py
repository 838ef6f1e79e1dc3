# SPDX-License-Identifier: MIT
"""Which points of a map a camera can see, where, and how large."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3 import _projection_kernels as kernels
from slamcli.orbslam3.sparse_map import Ids, SparseMap

_LEAST_COSINE = 0.5
_SLACK = 1.2


class VisiblePoints(NamedTuple):
    """Points that fall into an image, as columns."""

    ids: Ids
    pixels: NDArray[np.float64]
    """(M, 2), where they are to be looked for."""
    right: NDArray[np.float64]
    """(M,), column in the right image."""
    octaves: Ids
    """(M,), level of the image pyramid at which they look as they did when they were found."""
    cosines: NDArray[np.float64]
    """(M,), of the angle to the mean direction from which they were seen."""
    depths: NDArray[np.float64]
    """(M,), metres along z."""


def visible_points(
    sparse_map: SparseMap, ids: Ids, T_camera_map: NDArray[np.float64], *, any_direction: bool = False
) -> VisiblePoints:
    """Return which of the points `ids` (N,) a camera at a pose can see.

    A point counts as visible inside the image's limits, at a distance at which its scale is in the image pyramid, and from less than
    60 degrees beside the mean viewing direction (ORB-SLAM, section V-D) unless `any_direction`.
    """
    camera, scales = sparse_map.camera, sparse_map.scales
    log_scale = math.log(scales[1]) if len(scales) > 1 else 1.0
    rows, pixels, right, octaves, cosines, depths = kernels.project_points(
        np.asarray(ids, dtype=np.int64), sparse_map.positions, sparse_map.normals, sparse_map.near, sparse_map.far,
        np.ascontiguousarray(T_camera_map), camera.array, np.array(camera.limits), log_scale, len(scales),
        -2.0 if any_direction else _LEAST_COSINE, _SLACK,
    )  # fmt: skip
    return VisiblePoints(ids[rows], pixels, right, octaves, cosines, depths)


def warm() -> None:
    """Compile the kernels of this module on tiny input."""
    one = np.zeros(1)
    kernels.project_points(
        np.zeros(1, dtype=np.int64), np.ones((1, 3)), np.ones((1, 3)), one, one, np.eye(4), np.ones(5), np.ones(4), 0.2, 8, 0.5, 1.2
    )  # fmt: skip
