# SPDX-License-Identifier: MIT
"""Alignment of a point cloud with the planes of a `SurfelMap` by Gauss-Newton with a robust weight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.grids.surfel_map import SurfelMap
from slamcli.registration import _surfel_kernels as kernels

_JUDGED_M = 0.05
"""With points so far off at most it is judged which directions are open: with more, what lies far off would count."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfelMatch:
    """Settings of the alignment of points with planes."""

    noise_m: float = 0.02
    """Standard deviation of a point's distance from a plane that is added to the plane's own thickness."""
    scale: float = 3.0
    """Distance, in standard deviations, at which a point's weight is a quarter (Geman and McClure)."""
    max_iterations: int = 30
    open_share: float = 0.008
    """Directions in which the planes hold less than this share of all they say are left to the prior."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurfelAlignment:
    """What an alignment found."""

    T_map_cloud: NDArray[np.float64]
    """float64 (4, 4)."""
    num_matched: int
    """Points that lie in a voxel with a plane."""
    agreement: float
    """Mean weight of the matched points, 0 (all far from their planes) to 1."""
    overlap: float
    """Matched points as a share of all."""
    information: NDArray[np.float64]
    """float64 (6, 6): of the shift in the map (metres), then of the rotation in the cloud's frame (radians)."""
    iterations: int
    open_directions: int
    """Directions of the shift of which the planes say next to nothing, 0 to 3."""


def align_with_surfels(
    surfels: SurfelMap,
    points_m: NDArray[np.float64],
    T_map_start: NDArray[np.float64],
    T_map_prior: NDArray[np.float64],
    prior_sigmas: tuple[float, float],
    loose_m: float,
    settings: SurfelMatch,
) -> SurfelAlignment:
    """Return the pose that lays points on the planes around them.

    Parameters
    ----------
    surfels
        The map.
    points_m
        float64 (N, 3), metres, in the cloud's frame.
    T_map_start
        float64 (4, 4), where the search begins.
    T_map_prior, prior_sigmas
        The pose to which the result is drawn, and the standard deviations (metres, radians) of it: where the planes leave a
        direction open (a corridor, an open field) it decides.
    loose_m
        How far the start may be off: added to the noise at first, and taken back step by step (graduated non-convexity).

    Notes
    -----
    Of the voxels around a point the largest that has a plane is taken. A plane further away than the largest voxel is not
    found, so that the start must be nearer than that.
    """
    points_m = np.ascontiguousarray(points_m, dtype=np.float64)
    rotation, shift = T_map_start[:3, :3].copy(), T_map_start[:3, 3].copy()
    information = np.zeros((6, 6))
    view = (surfels.size_m, surfels.levels, surfels.keys, surfels.rows, surfels.planes)
    kernels.information_at(
        points_m, rotation, shift, *view, settings.noise_m, settings.scale, min(loose_m, _JUDGED_M), information
    )
    prior = np.diag(np.repeat(1.0 / np.square(np.asarray(prior_sigmas, dtype=np.float64)), 3))
    held = _of_open_directions(information, settings.open_share)
    prior[:3, :3] += held
    matched, total, iterations = kernels.align(
        points_m, rotation, shift, np.ascontiguousarray(T_map_prior[:3, :3]), np.ascontiguousarray(T_map_prior[:3, 3]),
        prior, *view, settings.noise_m, settings.scale, loose_m, settings.max_iterations, information,
    )  # fmt: skip
    u, _, vt = np.linalg.svd(rotation)  # rounding must not add up over the iterations
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = u @ vt, shift
    return SurfelAlignment(
        T_map_cloud=T,
        num_matched=matched,
        agreement=total / matched if matched else 0.0,
        overlap=matched / len(points_m) if len(points_m) else 0.0,
        information=information,
        iterations=iterations,
        open_directions=int(np.linalg.matrix_rank(held)),
    )


def _of_open_directions(information: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Return prior information (3, 3) that keeps the shift along directions of which the planes say next to nothing.

    Of a long corridor the planes' normals, not quite right, still say a little along it, a thousand points of them more than
    any prior: what is under `share` of the whole is taken for that (cf. Zhang, Kaess, Singh, "On degeneracy of
    optimization-based state estimation problems", ICRA 2016, doi:10.1109/ICRA.2016.7487211).
    """
    total = float(np.trace(information[:3, :3]))
    if total <= 0.0:
        return np.zeros((3, 3))
    turn = information[3:, 3:] + 1e-9 * total * np.eye(3)
    known = information[:3, :3] - information[:3, 3:] @ np.linalg.solve(turn, information[3:, :3])
    values, vectors = np.linalg.eigh(0.5 * (known + known.T))
    unknown = vectors[:, values < share * total]
    held: NDArray[np.float64] = 1e3 * total * unknown @ unknown.T
    return held


def warm() -> None:
    """Compile the kernels of this module."""
    points = np.random.default_rng(0).random((20, 3)) * np.array([1.0, 1.0, 0.01])
    surfels = SurfelMap(1.0, 1)
    surfels.add(points)
    align_with_surfels(surfels, points, np.eye(4), np.eye(4), (1.0, 1.0), 0.1, SurfelMatch(max_iterations=1))
