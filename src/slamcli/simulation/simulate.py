# SPDX-License-Identifier: MIT
"""One simulated recording: everything that the robot's sensors say, in the order in which it is logged."""

from __future__ import annotations

import heapq
import zlib
from collections.abc import Iterator
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ConfigError, UsageError
from slamcli.geometry import quaternion
from slamcli.grids import OccupancyGrid
from slamcli.measurements import FrameTransform, ImuSample, Odometry
from slamcli.simulation import drive as driving
from slamcli.simulation import free_space, imu, laser, lidar3d, odometry
from slamcli.simulation.camera import CameraRig
from slamcli.simulation.flight import Flight, first_crossing
from slamcli.simulation.message import Message
from slamcli.simulation.parameters import SimulationParameters
from slamcli.simulation.people import Crowd
from slamcli.simulation.relief import Relief, flat_relief
from slamcli.simulation.render import Scene
from slamcli.simulation.ride import Ride
from slamcli.simulation.space import Space
from slamcli.simulation.world import World
from slamcli.trajectory import Trajectory

Array = NDArray[np.float64]

MAP_FRAME, ODOM_FRAME = "map", "odom"
ODOM_TOPIC, TF_TOPIC, STATIC_TOPIC, TRUTH_TOPIC = "/odom", "/tf", "/tf_static", "/ground_truth"


class Simulation:
    """A drive with everything that was drawn for it; `messages` plays it, any number of times, always the same.

    Every sensor draws from its own stream, which depends on the seed and the sensor's name only: switching people or
    the IMU on changes neither the drive nor the noise of the others.
    """

    def __init__(
        self, world: World, parameters: SimulationParameters, *, seed: int = 0, duration_s: float | None = None
    ) -> None:
        """Drive the robot through `world` for `duration_s` (None: the route's length, or 120 s at random).

        Raises
        ------
        UsageError
            If the duration or the limits of ranges make no sense.
        ConfigError, PlanningError
            If the world is too large, the robot has no way, or would hit a wall.
        """
        if duration_s is not None and not 0 < duration_s < 1e7:
            raise UsageError(f"a duration of {duration_s:g} s: give seconds above 0 and below 10 million")
        _check(world, parameters)
        self.world, self.parameters, self._seed = world, parameters, seed
        self.ride = self._moved(duration_s)
        self.motion = self.ride.motion
        count = len(world.walkers) + parameters.people_count
        self.crowd = Crowd(world, self.motion, parameters, [self._stream(f"person {i}") for i in range(count)])
        self._space: Space | None = None
        if world.relief is not None or parameters.lidar3d_enabled:
            self._space = Space(self._relief())
        self._rig: CameraRig | None = None
        if parameters.camera_kind != "none":
            self._rig = CameraRig(lambda: self._scene, self.ride, parameters, seed, self._stamp_ns)
            self._check_way(self._rig.cameras[0].position)
        self.slips_s = odometry.slip_episodes(self.motion, parameters, self._stream("slip"))
        self.scan_times_s, self.cloud_times_s = np.zeros(0), np.zeros(0)
        if parameters.laser_enabled:
            self.scan_times_s = self._times(parameters.laser_rate, self._scanner().sweep_s)
        if parameters.lidar3d_enabled:
            self.cloud_times_s = self._times(parameters.lidar3d_rate, 1.0 / parameters.lidar3d_rate)
        self.frame_times_s = np.zeros(0) if self._rig is None else self._times(parameters.camera_rate)
        if not any(len(t) for t in (self.scan_times_s, self.cloud_times_s, self.frame_times_s)):
            raise UsageError(
                f"no scan fits into {self.motion.duration_s:g} s: give a longer duration or a higher laser.rate"
            )
        self.odometry_times_s = self._times(parameters.odometry_rate)

    @property
    def duration_s(self) -> float:
        """Length of the drive."""
        return self.motion.duration_s

    def messages(self) -> Iterator[Message]:
        """Yield every measurement in the order of log times: /tf_static, /scan, /odom, /tf, /ground_truth, /imu, /points, images."""
        streams = [self._statics(), self._scans(), self._truth()]
        if self.parameters.odometry_enabled:
            streams.insert(2, self._wheels())
        if self.parameters.imu_enabled:
            streams.append(self._inertial())
        if self.parameters.lidar3d_enabled:
            streams.append(self._clouds())
        if self._rig is not None:
            late_ns = max(round(self.parameters.depth_delay * 1e9), 0)
            streams.append(_in_order(self._rig.messages(self.frame_times_s), late_ns))
        yield from heapq.merge(*streams, key=lambda message: message.log_time_ns)

    def truth(self) -> Trajectory:
        """Return where the base frame truly was at each scan (without a planar scanner: cloud) and each image, under its stamp.

        Scans and clouds count from their beginning, images have the middle of their exposure. Of several under one stamp
        the scan's pose stands.
        """
        p = self.parameters
        times = self.scan_times_s if p.laser_enabled else self.cloud_times_s
        stamps = self._scan_stamps_ns(times)
        if len(self.frame_times_s):
            both = np.concatenate([stamps, self._stamps_ns(self.frame_times_s, p.clock_camera_offset)])
            stamps, chosen = np.unique(both, return_index=True)
            times = np.concatenate([times, self.frame_times_s])[chosen]
        positions, rotations = self.ride.at(times)
        return Trajectory(stamps, positions, quaternion.from_matrix(rotations), MAP_FRAME, p.robot_base_frame)

    def true_map(self) -> OccupancyGrid:
        """Return the map that a perfect survey of the world would give (cells of `map.resolution`)."""
        return free_space.true_map(self.world, self.motion.poses[0, :2], self.parameters.map_resolution)

    @cached_property
    def _scene(self) -> Scene:
        p = self.parameters
        is_grey = self._rig is not None and not self._rig.is_coloured
        return Scene(
            self._relief(), seed=p.texture_seed, texel_m=p.texture_texel, plain_share=p.texture_plain, grey=is_grey
        )

    def _moved(self, duration_s: float | None) -> Ride:
        world, p = self.world, self.parameters
        if world.path is not None:
            return Flight(world.path, p, duration_s, self._stream("flight"))
        motion = driving.drive(world, p, duration_s, self._stream("drive"))
        return Ride(motion, None if world.relief is None else world.relief.ground)

    def _relief(self) -> Relief:
        return self.world.relief or flat_relief(self.world.segments, self.world.circles, self.world.bounds)

    def _check_way(self, mount: Array) -> None:
        """Refuse a path on which what is mounted at `mount` (3,) of the base passes through something."""
        if self.world.path is None:
            return
        times = self.motion.times_s
        positions, rotations = self.ride.at(times)
        points = positions + rotations @ mount
        at = first_crossing(Space(self._relief()), points)
        if at is not None:
            x, y, z = points[at]
            raise ConfigError(
                f"world {self.world.name}: path: the camera passes through something at {x:.2f}, {y:.2f}, {z:.2f} after "
                f"{times[at]:.1f} s: move the poses there away from it"
            )

    def _stream(self, name: str) -> np.random.Generator:
        return np.random.default_rng([self._seed, zlib.crc32(name.encode())])

    def _times(self, rate_hz: float, needed_s: float = 0.0) -> Array:
        times = np.arange(int((self.motion.duration_s - needed_s) * rate_hz + 1e-6) + 1) / rate_hz
        return times[times + needed_s <= self.motion.duration_s + 1e-9]

    def _stamps_ns(self, times_s: Array, offset_s: float = 0.0) -> NDArray[np.int64]:
        start_ns = round(self.parameters.clock_start * 1e9)
        return start_ns + np.rint((times_s + offset_s) * 1e9).astype(np.int64)

    def _stamp_ns(self, time_s: float) -> int:
        return int(self._stamps_ns(np.array([time_s]))[0])

    def _jittered_ns(self, times_s: Array, offset_s: float, jitter_s: float, name: str) -> NDArray[np.int64]:
        jitter = jitter_s * self._stream(name).standard_normal(len(times_s))
        return self._stamps_ns(times_s + jitter, offset_s)

    def _scan_stamps_ns(self, times_s: Array) -> NDArray[np.int64]:
        p = self.parameters
        return self._jittered_ns(times_s, p.clock_laser_offset, p.clock_laser_jitter, "laser clock")

    def _scanner(self) -> laser.Scanner:
        in_space = None if self.world.relief is None else self._space
        return laser.Scanner(self.world, self.ride, in_space, self.crowd, self.parameters, self._stream("laser"))

    def _spinner(self) -> lidar3d.SpinningScanner:
        assert self._space is not None  # noqa: S101 - for the type checker
        return lidar3d.SpinningScanner(self._space, self.ride, self.crowd, self.parameters, self._stream("lidar3d"))

    def _statics(self) -> Iterator[Message]:
        mounts = [(laser.FRAME, *self._scanner().mount())] if self.parameters.laser_enabled else []
        if self.parameters.lidar3d_enabled:
            mounts.append((lidar3d.FRAME, *self._spinner().mount()))
        if self.parameters.imu_enabled:
            p = self.parameters
            mounts.append((imu.FRAME, np.array([p.imu_x, p.imu_y, p.imu_z]), np.array([0.0, 0.0, 0.0, 1.0])))
        if self._rig is not None:
            mounts += [(c.frame, c.position, quaternion.from_matrix(c.rotation)) for c in self._rig.cameras]
        stamp = self._stamp_ns(0.0)
        for frame, position, quat in mounts:
            transform = FrameTransform(
                stamp_ns=stamp, parent_frame_id=self.parameters.robot_base_frame, child_frame_id=frame, position_m=position, quat_xyzw=quat,
                static=True, topic=STATIC_TOPIC,
            )  # fmt: skip
            yield Message(stamp, STATIC_TOPIC, transform)

    def _scans(self) -> Iterator[Message]:
        scanner, times = self._scanner(), self.scan_times_s
        logs = self._stamps_ns(times + scanner.sweep_s)
        for time_s, stamp, log in zip(times, self._scan_stamps_ns(times).tolist(), logs.tolist(), strict=True):
            yield Message(log, laser.TOPIC, scanner.scan(float(time_s), stamp))

    def _clouds(self) -> Iterator[Message]:
        spinner, times = self._spinner(), self.cloud_times_s
        logs = self._stamps_ns(times + spinner.sweep_s)
        for time_s, stamp, log in zip(times, self._scan_stamps_ns(times).tolist(), logs.tolist(), strict=True):
            yield Message(log, lidar3d.TOPIC, spinner.cloud(float(time_s), stamp))

    def _wheels(self) -> Iterator[Message]:
        p, times = self.parameters, self.odometry_times_s
        poses = odometry.wheel_poses(self.ride, times, self.slips_s, p, self._stream("odometry"))
        stamps = self._jittered_ns(times, p.clock_odometry_offset, p.clock_odometry_jitter, "odometry clock")
        told = np.diff(poses, axis=0, prepend=poses[:1]) * p.odometry_rate
        speeds = np.column_stack([np.cos(poses[:, 2]) * told[:, 0] + np.sin(poses[:, 2]) * told[:, 1], told[:, 2]])
        level = np.column_stack([poses[:, :2], np.zeros(len(poses))]), quaternion.from_yaw(poses[:, 2])
        linear = np.column_stack([speeds[:, 0], np.zeros((len(speeds), 2))])
        angular = np.column_stack([np.zeros((len(speeds), 2)), speeds[:, 1]])
        logs, frames = self._stamps_ns(times), (ODOM_FRAME, p.robot_base_frame)
        for message in _odometry(ODOM_TOPIC, frames, stamps, logs, *level, linear, angular):
            yield message
            pose = message.measurement
            assert isinstance(pose, Odometry)  # noqa: S101 - for the type checker
            transform = FrameTransform(
                stamp_ns=pose.stamp_ns, parent_frame_id=ODOM_FRAME, child_frame_id=p.robot_base_frame,
                position_m=pose.position_m, quat_xyzw=pose.quat_xyzw, topic=TF_TOPIC,
            )  # fmt: skip
            yield Message(message.log_time_ns, TF_TOPIC, transform)

    def _truth(self) -> Iterator[Message]:
        times = self._times(self.parameters.truth_rate)
        stamps = self._stamps_ns(times)
        positions, rotations = self.ride.at(times)
        quats = quaternion.from_matrix(rotations)
        frames = MAP_FRAME, self.parameters.robot_base_frame
        yield from _odometry(TRUTH_TOPIC, frames, stamps, stamps, positions, quats, *self.ride.twists(times))

    def _inertial(self) -> Iterator[Message]:
        times = self._times(self.parameters.imu_rate)
        angular, force = imu.inertial(self.ride, times, self.parameters, self._stream("imu"))
        stamps = self._stamps_ns(times, self.parameters.clock_imu_offset).tolist()
        for stamp, log, turn, pull in zip(stamps, self._stamps_ns(times).tolist(), angular, force, strict=True):
            sample = ImuSample(
                stamp_ns=stamp, frame_id=imu.FRAME, angular_rad_s=turn, acceleration_m_s2=pull, topic=imu.TOPIC
            )
            yield Message(log, imu.TOPIC, sample)


def _in_order(messages: Iterator[Message], late_ns: int) -> Iterator[Message]:
    """Yield messages by log time, of which some are logged up to `late_ns` after what follows them."""
    waiting: list[tuple[int, int, Message]] = []
    for number, message in enumerate(messages):
        heapq.heappush(waiting, (message.log_time_ns, number, message))
        while len(waiting) > 1 and waiting[0][0] <= message.log_time_ns - late_ns:
            yield heapq.heappop(waiting)[2]
    while waiting:
        yield heapq.heappop(waiting)[2]


def _odometry(
    topic: str, frames: tuple[str, str], stamps_ns: NDArray[np.int64], logs_ns: NDArray[np.int64], positions: Array,
    quats: Array, linear: Array, angular: Array,
) -> Iterator[Message]:  # fmt: skip
    rows = zip(stamps_ns.tolist(), logs_ns.tolist(), positions, quats, linear, angular, strict=True)
    for stamp, log, position, quat, v, w in rows:
        told = Odometry(
            stamp_ns=stamp, frame_id=frames[0], child_frame_id=frames[1], position_m=position, quat_xyzw=quat,
            linear_m_s=v, angular_rad_s=w, topic=topic,
        )  # fmt: skip
        yield Message(log, topic, told)


def _check(world: World, parameters: SimulationParameters) -> None:
    p = parameters
    for name, low, high in (
        ("laser", p.laser_range_min, p.laser_range_max),
        ("lidar3d", p.lidar3d_range_min, p.lidar3d_range_max),
    ):
        if low >= high:
            raise UsageError(f"{name}.range_min {low:g} m is not below {name}.range_max {high:g} m")
    if not p.laser_enabled and not p.lidar3d_enabled and p.camera_kind == "none":
        raise UsageError("a robot without sensors: laser.enabled, lidar3d.enabled or --camera must be there")
    in_space = p.lidar3d_enabled or p.camera_kind != "none"
    if world.grid is not None and (world.relief is not None or in_space):
        raise ConfigError(
            f"world {world.name}: the cells of a grid have no heights: cameras and spinning scanners need walls"
        )
