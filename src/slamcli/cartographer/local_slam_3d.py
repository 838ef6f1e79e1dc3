# SPDX-License-Identifier: MIT
"""Local SLAM in space: unwarp a sweep with the predicted motion, match it, put it into the submaps (Hess et al., IV)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.imu_track import ImuTrack
from slamcli.cartographer.matching_3d import GOOD, GridMatcher, Match3D, Matcher3D, SurfelMatcher, search_before
from slamcli.cartographer.parameters import CartographerParameters
from slamcli.cartographer.pose_extrapolator_3d import PoseExtrapolator3D, rotation_vector
from slamcli.cartographer.submaps_3d import ActiveSubmap, ActiveSubmaps3D, FinishedSubmap, ScanForSubmaps
from slamcli.cartographer.sweep_3d import Sweep, corrected
from slamcli.geometry import quaternion, se3
from slamcli.posegraph import Id
from slamcli.registration.rotational_histogram import rotational_histogram
from slamcli.registration.voxel_filter import adaptive_voxel_filter
from slamcli.runtime import RunLog

FEWEST_POINTS = 20
"""Fewer points than this are not matched."""
LOST = 0.15
"""A match with a lower score says hardly where the robot is: ten in a row are warned of."""
BLIND_NS = 10_000_000_000
"""After so long without points it is said."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LocalNode:
    """A sweep that was put into submaps."""

    id: Id
    stamp_ns: int
    T_local_base: NDArray[np.float64]
    gravity_alignment_xyzw: NDArray[np.float64]
    points_m: NDArray[np.float64]
    """float64 (N, 3), all points of the sweep, base frame at its end."""
    intensities: NDArray[np.float32]
    origin_m: NDArray[np.float64]
    high_points_m: NDArray[np.float32]
    low_points_m: NDArray[np.float32]
    rotational_histogram: NDArray[np.float32]
    submaps: tuple[Id, ...]
    """Those it was put into, the older first."""
    T_submap_node: tuple[NDArray[np.float64], ...]
    finished: FinishedSubmap | None
    """The submap that it completed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LocalStep:
    """What became of a sweep."""

    cloud_poses: NDArray[np.float64]
    """float64 (C, 4, 4), ``T_local_base`` at the stamp of each cloud."""
    score: float
    """Of the match; NaN if there was none."""
    num_points: int
    node: LocalNode | None
    """None if the robot has hardly moved since the last node, or nothing was seen."""


class LocalSlam3D:
    """One trajectory of local SLAM."""

    def __init__(
        self,
        parameters: CartographerParameters,
        trajectory: int,
        log: RunLog,
        *,
        expect_imu: bool,
        first_submap: int = 0,
        first_node: int = 0,
    ) -> None:
        self._p, self._log, self._trajectory = parameters, log, trajectory
        builder = parameters.trajectory_builder_3d
        self.imu = ImuTrack(builder.pose_extrapolator.constant_velocity.imu_gravity_time_constant, log)
        self.extrapolator = PoseExtrapolator3D(self.imu)
        self.submaps = ActiveSubmaps3D(trajectory, builder.submaps, builder.rotational_histogram_size, first_submap)
        surfels = parameters.slamcli_3d.scan_matcher == "surfel"
        self._matcher: Matcher3D = SurfelMatcher(parameters) if surfels else GridMatcher(parameters)
        self._expect_imu = expect_imu
        self._next_node = first_node
        self._last_node: tuple[int, NDArray[np.float64]] | None = None
        self._lost = 0
        self._blind_since_ns = 0  # the last pose before the blindness that was last told of

    def add_sweep(self, sweep: Sweep) -> LocalStep:
        """Match the next sweep and put it into the submaps if the robot has moved."""
        before_ns, submap = self.extrapolator.stamp_ns, self.submaps.matching
        first = before_ns is None
        usable = len(sweep.points_m) >= FEWEST_POINTS
        if first and usable:
            self._begin(sweep)
        knots = sweep.knots_ns()
        predicted = self.extrapolator.poses(knots)
        if not usable:
            self._log.counts["sweeps with too few points within range"] += 1
            if before_ns is not None and sweep.end_ns - before_ns > BLIND_NS and self._blind_since_ns != before_ns:
                self._blind_since_ns = before_ns
                self._log.warn(f"the range sensor sees nothing for more than 10 s from {before_ns / 1e9:.3f} s on")
            return self._step(sweep, knots, predicted, math.nan, None)
        if before_ns is None or submap is None:
            poses, score = predicted, 1.0
        else:
            poses, score = self._match(sweep, knots, predicted, submap, before_ns)
        points = sweep.unwarped(poses)
        self.extrapolator.add_pose(sweep.end_ns, poses[-1])
        node = self._insert(sweep, poses[-1], points)
        return self._step(sweep, knots, poses, score, node)

    def _begin(self, sweep: Sweep) -> None:
        """Set the first pose: level as gravity says, otherwise as the base stands."""
        up = self.imu.up_at_start(sweep.begin_ns - 1_000_000_000, sweep.end_ns)
        if up is None and len(self.imu) == 0:
            missing = "no IMU data has come before the first scan" if self._expect_imu else "there is no IMU"
            self._log.warn(
                f"{missing}: the start is taken as level, rotation is predicted from the motion before (or odometry),"
                " and the scans alone hold roll and pitch"
            )
        T = np.eye(4)
        if up is not None:
            T[:3, :3] = upright_rotation(up)
        # All of the first sweep counts as seen from one place: how fast it moved is not known yet.
        self.extrapolator.add_pose(sweep.end_ns, T)

    def _match(
        self,
        sweep: Sweep,
        knots: NDArray[np.int64],
        predicted: NDArray[np.float64],
        submap: ActiveSubmap,
        before_ns: int,
    ) -> tuple[NDArray[np.float64], float]:
        """Return the poses at the knots (K, 4, 4) after matching, and the match's score."""
        rows = self._matcher.rows(sweep.points_m)
        points, start = sweep.unwarped(predicted, rows), predicted[-1]
        if self._p.trajectory_builder_3d.use_online_correlative_scan_matching:
            start = search_before(self._p, points, start, submap)
        match = self._matcher.match(points, start, submap, again=False)
        # Once more, unwarped with the motion that this found.
        poses = corrected(predicted, knots, before_ns, match.T_local_base)
        match = self._matcher.match(sweep.unwarped(poses, rows), poses[-1], submap, again=True)
        poses = corrected(predicted, knots, before_ns, match.T_local_base)
        self._watch(match, sweep)
        self._teach(sweep, before_ns, predicted[-1], match)
        return poses, match.score

    def _watch(self, match: Match3D, sweep: Sweep) -> None:
        """Warn where scans fit what is known badly for a while."""
        self._lost = self._lost + 1 if match.score < LOST else 0
        if self._lost == 10:
            self._log.counts["stretches in which scans hardly fit the map"] += 1
            self._log.warn(
                f"from {sweep.begin_ns / 1e9:.3f} s on scans hardly fit the map (score {match.score:.2f}): the path may be off from"
                " there (too fast, too narrow a view, or moving surroundings)"
            )

    def _teach(self, sweep: Sweep, before_ns: int, predicted: NDArray[np.float64], match: Match3D) -> None:
        """Let the IMU's track learn from a good match."""
        if match.score < GOOD or len(self.imu) == 0:
            return
        rotation = match.T_local_base[:3, :3]
        plain = self.extrapolator.turn_by_constant_rate(sweep.end_ns)
        self.imu.learn(
            before_ns,
            sweep.end_ns,
            rotation_vector(predicted[:3, :3].T @ rotation),
            float(np.linalg.norm(rotation_vector(plain.T @ rotation))),
            rotation,
        )

    def _insert(self, sweep: Sweep, T_local_base: NDArray[np.float64], points: NDArray[np.float64]) -> LocalNode | None:
        if not self._moved(sweep.end_ns, T_local_base):
            return None
        self._last_node = (sweep.end_ns, T_local_base)
        self._matcher.insert(points, T_local_base)
        upright = upright_rotation(T_local_base[:3, :3].T @ self.imu.up_local)
        p = self._p.trajectory_builder_3d
        scan = ScanForSubmaps(
            node=Id(self._trajectory, self._next_node),
            T_local_base=T_local_base,
            points_m=points,
            origin_m=sweep.origin_m,
            rotational_histogram=rotational_histogram(points @ upright.T, p.rotational_histogram_size),
            local_from_gravity=T_local_base[:3, :3] @ upright.T,
        )
        self._next_node += 1
        into, done = self.submaps.insert(scan)
        high, low = p.high_resolution_adaptive_voxel_filter, p.low_resolution_adaptive_voxel_filter
        return LocalNode(
            id=scan.node,
            stamp_ns=sweep.end_ns,
            T_local_base=T_local_base,
            gravity_alignment_xyzw=quaternion.from_matrix(upright),
            points_m=points,
            intensities=sweep.intensities,
            origin_m=sweep.origin_m,
            high_points_m=_filtered(points, high.max_length, high.min_num_points, high.max_range),
            low_points_m=_filtered(points, low.max_length, low.min_num_points, low.max_range),
            rotational_histogram=scan.rotational_histogram,
            submaps=tuple(submap.id for submap in into),
            T_submap_node=tuple(se3.inverse(submap.T_local_submap) @ T_local_base for submap in into),
            finished=done,
        )

    def _moved(self, stamp_ns: int, T_local_base: NDArray[np.float64]) -> bool:
        """Whether enough time has passed or motion happened since the last node."""
        if self._last_node is None:
            return True
        before_ns, T_before = self._last_node
        limits = self._p.trajectory_builder_3d.motion_filter
        step = se3.inverse(T_before) @ T_local_base
        return (
            (stamp_ns - before_ns) * 1e-9 > limits.max_time_seconds
            or float(np.linalg.norm(step[:3, 3])) > limits.max_distance_meters
            or float(np.linalg.norm(rotation_vector(step[:3, :3]))) > limits.max_angle_radians
        )

    def _step(
        self,
        sweep: Sweep,
        knots: NDArray[np.int64],
        poses: NDArray[np.float64],
        score: float,
        node: LocalNode | None,
    ) -> LocalStep:
        nearest = np.clip(np.searchsorted(knots, sweep.cloud_stamps_ns), 0, len(knots) - 1)
        return LocalStep(cloud_poses=poses[nearest], score=score, num_points=len(sweep.points_m), node=node)


def upright_rotation(up_base: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation (3, 3) without yaw that turns the base so that `up_base` (3,), a unit vector, points along z."""
    roll = math.atan2(up_base[1], up_base[2])
    pitch = math.atan2(-up_base[0], math.hypot(up_base[1], up_base[2]))
    return quaternion.to_matrix(quaternion.from_roll_pitch_yaw(roll, pitch, 0.0))


def _filtered(points: NDArray[np.float64], length: float, number: float, reach: float) -> NDArray[np.float32]:
    filtered: NDArray[np.float32] = points[adaptive_voxel_filter(points, length, number, reach)].astype(np.float32)
    return filtered
