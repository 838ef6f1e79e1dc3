# SPDX-License-Identifier: MIT
"""A closed loop as a recording: what the topics of a ROS robot under move_base would have held, for Foxglove, RViz and slamcli itself.

Topics and types are those of AMCL, costmap_2d, dwa_local_planner and move_base; velocities, scans, odometry and ground
truth are those of ``slamcli generate``. Log times are simulated time.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion, se2
from slamcli.grids import OccupancyGrid
from slamcli.measurements import FrameTransform, LaserScan, Odometry, StampedPose, StampedTwist
from slamcli.navigation.cost_window import CostWindow
from slamcli.pipelines.loop_listener import LoopListener
from slamcli.pipelines.navigation_messages import TRANSLATION, level, people_markers, planar_transform
from slamcli.recordings import create_recording
from slamcli.recordings.adapters import StampedGrid, StampedMarkers, StampedPath, StampedPoses, StampedText
from slamcli.trajectory import Trajectory

Array = NDArray[np.float64]

MAP_TOPIC, SCAN_TOPIC, ODOM_TOPIC, TF_TOPIC, STATIC_TOPIC = "/map", "/scan", "/odom", "/tf", "/tf_static"
PARTICLES_TOPIC, POSE_TOPIC, TRUTH_TOPIC, PEOPLE_TOPIC = "/particlecloud", "/amcl_pose", "/ground_truth", "/people"
PLAN_TOPIC, LOCAL_PLAN_TOPIC, COMMAND_TOPIC = "/plan", "/local_plan", "/cmd_vel"
GOAL_TOPIC, STATUS_TOPIC = "/goal", "/move_base/status"

_MOST_PARTICLES = 500
_CELLS_PER_S = 250_000
"""How many cells of a costmap are written a second on average, at most: a large one comes more rarely."""
_SLACK_S = 1e-6


def costmap_topic(name: str) -> str:
    """Return the topic of a costmap (``global`` or ``local``), as move_base names it."""
    return f"/move_base/{name}_costmap/costmap"


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingRates:
    """How often what changes all the time is written, in seconds from one message to the next; 0 is always."""

    truth_s: float = 0.05
    people_s: float = 0.1
    local_plan_s: float = 0.1
    costmaps_s: dict[str, float] = field(default_factory=lambda: {"global": 2.0, "local": 0.5})
    """By name: one over costmap_2d's ``publish_frequency`` (here the mission's); infinite is never."""


class NavigationRecording(LoopListener):
    """Writes what a closed loop tells to a recording; a context manager that leaves the whole recording or none.

    Parameters
    ----------
    path
        ``.mcap`` and ``.db3`` (ROS 2), ``.bag`` (ROS 1), or a folder.
    start_ns
        Stamp of the time 0; scans and odometry carry their own stamps, which count from the same time.
    T_base_laser, laser_frame, laser_height_m, upside_down
        Where the scanner sits: (3,) x, y, yaw in the base frame, its frame's name, metres above the base, and whether its z
        axis points down.
    base_frame
        Name of the robot's frame.
    rates
        How often things are written.
    """

    def __init__(
        self, path: str | os.PathLike[str], *, start_ns: int, T_base_laser: Array, laser_frame: str = "laser",
        laser_height_m: float = 0.0, upside_down: bool = False, base_frame: str = "base_link", rates: RecordingRates | None = None,
    ) -> None:  # fmt: skip
        self.counts: Counter[str] = Counter()
        """Number of messages by topic."""
        self._recording = create_recording(path)
        self._start_ns = start_ns
        self._base_frame = base_frame
        self._rates = rates or RecordingRates()
        self._mount = FrameTransform(
            stamp_ns=start_ns, parent_frame_id=base_frame, child_frame_id=laser_frame,
            position_m=np.array([T_base_laser[0], T_base_laser[1], laser_height_m]),
            quat_xyzw=quaternion.from_roll_pitch_yaw(math.pi if upside_down else 0.0, 0.0, float(T_base_laser[2])),
            static=True,
        )  # fmt: skip
        self._T_map_odom: Array | None = None
        self._odometry: Odometry | None = None
        self._pose: Array = np.zeros(0)
        self._particles: Array = np.zeros((0, 3))
        self._costmaps: dict[str, OccupancyGrid] = {}
        self._next: dict[str, float] = {}

    def __enter__(self) -> Self:
        self._recording.__enter__()
        self._recording.write_transforms(STATIC_TOPIC, [self._mount])
        self.counts[STATIC_TOPIC] += 1
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._recording.__exit__(kind, error, trace)

    def on_map(self, time_s: float, grid: OccupancyGrid) -> None:
        """Write ``/map``."""
        self._write(MAP_TOPIC, time_s, StampedGrid(stamp_ns=self._stamp(time_s), grid=grid))

    def on_truth(self, time_s: float, pose_map: Array, twist: Array) -> None:
        """Write ``/ground_truth``, as ``slamcli generate`` does."""
        if self._is_due(TRUTH_TOPIC, time_s, self._rates.truth_s):
            position, quat = level(pose_map)
            truth = Odometry(
                stamp_ns=self._stamp(time_s), frame_id="map", child_frame_id=self._base_frame, position_m=position,
                quat_xyzw=quat, linear_m_s=np.array([twist[0], twist[1], 0.0]),
                angular_rad_s=np.array([0.0, 0.0, twist[2]]),
            )  # fmt: skip
            self._write(TRUTH_TOPIC, time_s, truth)

    def on_odometry(self, time_s: float, odometry: Odometry) -> None:
        """Write ``/odom`` and ``/tf``: odom to base and, once there is a localiser's word, map to odom."""
        self._odometry = odometry
        self._write(ODOM_TOPIC, time_s, odometry)
        stamp, frame, child = odometry.stamp_ns, odometry.frame_id, odometry.child_frame_id
        transforms = [planar_transform(stamp, frame, child, odometry.pose_se2)]
        if self._T_map_odom is not None:  # told again, as AMCL does: who looks up never has to extrapolate
            transforms.append(planar_transform(stamp, "map", frame, self._T_map_odom))
        self._recording.write_transforms(TF_TOPIC, transforms, log_time_ns=self._stamp(time_s))
        self.counts[TF_TOPIC] += 1

    def on_scan(self, time_s: float, scan: LaserScan) -> None:
        """Write ``/scan``."""
        self._write(SCAN_TOPIC, time_s, scan)

    def on_localisation(self, time_s: float, T_map_odom: Array, covariance: Array, particles: Array) -> None:
        """Write ``/amcl_pose`` and ``/particlecloud`` where they are news; the next ``/tf`` has the correction."""
        self._T_map_odom = np.array(T_map_odom, dtype=np.float64)
        news = np.concatenate([self._T_map_odom, np.ravel(covariance)])
        if self._odometry is not None and not np.array_equal(news, self._pose):
            self._pose = news
            self._write_pose(time_s, np.asarray(covariance, dtype=np.float64))
        if len(particles) and not np.array_equal(particles, self._particles):
            self._particles = np.array(particles, dtype=np.float64)
            shown = self._particles[:: math.ceil(len(self._particles) / _MOST_PARTICLES)]
            positions, quats = level(shown)
            cloud = StampedPoses(stamp_ns=self._stamp(time_s), frame_id="map", positions_m=positions, quats_xyzw=quats)
            self._write(PARTICLES_TOPIC, time_s, cloud)

    def on_command(self, time_s: float, twist: Array) -> None:
        """Write ``/cmd_vel``."""
        command = StampedTwist(
            stamp_ns=self._stamp(time_s), frame_id=self._base_frame,
            linear_m_s=np.array([twist[0], twist[1], 0.0]), angular_rad_s=np.array([0.0, 0.0, twist[2]]),
        )  # fmt: skip
        self._write(COMMAND_TOPIC, time_s, command, msgtype="geometry_msgs/msg/Twist")

    def on_costmap(self, time_s: float, name: str, costmap: CostWindow) -> None:
        """Write the whole costmap if it changed and the last one is long enough ago."""
        topic = costmap_topic(name)
        period = max(self._rates.costmaps_s.get(name, 0.0), costmap.costs.size / _CELLS_PER_S)
        if math.isinf(period) or not self._is_due(topic, time_s, period):
            return
        grid = OccupancyGrid(
            cells=TRANSLATION[costmap.costs], resolution_m=costmap.resolution_m, origin=(*costmap.origin_m, 0.0),
            frame_id=costmap.frame,
        )  # fmt: skip
        last = self._costmaps.get(topic)
        if last is not None and last.origin == grid.origin and np.array_equal(last.cells, grid.cells):
            return
        self._costmaps[topic] = grid
        self._write(topic, time_s, StampedGrid(stamp_ns=self._stamp(time_s), grid=grid))

    def on_plan(self, time_s: float, plan: Array) -> None:
        """Write ``/plan``."""
        self._write_path(PLAN_TOPIC, time_s, plan, "map")

    def on_local_plan(self, time_s: float, trajectory: Array) -> None:
        """Write ``/local_plan``."""
        if self._is_due(LOCAL_PLAN_TOPIC, time_s, self._rates.local_plan_s):
            self._write_path(LOCAL_PLAN_TOPIC, time_s, trajectory, "odom")

    def on_people(self, time_s: float, discs: Array) -> None:
        """Write ``/people``: a ball for each, and a line as long as it walks in a second."""
        if self._is_due(PEOPLE_TOPIC, time_s, self._rates.people_s):
            stamped = StampedMarkers(stamp_ns=self._stamp(time_s), frame_id="map", markers=people_markers(discs))
            self._write(PEOPLE_TOPIC, time_s, stamped)

    def on_goal(self, time_s: float, goal: Array) -> None:
        """Write ``/goal``."""
        position, quat = level(goal)
        pose = StampedPose(stamp_ns=self._stamp(time_s), frame_id="map", position_m=position, quat_xyzw=quat)
        self._write(GOAL_TOPIC, time_s, pose)

    def on_status(self, time_s: float, state: str, message: str) -> None:
        """Write ``/move_base/status``: the state and, behind a colon, why."""
        text = f"{state}: {message}" if message else state
        self._write(STATUS_TOPIC, time_s, StampedText(stamp_ns=self._stamp(time_s), text=text))

    def _write_pose(self, time_s: float, covariance: Array) -> None:
        """Write the pose that the localiser means, with its covariance about x, y and yaw."""
        odometry = self._odometry
        if odometry is None or self._T_map_odom is None:
            return
        position, quat = level(se2.compose(self._T_map_odom, odometry.pose_se2))
        whole = np.zeros((6, 6))
        whole[np.ix_((0, 1, 5), (0, 1, 5))] = covariance
        pose = StampedPose(
            stamp_ns=odometry.stamp_ns, frame_id="map", position_m=position, quat_xyzw=quat, covariance=whole
        )
        self._write(POSE_TOPIC, time_s, pose, msgtype="geometry_msgs/msg/PoseWithCovarianceStamped")

    def _write_path(self, topic: str, time_s: float, poses: Array, frame: str) -> None:
        stamp = self._stamp(time_s)
        path = Trajectory.from_se2(np.full(len(poses), stamp), poses, frame, self._base_frame)
        self._write(topic, time_s, StampedPath(stamp_ns=stamp, path=path))

    def _write(self, topic: str, time_s: float, measurement: Any, msgtype: str | None = None) -> None:
        self._recording.write(topic, measurement, log_time_ns=self._stamp(time_s), msgtype=msgtype)
        self.counts[topic] += 1

    def _stamp(self, time_s: float) -> int:
        return self._start_ns + round(time_s * 1e9)

    def _is_due(self, topic: str, time_s: float, period_s: float) -> bool:
        """Return whether a topic's next message is due, and if it is, set when the one after will be."""
        due = self._next.get(topic, time_s)
        if time_s < due - _SLACK_S:
            return False
        self._next[topic] = max(due + period_s, time_s)  # in step even where the loop's period does not divide it
        return True
