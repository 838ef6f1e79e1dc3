# SPDX-License-Identifier: MIT
"""Local SLAM in the plane: each scan is matched with the current submap and drawn into it (Hess et al., ICRA 2016, IV)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.parameters import TrajectoryBuilder2d
from slamcli.cartographer.range_data import RangeData
from slamcli.cartographer.submaps_2d import ActiveSubmaps2d
from slamcli.registration.grid_matching import (
    CorrelativeMatch,
    LeastSquaresMatch,
    match_correlative,
    match_least_squares,
    mean_probability,
)
from slamcli.registration.voxel_filter import adaptive_voxel_filter, voxel_filter
from slamcli.trajectory.bending import as_pose, compose

LOST_M = 0.5
"""Where the way between two nodes is more uncertain than this, new submaps begin."""
_MIN_POINTS = 10
"""A scan of fewer points says too little of where it was taken."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalNode:
    """A scan that was drawn into submaps."""

    scan: int
    """Index of the scan."""
    pose: NDArray[np.float64]
    """float64 (3,), in the local frame."""
    points: NDArray[np.float64]
    """float64 (N, 2), thinned returns for the search of loops, in the plane of the tracking frame, metres."""
    submaps: tuple[int, ...]
    """Numbers of the submaps that hold it, the older one first."""


@dataclass(frozen=True, slots=True)
class LocalStep:
    """How one scan was placed."""

    score: float
    """Mean probability under its points in the submap, 0 where it was not matched."""
    shift_m: float
    """How far the match moved it from the prediction."""
    turn_rad: float


class LocalSlam2d:
    """Places scans one after the other in the local frame."""

    def __init__(self, parameters: TrajectoryBuilder2d, pose: NDArray[np.float64]) -> None:
        self._parameters = parameters
        odometry = parameters.scan_odometry
        trust = odometry.trust if odometry.enabled else 1.0
        self.pose = pose
        self.submaps = ActiveSubmaps2d(parameters.submaps)
        self.nodes: list[LocalNode] = []
        self.steps: list[LocalStep] = []
        self._last: tuple[int, NDArray[np.float64]] | None = None
        ceres = parameters.ceres_scan_matcher
        self._match = LeastSquaresMatch(
            occupied_space_weight=ceres.occupied_space_weight,
            translation_weight=trust * ceres.translation_weight,
            rotation_weight=trust * ceres.rotation_weight,
            max_num_iterations=ceres.ceres_solver_options.max_num_iterations,
        )
        window = parameters.real_time_correlative_scan_matcher
        self._window = CorrelativeMatch(
            linear_search_window_m=window.linear_search_window,
            angular_search_window_rad=window.angular_search_window,
            translation_delta_cost_weight=window.translation_delta_cost_weight,
            rotation_delta_cost_weight=window.rotation_delta_cost_weight,
        )

    def step(self, scan: int, stamp_ns: int, data: RangeData, motion: NDArray[np.float64]) -> None:
        """Place the next scan; `motion` (3,) is predicted since the last one."""
        p = self._parameters
        predicted = np.array(compose(as_pose(self.pose), motion))
        thinned = data.returns[voxel_filter(data.returns, p.voxel_filter_size)]
        self.pose = self._matched(thinned, predicted)
        moved = self.pose - predicted
        submap = self.submaps.matching
        score = 0.0 if submap is None or len(thinned) == 0 else mean_probability(submap.grid, thinned, self.pose)
        self.steps.append(LocalStep(score, math.hypot(moved[0], moved[1]), abs(moved[2])))
        if len(thinned) > 0 and self._has_moved(stamp_ns):
            self._insert(scan, stamp_ns, RangeData(data.start, thinned, data.misses))

    def restart(self) -> None:
        """Begin new submaps with the next scan: how the robot came there is too uncertain for one map."""
        for submap in self.submaps.active:
            if not submap.finished:
                self.submaps.finish(submap)
        self.submaps.active.clear()
        self._last = None

    def finish(self) -> None:
        """Finish the submaps that are still open: the recording has ended."""
        self.restart()

    def _matched(self, points: NDArray[np.float64], predicted: NDArray[np.float64]) -> NDArray[np.float64]:
        submap, f = self.submaps.matching, self._parameters.adaptive_voxel_filter
        chosen = points[adaptive_voxel_filter(points, f.max_length, f.min_num_points, f.max_range)]
        if submap is None or len(chosen) < _MIN_POINTS:
            return predicted
        start = predicted
        if self._parameters.use_online_correlative_scan_matching:
            start, _ = match_correlative(submap.grid, chosen, predicted, self._window)
        prior = np.append(predicted[:2], start[2])  # the search knows the heading better than the prediction
        pose, _ = match_least_squares(submap.grid, chosen, start, prior, self._match)
        return pose

    def _has_moved(self, stamp_ns: int) -> bool:
        """Whether the scan shows something new (the motion filter)."""
        if self._last is None:
            return True
        f, (stamp, pose) = self._parameters.motion_filter, self._last
        return (
            (stamp_ns - stamp) / 1e9 > f.max_time_seconds
            or math.hypot(self.pose[0] - pose[0], self.pose[1] - pose[1]) > f.max_distance_meters
            or abs(math.remainder(self.pose[2] - pose[2], math.tau)) > f.max_angle_radians
        )

    def _insert(self, scan: int, stamp_ns: int, data: RangeData) -> None:
        f = self._parameters.loop_closure_adaptive_voxel_filter
        chosen = data.returns[adaptive_voxel_filter(data.returns, f.max_length, f.min_num_points, f.max_range)]
        inserted = self.submaps.insert(len(self.nodes), self.pose, data)
        self.nodes.append(LocalNode(scan, self.pose.copy(), chosen, tuple(submap.number for submap in inserted)))
        self._last = (stamp_ns, self.pose.copy())
