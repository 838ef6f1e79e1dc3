# SPDX-License-Identifier: MIT
"""Odometry from clouds in space: each is aligned with a local map of earlier ones (RTAB-Map: F2M with Reg/Strategy 1)."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.geometry import se3
from slamcli.geometry.motion import part_of
from slamcli.measurements import PointCloud
from slamcli.registration.cloud_icp import (
    CloudAlignment,
    CloudIcpSettings,
    PreparedCloud,
    align_prepared,
    prepare_cloud,
    with_normals,
)
from slamcli.rtabmap.node_input import OdometryStep
from slamcli.rtabmap.node_rate import motion_size
from slamcli.rtabmap.node_scans import node_scan, sweep_ns
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.scan_settings import ScanSettings
from slamcli.rtabmap.signature import NodeScan

Floats = NDArray[np.float64]

_FACTOR = 25.0
"""Points are not independent of each other: the covariance that they tell counts so many times."""
_WALK_M2, _WALK_M2_PER_M = 1e-6, 0.01**2
_WALK_RAD2, _WALK_RAD2_PER_M = 1e-7, 0.002**2
"""Variances by which each step drifts, and per metre of way."""
_LONGEST_PERIOD_S = 1.0
_KEYFRAME_M, _KEYFRAME_RAD = 0.4, 0.25
"""A cloud joins the local map after this way or turn too: what is seen from a sparse sensor changes sooner than its share of matches."""
_WALLS_M = 5.0
_GUESSES = 20
"""Guesses whose errors tell how far points are matched (KISS-ICP: adaptive threshold, Vizzo et al., RA-L 2023)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CloudOdometrySettings:
    """What odometry from clouds needs of the parameters."""

    scans: ScanSettings
    keyframe_ratio: float
    """A cloud of which fewer points are matched joins the local map (`Odom/ScanKeyFrameThr`)."""
    map_points: int
    """`OdomF2M/ScanMaxSize`; of the last keyframe alone with `Odom/Strategy` 1."""
    subtract_radius_m: float
    subtract_angle_rad: float
    map_range_m: float
    """`OdomF2M/ScanRange`; 0: the oldest points are dropped."""
    frame_to_frame: bool
    guess_motion: bool
    holonomic: bool
    reset_countdown: int
    deskewing: bool

    @classmethod
    def of(cls, parameters: RtabmapParameters) -> CloudOdometrySettings:
        """Return the settings that parameters ask for."""
        odom, f2m = parameters.odom, parameters.odom_f2m
        return cls(
            scans=ScanSettings.of(parameters), keyframe_ratio=odom.scan_key_frame_thr, map_points=f2m.scan_max_size,
            subtract_radius_m=f2m.scan_subtract_radius, subtract_angle_rad=math.radians(f2m.scan_subtract_angle),
            map_range_m=f2m.scan_range, frame_to_frame=odom.strategy == 1, guess_motion=odom.guess_motion,
            holonomic=odom.holonomic, reset_countdown=odom.reset_countdown, deskewing=odom.deskewing,
        )  # fmt: skip


class CloudOdometry:
    """Aligns clouds one after the other; drifts slowly, and knows no loops.

    A cloud that does not fit is lost: its step has no pose, and the next one is tried from where the guesses lead. After
    `Odom/ResetCountdown` of them the local map begins anew there.
    """

    def __init__(self, settings: CloudOdometrySettings) -> None:
        self._settings = settings
        self._icp = settings.scans.icp
        # The local map is thinned already.
        self._map_icp: CloudIcpSettings = replace(self._icp, filters=0)
        self._map: PreparedCloud | None = None
        self._pose = np.eye(4)
        self._last_ns: int | None = None
        self._motion: tuple[Floats, float] | None = None
        self._motion_before: tuple[Floats, float] | None = None
        self._keyframe = np.eye(4)
        self._errors_m: deque[float] = deque(maxlen=_GUESSES)
        self._lost = 0
        self.num_lost = 0
        """Clouds without a pose so far."""
        self.num_resets = 0

    def step(
        self, cloud: PointCloud, T_base_sensor: Floats, guess: Floats | None = None, no_return: str = "ignore"
    ) -> tuple[OdometryStep, NodeScan]:
        """Place the next cloud; returns where the robot was and the cloud freed of its motion.

        Parameters
        ----------
        T_base_sensor : float64 (4, 4), mount of the sensor.
        guess : float64 (4, 4), motion T_prev_cur of the base since the last cloud by wheels or inertial sensors; None: as it was.
        """
        s = self._settings
        seconds = 0.0 if self._last_ns is None else (cloud.stamp_ns - self._last_ns) / 1e9
        motion = self._predicted(guess, seconds)
        moved = self._during_sweep(cloud, motion if guess is not None else self._mean(motion, seconds), seconds)
        scan = node_scan(
            cloud, T_base_sensor, no_return, T_begin_end=moved, range_min_m=s.scans.range_min_m,
            range_max_m=s.scans.range_max_m,
        )  # fmt: skip
        predicted = self._pose @ motion
        step = self._placed(cloud.stamp_ns, scan, predicted)
        if step.T_odom_base is not None and not step.began_anew and seconds > 0.0 and self._last_ns is not None:
            self._motion_before = self._motion
            self._motion = (se3.inverse(self._pose) @ step.T_odom_base, seconds)
        self._pose = predicted if step.T_odom_base is None else step.T_odom_base
        self._last_ns = cloud.stamp_ns
        return step, scan

    def _predicted(self, guess: Floats | None, seconds: float) -> Floats:
        if guess is not None:
            return guess
        if self._motion is None or not self._settings.guess_motion or not 0.0 < seconds < _LONGEST_PERIOD_S:
            return np.eye(4)
        motion, took = self._motion
        return part_of(motion, seconds / took)

    def _mean(self, motion: Floats, seconds: float) -> Floats:
        """Return the mean of a motion that is predicted from the last one, and of the one before that.

        What a motion is wrong by straightens the next sweep wrongly, so that the motion to it is wrong to the other side, and so on without end
        where sweeps take the whole period. With the mean it dies out.
        """
        if self._motion_before is None or not 0.0 < seconds < _LONGEST_PERIOD_S:
            return motion
        before = part_of(self._motion_before[0], seconds / self._motion_before[1])
        return before @ part_of(se3.inverse(before) @ motion, 0.5)

    def _during_sweep(self, cloud: PointCloud, motion: Floats, seconds: float) -> Floats | None:
        """Return how the base moves while a cloud is measured, if it goes on as it did; None where that is not known."""
        if not self._settings.deskewing or not 0.0 < seconds < _LONGEST_PERIOD_S:
            return None
        return part_of(motion, sweep_ns(cloud) / 1e9 / seconds)

    def _placed(self, stamp_ns: int, scan: NodeScan, predicted: Floats) -> OdometryStep:
        try:
            source = prepare_cloud(self._settings.scans.cloud(scan), self._icp, side=2)
        except EstimationError:
            return self._gone(stamp_ns, 0, 0)
        if self._map is None:
            return self._begun(stamp_ns, source, began_anew=self._last_ns is not None)
        found = align_prepared(self._map, source, predicted, replace(self._icp, max_distance_m=self._reach()))
        if not self._believed(found, predicted):
            step = self._gone(stamp_ns, len(source), found.num_inliers)
            if self._settings.reset_countdown and self._lost >= self._settings.reset_countdown:
                self.num_resets += 1
                self.num_lost -= 1
                self._pose = predicted
                return self._begun(stamp_ns, source, began_anew=True)
            return step
        self._lost = 0
        self._errors_m.append(self._error(predicted, found.T_target_source))
        T = self._holonomic(found.T_target_source)
        way, turn = motion_size(se3.inverse(self._keyframe) @ T)
        keyframe = found.inlier_ratio < self._settings.keyframe_ratio or way > _KEYFRAME_M or turn > _KEYFRAME_RAD
        if keyframe:
            self._remember(source, T)
        return OdometryStep(
            stamp_ns=stamp_ns, T_odom_base=T, covariance=self._covariance(found, T), num_features=len(source),
            num_inliers=found.num_inliers, keyframe=keyframe,
        )  # fmt: skip

    def _believed(self, found: CloudAlignment, predicted: Floats) -> bool:
        s = self._settings.scans
        way, turn = motion_size(se3.inverse(predicted) @ found.T_target_source)
        refused = s.low_complexity == 0 and found.complexity < s.min_complexity
        return (
            found.inlier_ratio >= s.correspondence_ratio
            and way <= s.max_translation_m
            and turn <= s.max_rotation_rad
            and not refused
        )

    def _reach(self) -> float:
        """Return how far points are matched: by the errors of the last guesses, at most Icp/MaxCorrespondenceDistance."""
        farthest = self._icp.max_distance_m
        if self._lost or len(self._errors_m) < _GUESSES:
            return farthest
        rms = math.sqrt(sum(error**2 for error in self._errors_m) / len(self._errors_m))
        return min(farthest, max(3.0 * rms, 3.0 * self._icp.voxel_m, 0.1))

    def _error(self, predicted: Floats, found: Floats) -> float:
        """Return how far a guess moved points from where they are, metres, at a distance at which rooms have walls."""
        way, turn = motion_size(se3.inverse(predicted) @ found)
        return way + _WALLS_M * turn

    def _gone(self, stamp_ns: int, num_points: int, num_inliers: int) -> OdometryStep:
        self._lost += 1
        self.num_lost += 1
        return OdometryStep(
            stamp_ns=stamp_ns,
            T_odom_base=None,
            covariance=np.zeros((6, 6)),
            num_features=num_points,
            num_inliers=num_inliers,
        )

    def _begun(self, stamp_ns: int, source: PreparedCloud, *, began_anew: bool) -> OdometryStep:
        self._lost, self._map, self._motion, self._motion_before = 0, None, None, None
        self._remember(source, self._pose)
        return OdometryStep(
            stamp_ns=stamp_ns, T_odom_base=self._pose, covariance=np.zeros((6, 6)), began_anew=began_anew,
            num_features=len(source), num_inliers=len(source), keyframe=True,
        )  # fmt: skip

    def _holonomic(self, T: Floats) -> Floats:
        """Return a pose without what a robot that cannot move sideways did not do since the last one (Odom/Holonomic false)."""
        if self._settings.holonomic:
            return T
        motion = se3.inverse(self._pose) @ T
        motion[1, 3] = motion[0, 3] * math.tan(math.atan2(motion[1, 0], motion[0, 0]))
        return self._pose @ motion

    def _covariance(self, found: CloudAlignment, T: Floats) -> Floats:
        way = float(np.linalg.norm(T[:3, 3] - self._pose[:3, 3]))
        walk = np.diag([_WALK_M2 + _WALK_M2_PER_M * way] * 3 + [_WALK_RAD2 + _WALK_RAD2_PER_M * way] * 3)
        axes = np.zeros((6, 6))
        axes[:3, :3] = axes[3:, 3:] = self._pose[:3, :3].T
        return _FACTOR * axes @ found.covariance @ axes.T + walk

    def _remember(self, source: PreparedCloud, T: Floats) -> None:
        """Add to the local map what is new."""
        s = self._settings
        self._keyframe = T
        points = source.points @ T[:3, :3].T + T[:3, 3]
        if self._map is None or s.frame_to_frame:
            merged = points
        else:
            fresh = points if s.subtract_radius_m <= 0.0 else points[self._is_new(source, points, T)]
            merged = np.concatenate([self._map.points, fresh])
            if s.map_range_m > 0.0:
                merged = merged[np.linalg.norm(merged - T[:3, 3], axis=1) <= s.map_range_m]
        self._map = prepare_cloud(merged[-s.map_points :], self._map_icp, side=1)

    def _is_new(self, source: PreparedCloud, points: Floats, T: Floats) -> NDArray[np.bool_]:
        """Return which points have no point of the local map near that lies on a surface of about the same direction."""
        assert self._map is not None  # noqa: S101  (asked only where there is one)
        s = self._settings
        indices, squared = (np.asarray(a) for a in self._map.tree.batch_nearest_neighbor_search(points, num_threads=1))
        new: NDArray[np.bool_] = squared > s.subtract_radius_m**2
        if s.subtract_angle_rad > 0.0:
            source = with_normals(source, self._icp)
            normals = np.asarray(source.cloud.normals())[:, :3] @ T[:3, :3].T
            theirs = np.asarray(self._map.cloud.normals())[indices.astype(np.int64), :3]
            new |= np.abs((normals * theirs).sum(axis=1)) < math.cos(s.subtract_angle_rad)
        return new
