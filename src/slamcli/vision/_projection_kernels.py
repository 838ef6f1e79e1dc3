# SPDX-License-Identifier: MIT
"""Compiled projection of map points into a frame; see `slamcli.vision.point_projection`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def project_points(
    ids, positions, normals, near, far, T_camera_map, camera, limits, log_scale, num_levels, least_cosine, slack
):
    """Return which points a frame can see and where.

    Parameters
    ----------
    ids
        int64 (N,), points to look at.
    camera
        float64 (5,): fx, fy, cx, cy, bf.
    limits
        float64 (4,): x_min, y_min, x_max, y_max, pixels.
    log_scale
        Logarithm of the factor between two levels of the image pyramid.
    least_cosine
        Of the angle between the viewing ray and the mean of those from which the point was seen before.
    slack
        Factor by which the distance may be out of the range in which the point can be recognised.

    Returns
    -------
    tuple
        (M,) rows of `ids` that are visible, pixels (M, 2), right columns (M,), octaves (M,), cosines (M,), depths (M,).
    """
    n = len(ids)
    rows = np.empty(n, np.int64)
    pixels = np.empty((n, 2))
    right = np.empty(n)
    octaves = np.empty(n, np.int64)
    cosines = np.empty(n)
    depths = np.empty(n)
    fx, fy, cx, cy, bf = camera[0], camera[1], camera[2], camera[3], camera[4]
    R = T_camera_map
    found = 0
    # camera centre in the map: -R^T t
    ox = -(R[0, 0] * R[0, 3] + R[1, 0] * R[1, 3] + R[2, 0] * R[2, 3])
    oy = -(R[0, 1] * R[0, 3] + R[1, 1] * R[1, 3] + R[2, 1] * R[2, 3])
    oz = -(R[0, 2] * R[0, 3] + R[1, 2] * R[1, 3] + R[2, 2] * R[2, 3])
    for r in range(n):
        p = ids[r]
        x, y, z = positions[p, 0], positions[p, 1], positions[p, 2]
        zc = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + R[2, 3]
        if zc <= 1e-6:
            continue
        u = fx * (R[0, 0] * x + R[0, 1] * y + R[0, 2] * z + R[0, 3]) / zc + cx
        v = fy * (R[1, 0] * x + R[1, 1] * y + R[1, 2] * z + R[1, 3]) / zc + cy
        if u < limits[0] or u >= limits[2] or v < limits[1] or v >= limits[3]:
            continue
        dx, dy, dz = x - ox, y - oy, z - oz
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        if distance > far[p] * slack or distance * slack < near[p]:
            continue
        cosine = (dx * normals[p, 0] + dy * normals[p, 1] + dz * normals[p, 2]) / distance
        if cosine < least_cosine:
            continue
        octave = math.ceil(math.log(far[p] / distance) / log_scale - 1e-9)
        rows[found] = r
        pixels[found, 0] = u
        pixels[found, 1] = v
        right[found] = u - bf / zc
        octaves[found] = min(max(octave, 0), num_levels - 1)
        cosines[found] = cosine
        depths[found] = zc
        found += 1
    return rows[:found], pixels[:found], right[:found], octaves[:found], cosines[:found], depths[:found]
