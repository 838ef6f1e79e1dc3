# SPDX-License-Identifier: MIT
"""The floor in a cloud of points."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import _depth_kernels as kernels

_TOLERANCE_M = 0.03
_PLANES = 400
_FEW, _NEAR_M, _LEAST_NEAR = 4000, 0.4, 5
"""Points among which near ones are chosen, how near these are, and how many there must be."""
_LEAST_SHARE = 0.05
"""Of the points that a floor must hold."""
_BELOW = 0.02
"""Share of the points that may lie below a floor: what is seen through a door or a hole, and noise."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Floor:
    """A plane ``normal @ p = height_m`` that little lies below of."""

    normal: NDArray[np.float64]
    """float64 (3,), unit, up."""
    height_m: float
    share: float
    """Of the points that lie on it."""


def find_floor(
    points: NDArray[np.float64], up: NDArray[np.float64], *, tilt_rad: float = math.radians(50.0), seed: int = 0
) -> Floor | None:
    """Return the largest plane below the others whose normal is near a direction; None where there is none.

    Parameters
    ----------
    points
        float64 (N, 3), metres.
    up
        float64 (3,), where up is, roughly.
    tilt_rad
        How far that may be wrong.
    seed
        Of the random choice of points: planes through three of them are tried (RANSAC).

    Notes
    -----
    A table that hides the floor is taken for it.
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    if len(points) < 100:
        return None
    random = np.random.default_rng(seed)
    found = _best(points, points[random.integers(0, len(points), (_PLANES, 3))], up, tilt_rad)
    # Three points of the whole cloud rarely lie on a floor that is a small part of it; three that are near each other do.
    return found or _best(points, _near_triples(points, random), up, tilt_rad)


def _near_triples(points: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
    """Return triples of points (S, 3, 3) that lie near each other."""
    from scipy.spatial import cKDTree

    few = points[:: max(1, len(points) // _FEW)]
    firsts = random.integers(0, len(few), _PLANES)
    around = cKDTree(few).query_ball_point(few[firsts], _NEAR_M, return_sorted=True)
    triples = [
        [first, *random.choice(beside, 2, replace=False)]
        for first, beside in zip(firsts.tolist(), around, strict=True)
        if len(beside) >= _LEAST_NEAR
    ]
    return few[np.array(triples, dtype=np.int64).reshape(-1, 3)]


def _best(
    points: NDArray[np.float64], chosen: NDArray[np.float64], up: NDArray[np.float64], tilt_rad: float
) -> Floor | None:
    """Return the best floor of those that three points each lie on, (S, 3, 3)."""
    normals = np.cross(chosen[:, 1] - chosen[:, 0], chosen[:, 2] - chosen[:, 0])
    length = np.linalg.norm(normals, axis=1)
    good = length > 1e-6
    normals = normals[good] / length[good, None]
    normals *= np.where(normals @ up < 0, -1.0, 1.0)[:, None]
    level = normals @ up > math.cos(tilt_rad) * np.linalg.norm(up)
    normals, offsets = normals[level], np.einsum("sj,sj->s", normals, chosen[good, 0])[level]
    if not len(normals):
        return None
    counts = kernels.count_near(points, np.ascontiguousarray(normals), np.ascontiguousarray(offsets), _TOLERANCE_M)
    lowest = counts[:, 1] <= _BELOW * len(points)
    if not lowest.any():
        return None
    best = int(np.argmax(np.where(lowest, counts[:, 0], -1)))
    if counts[best, 0] < _LEAST_SHARE * len(points):
        return None
    normal, height = _refined(points, normals[best], float(offsets[best]))
    share = float((np.abs(points @ normal - height) <= _TOLERANCE_M).mean())
    return Floor(normal=normal, height_m=height, share=share)


def _refined(
    points: NDArray[np.float64], normal: NDArray[np.float64], height: float
) -> tuple[NDArray[np.float64], float]:
    """Return the plane of least squares through the points on a plane, twice."""
    for _ in range(2):
        on = points[np.abs(points @ normal - height) <= _TOLERANCE_M]
        middle = on.mean(axis=0)
        axes = np.linalg.svd(on - middle, full_matrices=False)[2]
        fitted = axes[2] * (1.0 if axes[2] @ normal > 0 else -1.0)
        normal, height = fitted, float(fitted @ middle)
    return normal, height
