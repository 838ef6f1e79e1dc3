# SPDX-License-Identifier: MIT
"""A pose laid onto the walls of a map, from one start or from all over the map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid
from slamcli.localization import _refinement_kernels as kernels
from slamcli.localization import _weight_kernels as weight_kernels
from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.localization.likelihood_field import LocalizationMap

_NOISE_M = 0.3
"""Standard deviation of one reading about a wall of the map; more than the scanner's, for neighbours err alike."""
_COARSE_M, _FINE_M = 0.4, 0.15
"""Readings much farther from walls than this pull less and less, far from the answer and close to it."""
_COARSE_CELLS, _FINE_CELLS, _SPARE_CELLS = 2.0, 1.0, 2.0
"""At least so many cells: what beams meet is the edge of a cell, and distances are to its centre."""
_ITERATIONS = 10
_FARTHEST, _PER_DISTANCE = 9.0, 0.01
"""Squared Mahalanobis distance that a refined pose may lie from what the particles say; so much fit weighs one unit of it up."""
_LEAST_VARIANCE = np.array([1e-4, 1e-4, 3e-5])
_FEWEST_POINTS = 10
_TRIED, _KEPT = 200, 30
_LOOSE = np.diag([4.0, 4.0, 33.0])
"""Holds a candidate to within about half a metre and ten degrees of where it was drawn."""
_SPARE_M = 0.3
"""A wall so close to the end of a beam is the one that it met."""
_APART_M, _APART_RAD = 0.3, 0.2
"""Candidates closer than both count as one."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """A pose at which a scan lies on the walls."""

    pose: Array
    """float64 (3,), map frame."""
    fit: float
    """How well the scan lies on the walls there: 1 if all readings do, 0 if none."""


def tells_enough(points: Array) -> bool:
    """Whether points (M, 2) are enough to place a scan by."""
    return len(points) >= _FEWEST_POINTS


def fit_of(map_: LocalizationMap, points: Array, pose: Array) -> float:
    """Return how well points (M, 2) lie on walls seen from a pose (3,), 0 to 1."""
    at = pose.copy()
    return _refine(map_, points, pose, np.zeros((3, 3)), _scales(map_)[1], 0, at)


def agreement(map_: LocalizationMap, points: Array, poses: Array, fits: Array) -> Array:
    """Return how well `poses` (N, 3) explain points (M, 2), at most 1: their `fits` (N,) less the share of beams that pass through walls.

    Ends of beams alone would be explained by many a wrong place, where the beams pass through walls.
    """
    blocked = np.empty(len(poses))
    spare = max(_SPARE_M, _SPARE_CELLS * map_.grid.resolution_m)
    kernels.blocked_shares(points, np.ascontiguousarray(poses), map_.frame, map_.distances, spare, blocked)
    return np.asarray(fits - blocked)


def refine_pose(
    map_: LocalizationMap, points: Array, mean: Array, covariance: Array, starts: list[Array]
) -> Refined | None:
    """Return the pose near `mean` at which a scan lies best on the walls; None if there is none that the particles allow.

    Parameters
    ----------
    map_
        Where to look walls up.
    points
        float64 (M, 2), readings seen from the robot.
    mean, covariance
        What the particles say, (3,) and (3, 3).
    starts
        Poses (3,) to begin at.

    Notes
    -----
    Gauss-Newton with weights that fall with the distance from the walls; first a wide, then a narrow look. Where walls do not
    tell (along a corridor) the particles decide.
    """
    information = np.asarray(np.linalg.inv(covariance + np.diag(_LEAST_VARIANCE)), dtype=np.float64)
    best: Refined | None = None
    least = -np.inf
    for start in starts:
        pose, fit = start.copy(), 0.0
        for scale in _scales(map_):
            fit = _refine(map_, points, mean, information, scale, _ITERATIONS, pose)
        pose[2] = float(se2.wrap_angle(pose[2]))
        apart = pose - mean
        apart[2] = float(se2.wrap_angle(apart[2]))
        far = float(apart @ information @ apart)
        score = fit - _PER_DISTANCE * far
        if far <= _FARTHEST and score > least:
            best, least = Refined(pose, fit), score
    return best


def find_candidates(map_: LocalizationMap, points: Array, num: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return poses (K, 3) all over the map at which a scan lies best on the walls, and their `agreement` (K,), best first.

    Of `num` poses drawn over the free cells the best are refined; those that come out together count once.
    """
    poses = map_.random_poses(num, rng)
    coarse = np.ascontiguousarray(points[:: max(len(points) // 40, 1)])
    likely = np.empty(num)
    weight_kernels.field_cubes(poses, coarse, map_.frame, map_.field, map_.far, 0.0, likely)
    found = poses[np.argsort(-likely, kind="stable")[:_TRIED]]
    fits = np.empty(len(found))
    for scale in _scales(map_):
        kernels.refine_each(
            points, found, _LOOSE, map_.frame, map_.distances, map_.half_wall_m, _NOISE_M, scale, _ITERATIONS, fits
        )
    found[:, 2] = se2.wrap_angle(found[:, 2])
    chosen: list[int] = []
    for n in np.argsort(-fits, kind="stable"):
        apart = np.abs(found[chosen] - found[n])
        near = (np.hypot(apart[:, 0], apart[:, 1]) < _APART_M) & (np.abs(se2.wrap_angle(apart[:, 2])) < _APART_RAD)
        if len(chosen) < _KEPT and not near.any() and map_.is_free(found[n, :2]):
            chosen.append(int(n))
    agreements = agreement(map_, points, found[chosen], fits[chosen])
    order = np.argsort(-agreements, kind="stable")
    return found[chosen][order], agreements[order]


def _scales(map_: LocalizationMap) -> tuple[float, float]:
    """Return the wide and the narrow look, metres."""
    cell = map_.grid.resolution_m
    return max(_COARSE_M, _COARSE_CELLS * cell), max(_FINE_M, _FINE_CELLS * cell)


def _refine(
    map_: LocalizationMap, points: Array, prior: Array, information: Array, scale: float, iterations: int, pose: Array
) -> float:
    return float(
        kernels.refine(
            points, prior, information, map_.frame, map_.distances, map_.half_wall_m, _NOISE_M, scale, iterations, pose
        )
    )


def warm() -> None:
    """Compile the kernels of this module."""
    cells = np.zeros((40, 40), dtype=np.int8)
    cells[:2] = OccupancyGrid.OCCUPIED
    map_ = LocalizationMap.of(OccupancyGrid(cells, 0.1), AmclParameters())
    points = np.ones((_FEWEST_POINTS, 2))
    refine_pose(map_, points, np.ones(3), np.eye(3), [np.ones(3)])
    find_candidates(map_, points, _TRIED, np.random.default_rng(0))
