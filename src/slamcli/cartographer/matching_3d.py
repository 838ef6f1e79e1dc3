# SPDX-License-Identifier: MIT
"""How a sweep is laid on what is known: with planes of a map that moves along, or with the submap's grids."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.parameters import CartographerParameters, CeresScanMatcher3d
from slamcli.cartographer.submaps_3d import ActiveSubmap
from slamcli.geometry import quaternion, se3
from slamcli.grids.surfel_map import SurfelMap
from slamcli.registration.surfel_matching import SurfelMatch, align_with_surfels
from slamcli.registration.volume_matching import VolumeMatch, align_with_volumes, search_window
from slamcli.registration.voxel_filter import adaptive_voxel_filter, voxel_filter

COARSEST_M = 1.0
"""Points for planes are thinned to at most this distance."""
START_OFF_M = 0.3
"""How far predictions may be off, at first; learnt from the matches."""
GOOD = 0.3
"""Share of the points that must agree with the planes: below, other starts are tried."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Match3D:
    """A matched pose and how good it is."""

    T_local_base: NDArray[np.float64]
    score: float
    """0 to 1: with planes the share of all points that agree with them, with grids one less the mean squared miss."""


class Matcher3D(Protocol):
    """A way to match sweeps."""

    def rows(self, points_m: NDArray[np.float32]) -> NDArray[np.int64]:
        """Return the rows of the points that are matched."""

    def match(
        self, points_m: NDArray[np.float64], T_predicted: NDArray[np.float64], submap: ActiveSubmap, *, again: bool
    ) -> Match3D:
        """Match points of those rows, base frame; `again` if the prediction is already a match."""

    def insert(self, points_m: NDArray[np.float64], T_local_base: NDArray[np.float64]) -> None:
        """Take points into the map that is matched with."""


class SurfelMatcher:
    """Matching with planes: one map that follows the robot, in the local frame."""

    def __init__(self, parameters: CartographerParameters) -> None:
        p = parameters.slamcli_3d
        self._map = SurfelMap(p.surfel_size, p.surfel_levels, p.surfel_capacity)
        self._settings = SurfelMatch(noise_m=p.point_noise)
        self._sigmas = (p.prior_translation, p.prior_rotation)
        self._num_points = p.matched_points
        self._reach_m = 1.5 * parameters.trajectory_builder_3d.max_range
        self._centre = np.zeros(3)
        self._off_m = START_OFF_M

    def rows(self, points_m: NDArray[np.float32]) -> NDArray[np.int64]:
        """Return the rows of points that are left at a distance that leaves about the number that is asked for."""
        rows = voxel_filter(points_m, COARSEST_M)
        if len(rows) >= self._num_points:
            return rows
        return adaptive_voxel_filter(points_m, COARSEST_M, self._num_points, np.inf)

    def match(
        self,
        points_m: NDArray[np.float64],
        T_predicted: NDArray[np.float64],
        submap: ActiveSubmap,  # noqa: ARG002 - as every Matcher3D
        *,
        again: bool,
    ) -> Match3D:
        """Match with planes; from other starts as well where the prediction leads nowhere."""
        found = self._from(T_predicted, points_m, T_predicted, 0.05 if again else self._off_m)
        if not again and found.score < GOOD:
            found = self._from_elsewhere(points_m, T_predicted, found)
        if not again:
            off = float(np.linalg.norm(found.T_local_base[:3, 3] - T_predicted[:3, 3]))
            self._off_m += 0.1 * (min(max(3.0 * off, 0.1), 2.0) - self._off_m)
        return found

    def insert(self, points_m: NDArray[np.float64], T_local_base: NDArray[np.float64]) -> None:
        """Add points to the map, which forgets what lies far behind."""
        self._map.add(points_m @ T_local_base[:3, :3].T + T_local_base[:3, 3])
        if np.abs(T_local_base[:3, 3] - self._centre).max() > 0.2 * self._reach_m:
            self._centre = T_local_base[:3, 3].copy()
            self._map.forget_beyond(self._centre, self._reach_m)

    def _from(
        self, T_start: NDArray[np.float64], points_m: NDArray[np.float64], T_prior: NDArray[np.float64], off_m: float
    ) -> Match3D:
        aligned = align_with_surfels(self._map, points_m, T_start, T_prior, self._sigmas, off_m, self._settings)
        return Match3D(T_local_base=aligned.T_map_cloud, score=aligned.agreement * aligned.overlap)

    def _from_elsewhere(
        self, points_m: NDArray[np.float64], T_predicted: NDArray[np.float64], found: Match3D
    ) -> Match3D:
        """Return the best match of starts turned to both sides, if it is clearly better."""
        best = found
        for yaw in (-0.4, -0.2, -0.1, 0.1, 0.2, 0.4):
            start = T_predicted.copy()
            start[:3, :3] = start[:3, :3] @ quaternion.to_matrix(quaternion.from_yaw(yaw))
            tried = self._from(start, points_m, start, 0.5)
            if tried.score > max(best.score, 1.3 * found.score):
                best = tried
        return best


class GridMatcher:
    """Matching as Cartographer does: least squares on the older submap's grids of two resolutions."""

    def __init__(self, parameters: CartographerParameters) -> None:
        p = parameters.trajectory_builder_3d
        self._high, self._low = p.high_resolution_adaptive_voxel_filter, p.low_resolution_adaptive_voxel_filter
        self._settings = volume_match(p.ceres_scan_matcher)

    def rows(self, points_m: NDArray[np.float32]) -> NDArray[np.int64]:
        """Return all rows: the adaptive filters thin points once they are unwarped."""
        return np.arange(len(points_m))

    def match(
        self,
        points_m: NDArray[np.float64],
        T_predicted: NDArray[np.float64],
        submap: ActiveSubmap,
        *,
        again: bool,  # noqa: ARG002 - as every Matcher3D
    ) -> Match3D:
        """Match with the submap's grids."""
        high = points_m[
            adaptive_voxel_filter(points_m, self._high.max_length, self._high.min_num_points, self._high.max_range)
        ]
        low = points_m[
            adaptive_voxel_filter(points_m, self._low.max_length, self._low.min_num_points, self._low.max_range)
        ]
        T = se3.inverse(submap.T_local_submap) @ T_predicted
        found, cost = align_with_volumes(
            high, low, submap.high_resolution, submap.low_resolution, T, T, self._settings
        )  # fmt: skip
        weights = self._settings.occupied_space_weight_0**2 + self._settings.occupied_space_weight_1**2
        score = 1.0 - 2.0 * cost / weights if weights else 0.0
        return Match3D(T_local_base=submap.T_local_submap @ found, score=float(np.clip(score, 0.0, 1.0)))

    def insert(self, points_m: NDArray[np.float64], T_local_base: NDArray[np.float64]) -> None:
        """Do nothing: the submaps are the map."""


def search_before(
    parameters: CartographerParameters,
    points_m: NDArray[np.float64],
    T_predicted: NDArray[np.float64],
    submap: ActiveSubmap,
) -> NDArray[np.float64]:
    """Return the best pose of the real-time correlative search around the prediction, (4, 4)."""
    p = parameters.trajectory_builder_3d
    f, s = p.high_resolution_adaptive_voxel_filter, p.real_time_correlative_scan_matcher
    points = points_m[adaptive_voxel_filter(points_m, f.max_length, f.min_num_points, f.max_range)]
    found, _ = search_window(
        points,
        submap.high_resolution,
        se3.inverse(submap.T_local_submap) @ T_predicted,
        s.linear_search_window,
        s.angular_search_window,
        (s.translation_delta_cost_weight, s.rotation_delta_cost_weight),
    )
    return submap.T_local_submap @ found


def volume_match(options: CeresScanMatcher3d) -> VolumeMatch:
    """Return the settings of the least squares from Cartographer's table."""
    return VolumeMatch(
        occupied_space_weight_0=options.occupied_space_weight_0,
        occupied_space_weight_1=options.occupied_space_weight_1,
        translation_weight=options.translation_weight,
        rotation_weight=options.rotation_weight,
        only_optimize_yaw=options.only_optimize_yaw,
        max_num_iterations=options.ceres_solver_options.max_num_iterations,
    )
