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
_LEAK = 0.03
"""Share of what walls tell across that noisy points on them seem to tell along."""
_FOUND_SIGMAS = np.array([0.3, 0.3, 0.1])
"""Metres and radians by which an alignment is held to what a search found."""


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
    start: Floats
    """float64 (3,), where the alignment began: at the guess, or at what a search found."""
    quality: float
    """0 to 1: share of the beams that lie on a known surface, weighted by how near."""
    information: Floats
    """float64 (3, 3), what the points tell of x, y, yaw, along the axes of the merged scans' frame, if all were independent; along
    a straight wall they tell nothing."""
    agreement: BeamAgreement
    searched: bool
    """Whether it was found by a search over a window."""
    spread: Floats
    """float64 (2, 2), m^2: covariance of the positions about it at which the scan fits about as well, where it was searched; zeros
    where not."""

    @property
    def complexity(self) -> float:
        """0 where walls tell the position along one direction only (a corridor), 1 where along all directions alike."""
        least, most = np.linalg.eigvalsh(self.information[:2, :2])
        return float(2.0 * max(least, 0.0) / max(least + most, 1e-12))


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """How far about a guess a scan is searched for."""

    reach_m: float
    reach_rad: float
    least_score: float = 0.45
    """Mean probability, 0.1 to 0.9, of the cells that its points must fall in."""


class MergedScans:
    """A local map of scans that were seen from poses known relative to each other.

    Parameters
    ----------
    poses : float64 (K, 3), of the base at each scan in one frame, K >= 1.
    scans : K scans.
    cell_m : of the map, metres.
    tangent : share of what points tell along a wall that moves a scan (0: they glide along it, 1: they rest on single cells).
    """

    def __init__(
        self, poses: Floats, scans: Sequence[PlanarScan], *, cell_m: float = 0.05, tangent: float = 1.0
    ) -> None:
        self._poses, self._scans, self._tangent = poses, tuple(scans), tangent
        low, high = poses[:, :2].min(axis=0), poses[:, :2].max(axis=0)
        self._maps = TiledMaps(1, cell_m, (low[0] - 10.0, low[1] - 10.0, high[0] + 10.0, high[1] + 10.0))
        for pose, scan in zip(poses, self._scans, strict=True):
            ends = np.concatenate([scan.points, scan.free])
            hit = np.arange(len(ends)) < len(scan.points)
            self._maps.add_scan(pose.reshape(1, 3), scan.start.reshape(1, 2), ends, hit)
        self._grid: ProbabilityGrid | None = None
        self._precomputed: PrecomputedGrids | None = None

    def align(self, scan: PlanarScan, guess: Floats, sigmas: Floats) -> PlanarMatch:
        """Return where a scan lies best, near a guess.

        Parameters
        ----------
        guess : float64 (3,), x, y, yaw in the merged scans' frame.
        sigmas : float64 (3,), standard deviations of the guess by which the result is held to it.
        """
        prior = 1.0 / sigmas**2
        rough = surface_aligner(
            self._maps, scan.points, SurfaceAlignment(window=2, noise_m=0.04, tangent=0.3 * self._tangent)
        )
        *pose, _ = rough(guess, guess, prior)
        fine = surface_aligner(self._maps, scan.points, SurfaceAlignment(tangent=self._tangent))
        *pose, quality = fine(np.array(pose), guess, prior)
        found = np.array(pose)
        found[2] = math.remainder(found[2], math.tau)
        return PlanarMatch(
            pose=found, start=guess, quality=quality, information=self._information(scan, found),
            agreement=compare_beams(self._maps, scan.points, scan.start, found), searched=False, spread=np.zeros((2, 2)),
        )  # fmt: skip

    def search(self, scan: PlanarScan, around: Floats, guess: Floats, window: Window) -> PlanarMatch | None:
        """Return where a scan lies best within a window about a guess (3,); None where nothing fits.

        Parameters
        ----------
        around : float64 (K, 2), further points, of scans before it, that must fit as well, base frame of `scan`.
        """
        points = _thinned(np.concatenate([scan.points, around]))
        if len(points) == 0:
            return None
        grid, grids = self._search_grids()
        found = grids.search(
            points, guess, linear_m=window.reach_m, angular_rad=window.reach_rad, min_score=window.least_score
        )
        if found is None:
            return None
        pose, _ = found
        spread = position_spread(grid, points, pose, max(window.reach_m, _SPREAD_WINDOW_M))
        return replace(self.align(scan, pose, _FOUND_SIGMAS), searched=True, spread=spread)

    def agreement(self, scan: PlanarScan, pose: Floats) -> BeamAgreement:
        """Return how a scan seen from a pose (3,) agrees with the map."""
        return compare_beams(self._maps, scan.points, scan.start, pose)

    def _search_grids(self) -> tuple[ProbabilityGrid, PrecomputedGrids]:
        """Return the same scans as probabilities on coarser cells, and their maxima."""
        if self._grid is None or self._precomputed is None:
            grid = ProbabilityGrid.empty(_SEARCH_CELL_M, (float(self._poses[0, 0]), float(self._poses[0, 1])))
            for pose, scan in zip(self._poses, self._scans, strict=True):
                grid = _ODDS.insert(grid, pose, scan.start, scan.points, scan.free)
            self._grid = grid.cropped()
            self._precomputed = PrecomputedGrids(self._grid, _SEARCH_DEPTH)
        return self._grid, self._precomputed

    def _information(self, scan: PlanarScan, pose: Floats) -> Floats:
        normal, held = np.zeros((3, 3)), np.full(3, 1e-3)
        once = SurfaceAlignment(tangent=0.0, max_iterations=1)
        surface_aligner(self._maps, scan.points, once, normal)(pose, pose, held)
        upper = normal - np.diag(held)
        return _without_leak(np.triu(upper) + np.triu(upper, 1).T)


def _without_leak(information: Floats) -> Floats:
    """Return information (3, 3) without what noise seems to tell along straight walls: a small share of what they tell across."""
    values, axes = np.linalg.eigh(information[:2, :2])
    least = max(float(values[0]) - _LEAK * float(values[1]), 0.0)
    shares = np.array([math.sqrt(least / max(float(values[0]), 1e-12)), 1.0])
    kept = np.eye(3)
    kept[:2, :2] = (axes * shares) @ axes.T
    return kept @ information @ kept


def _thinned(points: Floats) -> Floats:
    """Return every n-th point, so that a search of them is fast."""
    return np.ascontiguousarray(points[:: max(1, math.ceil(len(points) / _SEARCH_POINTS))])
