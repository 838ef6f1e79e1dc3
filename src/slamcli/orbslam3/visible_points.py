# SPDX-License-Identifier: MIT
"""Which points of a map a camera can see, where, and how large."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.sparse_map import Ids, SparseMap
from slamcli.vision.point_projection import LEAST_COSINE, PointAppearance, project_visible


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

    As `slamcli.vision.point_projection.project_visible`; with `any_direction` the viewing direction does not count.
    """
    points = PointAppearance(sparse_map.positions, sparse_map.normals, sparse_map.near, sparse_map.far)
    least = -2.0 if any_direction else LEAST_COSINE
    return VisiblePoints(
        *project_visible(points, ids, T_camera_map, sparse_map.camera, sparse_map.scales, least_cosine=least)
    )
