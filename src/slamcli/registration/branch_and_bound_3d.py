# SPDX-License-Identifier: MIT
"""The pose of a cloud in a 3D probability grid, found by branch and bound over shifts and yaws.

References
----------
W. Hess, D. Kohler, H. Rapp, D. Andor, "Real-time loop closure in 2D LIDAR SLAM", ICRA 2016, doi:10.1109/ICRA.2016.7487258,
section V-B (algorithms 2 and 3, equation 13), in three dimensions as the Cartographer project does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion, se3
from slamcli.grids.hybrid_blocks import HybridBlocks, probability_of
from slamcli.grids.hybrid_grid import HybridGrid
from slamcli.registration import _bounds_3d_kernels as kernels
from slamcli.registration.rotational_histogram import rotation_scores


@dataclass(frozen=True, slots=True, kw_only=True)
class Search3D:
    """Settings as Cartographer's ``fast_correlative_scan_matcher_3d`` names them."""

    branch_and_bound_depth: int = 8
    full_resolution_depth: int = 3
    min_rotational_score: float = 0.77
    min_low_resolution_score: float = 0.55
    linear_xy_search_window: float = 5.0
    linear_z_search_window: float = 1.0
    angular_search_window: float = math.radians(15.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CloudForSearch:
    """What of a node is matched."""

    high_points_m: NDArray[np.float64]
    """float64 (N, 3), metres, in the node's frame."""
    low_points_m: NDArray[np.float64]
    rotational_histogram: NDArray[np.float32]
    """Of the gravity-aligned node."""
    gravity_alignment_xyzw: NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found3D:
    """The best pose of a search."""

    T_submap_node: NDArray[np.float64]
    score: float
    rotational_score: float
    low_resolution_score: float


class SubmapSearch3D:
    """Searches clouds in one submap; made once per submap, then used for all its candidates (thread-safe)."""

    def __init__(
        self,
        high_resolution: HybridGrid,
        low_resolution: HybridGrid,
        rotational_histogram: NDArray[np.float32],
        settings: Search3D,
    ) -> None:
        self._settings = settings
        self._resolution = high_resolution.resolution_m
        probability = probability_of(high_resolution.values)
        values = np.floor((probability - 0.1) * (255.0 / 0.8) + 0.5).astype(np.uint8)
        some = values > 0
        self._levels = kernels.build(
            high_resolution.indices[some], values[some], settings.branch_and_bound_depth, settings.full_resolution_depth
        )
        self._low = HybridBlocks.from_record(low_resolution)
        self._histogram = rotational_histogram
        indices = high_resolution.indices
        self._extent = (indices.min(axis=0), indices.max(axis=0)) if len(indices) else (np.zeros(3), np.zeros(3))

    def match(self, cloud: CloudForSearch, T_submap_initial: NDArray[np.float64], min_score: float) -> Found3D | str:
        """Search within the window around an initial pose; the reason, if nothing passes `min_score`."""
        s = self._settings
        return self._match(
            cloud,
            T_submap_initial,
            math.ceil(s.linear_xy_search_window / self._resolution),
            math.ceil(s.linear_z_search_window / self._resolution),
            s.angular_search_window,
            min_score,
        )

    def match_anywhere(
        self, cloud: CloudForSearch, T_submap_upright: NDArray[np.float64], min_score: float
    ) -> Found3D | str:
        """Search the whole submap at all yaws; of the initial pose only roll, pitch and height count."""
        low, high = self._extent
        reach = float(np.sqrt((cloud.high_points_m**2).sum(axis=1)).max(initial=0.0))
        start = T_submap_upright.copy()
        start[:2, 3] = (low[:2] + high[:2]) * 0.5 * self._resolution
        window = math.ceil(float((high - low)[:2].max()) / 2.0 + 0.5 * reach / self._resolution)
        z = math.ceil(self._settings.linear_z_search_window / self._resolution)
        return self._match(cloud, start, window, z, math.pi, min_score)

    def _match(
        self,
        cloud: CloudForSearch,
        T_submap_initial: NDArray[np.float64],
        xy: int,
        z: int,
        angular: float,
        min_score: float,
    ) -> Found3D | str:
        s, points, low_points = (
            self._settings,
            np.ascontiguousarray(cloud.high_points_m),
            np.ascontiguousarray(cloud.low_points_m),
        )
        if not len(points) or not len(cloud.low_points_m):
            return "no points"
        angles = self._angles(points, angular)
        upright = T_submap_initial[:3, :3] @ quaternion.to_matrix(cloud.gravity_alignment_xyzw).T
        yaw = math.atan2(upright[1, 0], upright[0, 0])
        turning = rotation_scores(self._histogram, cloud.rotational_histogram, yaw + angles)
        good = turning >= s.min_rotational_score
        if not good.any():
            return f"rotational score {turning.max():.2f}"
        turns = quaternion.to_matrix(quaternion.from_yaw(angles[good])) @ T_submap_initial[:3, :3]
        scans = np.empty((len(turns), len(points), 3), dtype=np.int64)
        shift = np.ascontiguousarray(T_submap_initial[:3, 3])
        kernels.discretise(points, turns, shift, self._resolution, scans)
        (score, turn, x, y, height, low), _, refused = kernels.search(
            scans, turns, shift, self._resolution, xy, z, s.branch_and_bound_depth, s.full_resolution_depth, min_score,
            *self._levels, low_points, self._low.resolution_m, self._low.keys, self._low.blocks, self._low.cells,
            s.min_low_resolution_score,
        )  # fmt: skip
        if score < 0:
            return "low-resolution score" if refused else "score"
        T = se3.from_rotation_translation(turns[turn], shift + np.array([x, y, height]) * self._resolution)
        return Found3D(
            T_submap_node=T,
            score=score,
            rotational_score=float(turning[good][turn]),
            low_resolution_score=low,
        )

    def _angles(self, points: NDArray[np.float64], window: float) -> NDArray[np.float64]:
        """Return the yaws of the window, in steps by which the farthest point moves no more than a cell (equation 7)."""
        reach = max(float(np.sqrt((points**2).sum(axis=1)).max()), 3.0 * self._resolution)
        step = 0.99 * math.acos(1.0 - self._resolution**2 / (2.0 * reach**2))
        count = round(window / step)
        return np.asarray(np.arange(-count, count + 1) * step, dtype=np.float64)


def warm() -> None:
    """Compile the kernels of this module."""
    grid = HybridBlocks(0.1)
    points = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    for _ in range(30):
        grid.insert(np.zeros(3), points, 0.55, 0.49, 1)
    record, histogram = grid.record(), np.ones(4, dtype=np.float32)
    cloud = CloudForSearch(
        high_points_m=points,
        low_points_m=points,
        rotational_histogram=histogram,
        gravity_alignment_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
    )
    settings = Search3D(
        branch_and_bound_depth=2, full_resolution_depth=1, linear_xy_search_window=0.2, linear_z_search_window=0.1
    )
    SubmapSearch3D(record, record, histogram, settings).match(cloud, np.eye(4), 0.5)
