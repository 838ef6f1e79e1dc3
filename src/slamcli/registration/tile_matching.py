# SPDX-License-Identifier: MIT
"""Alignment of scans with tiled maps: the hill climb of gmapping, its likelihood, and a Gauss-Newton alignment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.grids.tiles import TiledMaps
from slamcli.registration import _tile_kernels as kernels


@dataclass(frozen=True, slots=True, kw_only=True)
class HillClimb:
    """Settings of the greedy match; names and meaning as in gmapping's ScanMatcher."""

    window: int = 1
    """Half window in which an end point looks for a hit cell, cells."""
    fullness: float = 0.1
    """Share of hits over which a cell is an obstacle."""
    free_check_m: float = 0.0
    """Where positive: the cell this far before the end point must not be an obstacle, or the beam does not count."""
    sigma: float = 0.05
    lsigma: float = 0.075
    lstep_m: float = 0.05
    astep_rad: float = 0.05
    iterations: int = 5
    minimum_score: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceAlignment:
    """Settings of the Gauss-Newton alignment of points with the surface that neighbouring cells form."""

    window: int = 1
    fullness: float = 0.1
    noise_m: float = 0.02
    """Standard deviation that is added to the spread of the cells: keeps a perfect line from counting without limit."""
    scale: float = 4.0
    """Squared Mahalanobis distance at which a residual's weight is a half (Geman and McClure)."""
    tangent: float = 1.0
    """Share of the information along a surface that counts: 1 lets points rest on single cells of a wall, 0 lets them glide."""
    max_iterations: int = 12


def match_particles(
    maps: TiledMaps,
    points: NDArray[np.float64],
    directions: NDArray[np.float64],
    poses: NDArray[np.float64],
    climb: HillClimb,
    surface: SurfaceAlignment | None = None,
    information: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Match one scan with every map and move `poses` (N, 3) in place where the score is over the minimum.

    Parameters
    ----------
    points : float64 (B, 2), end points in the base frame, metres.
    directions : float64 (B, 2), unit vectors of the beams in the base frame.
    climb : settings of the hill climb, which comes first.
    surface : settings of the Gauss-Newton alignment that follows; None for none.
    information : float64 (3,), by which that alignment is drawn to the pose from which the climb began; None for 0.

    Returns
    -------
    scores, likelihoods : float64 (N,) each; a score is at most B.
    """
    scores, likelihoods = np.zeros(len(poses)), np.zeros(len(poses))
    x, y = maps.origin
    s, a = climb, surface or SurfaceAlignment(max_iterations=0)
    prior = np.zeros(3) if information is None else information

    def work(chunk: range) -> None:
        kernels.match_particles(
            maps.cells, maps.tables, x, y, maps.delta, points, directions, poses, scores, likelihoods, chunk.start, chunk.stop,
            s.window, s.fullness, s.free_check_m, s.sigma, s.lsigma, s.lstep_m, s.astep_rad, s.iterations, s.minimum_score,
            prior, a.noise_m, a.scale, a.max_iterations,
        )  # fmt: skip

    maps.each(work)
    return scores, likelihoods


def sample_likelihoods(maps: TiledMaps, points: NDArray[np.float64], directions: NDArray[np.float64], poses: NDArray[np.float64],
                       offsets: NDArray[np.float64], settings: HillClimb) -> NDArray[np.float64]:  # fmt: skip
    """Return the log likelihoods float64 (N, K) of a scan at each of N poses moved by each of K offsets (x, y, yaw)."""
    out = np.zeros((len(poses), len(offsets)))
    x, y = maps.origin
    s = settings

    def work(chunk: range) -> None:
        kernels.sample_likelihoods(
            maps.cells, maps.tables, x, y, maps.delta, points, directions, poses, offsets, out, chunk.start, chunk.stop,
            s.window, s.fullness, s.free_check_m, s.lsigma,
        )  # fmt: skip

    maps.each(work)
    return out


def surface_aligner(
    maps: TiledMaps, points: NDArray[np.float64], settings: SurfaceAlignment, hessian: NDArray[np.float64] | None = None
) -> Callable[..., tuple[float, float, float, float]]:
    """Return a function ``(start, prior, information) -> (x, y, yaw, quality)`` that aligns `points` with map 0 of `maps`.

    `start` and `prior` are poses (x, y, yaw), `information` the diagonal (3,) that draws the result to the prior;
    `quality` is between 0 and 1, the mean weight of the points. `hessian` (3, 3) gets the normal matrix of each result in
    its upper triangle: what points and prior together tell of x, y and yaw, along the map's axes.
    """
    view = (maps.cells, maps.tables[0], *maps.origin, maps.delta, 1.0 / maps.delta)
    s, normal = settings, np.zeros((3, 3)) if hessian is None else hessian

    def align(
        start: NDArray[np.float64], prior: NDArray[np.float64], information: NDArray[np.float64]
    ) -> tuple[float, float, float, float]:
        return kernels.align(
            view,
            points,
            start,
            prior,
            information,
            s.window,
            s.fullness,
            s.noise_m,
            s.scale,
            s.tangent,
            s.max_iterations,
            normal,
        )

    return align


def warm() -> None:
    """Compile the kernels of this module with inputs of one point."""
    maps = TiledMaps(1, 0.05, (-1.0, -1.0, 1.0, 1.0))
    point, poses = np.array([[0.5, 0.0]]), np.zeros((1, 3))
    maps.add_scan(poses, np.zeros((1, 2)), point, np.ones(1, np.bool_))
    maps.occupancy(0, 0.25, "map")
    match_particles(maps, point, point, poses, HillClimb())
    sample_likelihoods(maps, point, point, poses, np.zeros((1, 3)), HillClimb())
    surface_aligner(maps, point, SurfaceAlignment())(poses[0], poses[0], np.ones(3))
