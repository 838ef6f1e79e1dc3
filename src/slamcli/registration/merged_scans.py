# SPDX-License-Identifier: MIT
"""Planar scans merged into one local map, and the place of another scan in it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.grids.probability_grid import OddsInserter, ProbabilityGrid
from slamcli.grids.tiles import TiledMaps
from slamcli.registration.agreement import BeamAgreement, compare_beams
from slamcli.registration.branch_and_bound import PrecomputedGrids
from slamcli.registration.grid_matching import position_spread
from slamcli.registration.tile_matching import SurfaceAlignment, surface_aligner

Floats = NDArray[np.float64]

_SEARCH_CELL_M = 0.1
_SEARCH_DEPTH = 6
_SEARCH_POINTS = 150
_ODDS = OddsInserter(hit_probability=0.7, miss_probability=0.4)
_SPREAD_WINDOW_M = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class PlanarScan:
    """One scan in the plane, base frame, metres."""

    points: Floats
    """float64 (N, 2), where beams hit."""
    start: Floats
    """float64 (2,), where they start."""
    free: Floats
    """float64 (M, 2), how far beams that met nothing are known to be free."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanarMatch:
    """A scan's place in merged scans."""

    pose: Floats
    """float64 (3,), x, y, yaw of the base in the merged scans' frame."""
    quality: float
    """0 to 1: share of the beams that lie on a known surface, weighted by how near."""
    information: Floats
    """float64 (3, 3), what the points tell of x, y, yaw, along the axes of the merged scans' frame, if all were independent; along
    a straight wall they tell nothing."""
    agreement: BeamAgreement
    searched: bool
    """Whether it was found by a search over a window."""
    support: BeamAgreement | None = None
    spread: Floats | None = None
    """float64 (2, 2), m^2: covariance of the positions in the window at which it fits about as well, where it was searched."""


class MergedScans:
    """A local map of scans that were seen from poses known relative to each other."""

    def __init__(self, poses: Floats, scans: Sequence[PlanarScan], *, cell_m: float = 0.05) -> None:
        self._poses, self._scans = poses, tuple(scans)
        low, high = poses[:, :2].min(axis=0), poses[:, :2].max(axis=0)
        self._maps = TiledMaps(1, cell_m, (low[0] - 10.0, low[1] - 10.0, high[0] + 10.0, high[1] + 10.0))
        for pose, scan in zip(poses, self._scans, strict=True):
            ends = np.concatenate([scan.points, scan.free])
            hit = np.arange(len(ends)) < len(scan.points)
            self._maps.add_scan(pose.reshape(1, 3), scan.start.reshape(1, 2), ends, hit)
        self._grid: ProbabilityGrid | None = None

    @property
    def search_grid(self) -> ProbabilityGrid:
        """The same scans as probabilities, on coarser cells."""
        if self._grid is None:
            grid = ProbabilityGrid.empty(_SEARCH_CELL_M, (float(self._poses[0, 0]), float(self._poses[0, 1])))
            for pose, scan in zip(self._poses, self._scans, strict=True):
                grid = _ODDS.insert(grid, pose, scan.start, scan.points, scan.free)
            self._grid = grid.cropped()
        return self._grid

    def align(self, scan: PlanarScan, guess: Floats, sigmas: Floats) -> PlanarMatch:
        """Return where a scan lies best, near a guess.

        Parameters
        ----------
        guess : float64 (3,), x, y, yaw in the merged scans' frame.
        sigmas : float64 (3,), standard deviations of the guess by which the result is held to it.
        """
        prior = 1.0 / sigmas**2
        rough = surface_aligner(self._maps, scan.points, SurfaceAlignment(window=2, noise_m=0.04, tangent=0.3))
        *pose, _ = rough(guess, guess, prior)
        fine = surface_aligner(self._maps, scan.points, SurfaceAlignment())
        *pose, quality = fine(np.array(pose), guess, prior)
        found = np.array(pose)
        return PlanarMatch(
            pose=found, quality=quality, information=self._information(scan, found),
            agreement=compare_beams(self._maps, scan.points, scan.start, found), searched=False,
        )  # fmt: skip

    def search(
        self, scan: PlanarScan, around: Floats, guess: Floats, reach_m: float, reach_rad: float, *, least_score: float
    ) -> PlanarMatch | None:
        """Return where a scan lies best within a window about a guess; None where nothing fits.

        Parameters
        ----------
        around : float64 (K, 2), further points, of scans before it, that must fit as well, base frame of `scan`.
        """
        points = _thinned(np.concatenate([scan.points, around]))
        found = PrecomputedGrids(self.search_grid, _SEARCH_DEPTH).search(
            points, guess, linear_m=reach_m, angular_rad=reach_rad, min_score=least_score
        )
        if found is None:
            return None
        pose, _ = found
        spread = position_spread(self.search_grid, points, pose, max(reach_m, _SPREAD_WINDOW_M))
        return replace(self.align(scan, pose, np.array([0.3, 0.3, 0.1])), searched=True, spread=spread)

    def agreement(self, scan: PlanarScan, pose: Floats) -> BeamAgreement:
        """Return how a scan seen from a pose agrees with the map."""
        return compare_beams(self._maps, scan.points, scan.start, pose)

    def _information(self, scan: PlanarScan, pose: Floats) -> Floats:
        normal = np.zeros((3, 3))
        held = np.full(3, 1e-3)
        surface_aligner(self._maps, scan.points, SurfaceAlignment(tangent=0.0, max_iterations=1), normal)(
            pose, pose, held
        )
        upper = normal - np.diag(held)
        return np.triu(upper) + np.triu(upper, 1).T


def _thinned(points: Floats) -> Floats:
    """Return every n-th point, so that a search of them is fast."""
    return np.ascontiguousarray(points[:: max(1, math.ceil(len(points) / _SEARCH_POINTS))])
