# SPDX-License-Identifier: MIT
"""A simulated robot that somebody drives: it obeys velocities, and tells listeners what it measures."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import UsageError
from slamcli.geometry import se2, se3
from slamcli.grids import OccupancyGrid
from slamcli.measurements import LaserScan
from slamcli.pipelines.generate import open_world
from slamcli.pipelines.live_slam import build_live_slam
from slamcli.pipelines.localisers import SlamLocaliser
from slamcli.pipelines.loop_listener import LoopListener
from slamcli.pipelines.rhythm import TICK_S, Rhythm
from slamcli.pipelines.teleop_request import TeleopRequest
from slamcli.recordings.scan_normalisation import turn_counter_clockwise
from slamcli.runtime import RunLog
from slamcli.simulation import SimulationParameters, World, laser, resolve_settings
from slamcli.simulation.drive import start_pose
from slamcli.simulation.free_space import FreeSpace
from slamcli.simulation.plant import Plant

Array = NDArray[np.float64]

_COMMAND_S = 0.05
_MAP_PERIOD_S = 1.0


class TeleopRobot:
    """The robot at its start; time stands until `advance_to`.

    What is asked for by `command` holds until something else is, and is told again 20 times a second, as
    teleop_twist_keyboard does with ``repeat_rate`` 20: a robot stops where nobody speaks to it.

    Parameters
    ----------
    request
        World, start, settings, seed and who maps.
    log
        Gets remarks.

    Raises
    ------
    InputError
        If the world, a setting or the start cannot be used.
    PlanningError
        If the world names no start and has no room for the robot.
    """

    def __init__(self, request: TeleopRequest, log: RunLog) -> None:
        world = open_world(request.world)
        p = resolve_settings(world.settings, request.settings)
        _warn_of_what_is_missing(p, log)
        start = _start(request, world, p)
        self.world, self.start = world, start
        self.plant = Plant(
            world, p, start=start, seed=request.seed, odometry_start=None if request.slam is None else start
        )
        self.localiser = self._mapping(request, log)
        self.listeners: list[LoopListener] = []
        self.scan_stamps_ns: list[int] = []
        self.scan_poses: list[Array] = []
        """True poses (3,) at the beginning of each scan."""
        self.length_m = 0.0
        """Way that the robot truly drove."""
        self.seen_m: Array = np.zeros((0, 2))
        """float64 (N, 2): where the beams of the newest scan ended, in the map."""
        self.grid: OccupancyGrid | None = None
        """The newest map of the system that maps."""
        self._angles = laser.beam_pattern(p).angles_base
        self._wanted, self._command_tick = np.zeros(3), 0
        self._ticks, self._before = 0, self.plant.pose
        self._rhythms = self._planned(p)
        # A robot that is left alone stops: speak twice as often as it takes.
        self._command_ticks = max(round(min(_COMMAND_S, p.robot_command_timeout / 2.0) / TICK_S), 1)

    def _planned(self, p: SimulationParameters) -> Sequence[Rhythm]:
        rhythms = [Rhythm(p.odometry_rate, self._odometry)] if p.odometry_enabled else []
        rhythms.append(Rhythm(p.truth_rate, self._truth))
        if p.laser_enabled:  # the first sweep begins when time does
            rhythms.append(Rhythm(p.laser_rate, self._scan, math.ceil(self.plant.sweep_s / TICK_S - 1e-9)))
        return rhythms

    def _mapping(self, request: TeleopRequest, log: RunLog) -> SlamLocaliser | None:
        if request.slam is None:
            return None
        p = self.plant.parameters
        if not (p.laser_enabled and p.odometry_enabled):
            raise UsageError(f"--slam {request.slam} needs the scanner and odometry: laser.enabled, odometry.enabled")
        mapper = build_live_slam(
            request.slam, request.native_files, request.slam_sets, scan_topic=laser.TOPIC, T_base_laser=se3.from_se2(self.plant.T_base_laser),
            seed=request.seed, log=log,
        )  # fmt: skip
        return SlamLocaliser(mapper, self.start, _MAP_PERIOD_S)

    @property
    def time_s(self) -> float:
        """Simulated seconds from the start."""
        return self._ticks * TICK_S

    @property
    def pose(self) -> Array:
        """float64 (3,): the robot in the map: where the system that maps believes it is, without one where it is."""
        if self.localiser is None:
            return self.plant.pose
        return se2.compose(self.localiser.T_map_odom, self.plant.odom_pose)

    def command(self, twist: Array) -> None:
        """Ask for forward, leftward (m/s) and turning (rad/s) velocity (3,) from now on."""
        self._wanted = np.array(twist, dtype=np.float64)
        self._command_tick = self._ticks

    def advance_to(self, time_s: float) -> None:
        """Let time pass until `time_s` (to the tick); what is due then has happened."""
        end = round(time_s / TICK_S)
        self._do_what_is_due()
        while self._ticks < end:
            following = int(min(min(rhythm.due for rhythm in self._rhythms), self._command_tick, end))
            self.plant.advance((following - self._ticks) * TICK_S)
            self._ticks = following
            self._do_what_is_due()

    def stop(self) -> None:
        """Tell the robot to stand still, as the keyboard does when it ends."""
        self.command(np.zeros(3))
        self._do_what_is_due()

    def _do_what_is_due(self) -> None:
        if self._command_tick <= self._ticks:
            self.plant.command(self._wanted)
            for listener in self.listeners:
                listener.on_command(self.time_s, self._wanted)
            self._command_tick = self._ticks + self._command_ticks
        for rhythm in self._rhythms:
            if rhythm.due <= self._ticks:
                rhythm.act()
                rhythm.advance()

    def _odometry(self) -> None:
        measured = self.plant.odometry()
        if self.localiser is not None:
            self.localiser.on_odometry(measured, self.plant.pose, self.plant.odom_pose)
        for listener in self.listeners:
            listener.on_odometry(self.time_s, measured)

    def _truth(self) -> None:
        pose, discs = self.plant.pose, self.plant.discs()
        self.length_m += float(np.hypot(*(pose[:2] - self._before[:2])))
        self._before = pose
        for listener in self.listeners:
            listener.on_truth(self.time_s, pose, self.plant.twist)
            if len(discs):
                listener.on_people(self.time_s, discs)

    def _scan(self) -> None:
        plant = self.plant
        scan = plant.scan()
        self.scan_stamps_ns.append(scan.stamp_ns)
        self.scan_poses.append(plant.true_pose_at(plant.time_s - plant.sweep_s))
        for listener in self.listeners:
            listener.on_scan(self.time_s, scan)
        if self.localiser is not None:
            self._map(self.localiser, scan)
        self.seen_m = self._ends(scan)

    def _map(self, localiser: SlamLocaliser, scan: LaserScan) -> None:
        p = self.plant.parameters
        if p.laser_clockwise or p.laser_upside_down:  # tiers take scans that run counter-clockwise
            scan = turn_counter_clockwise(scan, mirrored=p.laser_upside_down)
        localiser.on_scan(scan, self.plant.odom_pose, self.plant.T_base_laser)
        grid = localiser.new_map()
        self.grid = self.grid if grid is None else grid
        for listener in self.listeners:
            listener.on_localisation(self.time_s, localiser.T_map_odom, localiser.covariance, localiser.particles)
            if grid is not None:
                listener.on_map(self.time_s, grid)

    def _ends(self, scan: LaserScan) -> Array:
        """Return where beams ended, as if all were measured now."""
        hit = np.isfinite(scan.ranges_m) & (scan.ranges_m > 0.0) & (scan.ranges_m < scan.range_max_m)
        ranges, angles = scan.ranges_m[hit].astype(np.float64), self._angles[hit]
        x, y, _ = self.plant.T_base_laser.tolist()
        return se2.transform_points(
            self.pose, np.column_stack([x + ranges * np.cos(angles), y + ranges * np.sin(angles)])
        )


def _start(request: TeleopRequest, world: World, p: SimulationParameters) -> Array:
    if request.start is not None:
        x, y, _ = request.start
        x0, y0, x1, y1 = world.bounds
        if not (x0 <= x <= x1 and y0 <= y <= y1):
            raise UsageError(
                f"start {x:g},{y:g} is outside world {world.name}: it reaches from {x0:g},{y0:g} to {x1:g},{y1:g}"
            )
        return np.array(request.start)
    if world.start is not None:
        return np.array(world.start)
    return start_pose(world, FreeSpace(world, p.robot_radius + p.robot_margin))


def _warn_of_what_is_missing(p: SimulationParameters, log: RunLog) -> None:
    if not p.laser_enabled:
        log.warn(
            "nothing is scanned: laser.enabled is false; `--set laser.enabled=true` gives the robot a planar scanner"
        )
    asked = {"imu.enabled": p.imu_enabled, "lidar3d.enabled": p.lidar3d_enabled, "camera.kind": p.camera_kind != "none"}
    missing = [name for name, wanted in asked.items() if wanted]
    if missing:
        log.warn(f"{', '.join(missing)}: not simulated on a robot that obeys velocities; `slamcli generate` does")
