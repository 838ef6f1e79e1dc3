# SPDX-License-Identifier: MIT
"""A robot that drives itself: plant, localiser, costmaps and move_base, each in its own rhythm of simulated time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid
from slamcli.measurements import LaserScan
from slamcli.navigation.collision_monitor import CollisionMonitor
from slamcli.navigation.layered_costmap import LayeredCostmap
from slamcli.navigation.move_base import MoveBase, Phase
from slamcli.navigation.moving_obstacles import MovingObstacles, follow
from slamcli.navigation.robot_state import RobotState
from slamcli.navigation.scan_observation import observe_scan
from slamcli.pipelines.drive_record import Drive, DriveRecord
from slamcli.pipelines.localisers import Localiser
from slamcli.pipelines.loop_listener import LoopListener
from slamcli.pipelines.rhythm import TICK_S, Rhythm
from slamcli.pipelines.unexpected import WallMask
from slamcli.recordings.scan_normalisation import turn_counter_clockwise
from slamcli.simulation.plant import Plant

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rates:
    """How often what happens, Hz."""

    odometry: float = 20.0
    scan: float = 10.0
    control: float = 20.0
    local_costmap: float = 5.0
    global_costmap: float = 1.0
    publish_local: float = 2.0
    publish_global: float = 0.5


@dataclass(slots=True)
class CostmapPair:
    """The two costmaps of move_base, with the names by which its parts know them."""

    world: LayeredCostmap
    local: LayeredCostmap


class ClosedLoop:
    """Runs plant and navigation together; what happens is told to `listeners` in the order of simulated time."""

    def __init__(
        self,
        plant: Plant,
        localiser: Localiser,
        costmaps: CostmapPair,
        move_base: MoveBase,
        rates: Rates,
        monitor: CollisionMonitor,
        listeners: Sequence[LoopListener] = (),
    ) -> None:
        self.plant, self.localiser, self.costmaps, self.move_base = plant, localiser, costmaps, move_base
        self.listeners = list(listeners)
        self._monitor, self._around = monitor, MovingObstacles.none()
        self._walls: WallMask | None = None
        self._ticks = 0
        self._pose_odom, self._twist = np.zeros(3), np.zeros(3)
        self._drive: DriveRecord | None = None
        self._rhythms = [
            Rhythm(rates.odometry, self._odometry),
            Rhythm(rates.scan, self._scan),
            Rhythm(rates.local_costmap, self._update_local),
            Rhythm(rates.global_costmap, self._update_global),
            Rhythm(rates.control, self._control),
            Rhythm(rates.publish_local, lambda: self._publish("local")),
            Rhythm(rates.publish_global, lambda: self._publish("global")),
        ]
        self._last_phase = Phase.IDLE

    @property
    def time_s(self) -> float:
        """Simulated seconds since the start."""
        return self._ticks * TICK_S

    @property
    def state(self) -> RobotState:
        """What the robot knows of itself."""
        return RobotState(
            time_s=self.time_s, pose_odom=self._pose_odom, T_map_odom=self.localiser.T_map_odom, twist=self._twist
        )

    def drive_to(self, goal: Array, timeout_s: float) -> Drive:
        """Give move_base a goal (3,) in map, and run until it is done or `timeout_s` simulated seconds are over."""
        if self._ticks == 0:
            self.wait(2 * TICK_S)  # a first scan, so that the first plan knows what is in the way
        self.localiser.reach_to(goal)
        self._take_map()
        self.send(goal)
        self._drive = record = DriveRecord(self.plant, self.time_s)
        end = self._ticks + round(timeout_s / TICK_S)
        while self._ticks < end and self.move_base.phase not in (Phase.SUCCEEDED, Phase.ABORTED):
            self._go_on(end)
        self._drive = None
        drive = record.finished(self.move_base, self.time_s)
        if drive.phase not in (Phase.SUCCEEDED, Phase.ABORTED):
            self.move_base.cancel()
        self.plant.command(np.zeros(3))
        return drive

    def send(self, goal: Array) -> None:
        """Give move_base a goal (3,) in map, instead of the one that it has; time passes with `wait`."""
        for listener in self.listeners:
            listener.on_goal(self.time_s, goal)
        self.move_base.set_goal(goal, self.state)

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        end = self._ticks + round(seconds / TICK_S)
        while self._ticks < end:
            self._go_on(end)

    def _go_on(self, end: int) -> None:
        """Do what is due now, and let time pass until something else is, or until the tick `end`."""
        for rhythm in self._rhythms:
            if rhythm.due <= self._ticks:
                rhythm.act()
                rhythm.advance()
        following = int(min(min(rhythm.due for rhythm in self._rhythms), end))
        self.plant.advance((following - self._ticks) * TICK_S)
        self._ticks = following

    def _odometry(self) -> None:
        plant = self.plant
        measured = plant.odometry()
        self._pose_odom, self._twist = plant.odom_pose, plant.odom_twist
        self.localiser.on_odometry(measured, plant.pose, self._pose_odom)
        for listener in self.listeners:
            listener.on_truth(self.time_s, plant.pose, plant.twist)
            listener.on_odometry(self.time_s, measured)
            listener.on_people(self.time_s, plant.discs())

    def _scan(self) -> None:
        told = self.plant.scan()
        scan = self._seen_from_above(told)
        is_new = self.localiser.on_scan(scan, self._pose_odom, self.plant.T_base_laser)
        self._observe(scan)
        for listener in self.listeners:
            listener.on_scan(self.time_s, told)
            if is_new:
                where = self.localiser
                listener.on_localisation(self.time_s, where.T_map_odom, where.covariance, where.particles)
        self._take_map()

    def _seen_from_above(self, scan: LaserScan) -> LaserScan:
        """Return the scan with beams that run counter-clockwise, as everything that takes `T_base_laser` expects it."""
        p = self.plant.parameters
        if not p.laser_upside_down and not p.laser_clockwise:
            return scan
        return turn_counter_clockwise(scan, mirrored=p.laser_upside_down)

    def _take_map(self) -> None:
        grid = self.localiser.new_map()
        if grid is not None:
            self.costmaps.world.set_map(grid)
            self.know_walls(grid)
            self.costmaps.local.set_map(grid)
            for listener in self.listeners:
                listener.on_map(self.time_s, grid)

    def know_walls(self, grid: OccupancyGrid) -> None:
        """Take the map by which walls are told from people."""
        if self._monitor.parameters.enabled:
            self._walls = WallMask(grid)

    def _observe(self, scan: LaserScan) -> None:
        T_odom_laser = se2.compose(self._pose_odom, self.plant.T_base_laser)
        T_map_laser = se2.compose(self.localiser.T_map_odom, T_odom_laser)
        if self._walls is not None:
            unexpected = self._walls.unexpected(scan, T_map_laser, T_odom_laser)
            self._around = follow(self._around, unexpected, self.time_s)
        for costmap, T_frame_laser in ((self.costmaps.local, T_odom_laser), (self.costmaps.world, T_map_laser)):
            for source in costmap.parameters.sources:
                costmap.observe(observe_scan(scan, T_frame_laser, source, self.time_s, self.plant.parameters.laser_z))

    def _update_local(self) -> None:
        self.costmaps.local.update(self._pose_odom, self.time_s, self.localiser.T_map_odom)

    def _update_global(self) -> None:
        self.costmaps.world.update(self.state.pose_map, self.time_s)

    def _publish(self, name: str) -> None:
        if self.listeners:
            window = (self.costmaps.local if name == "local" else self.costmaps.world).window()
            for listener in self.listeners:
                listener.on_costmap(self.time_s, name, window)

    def _control(self) -> None:
        state = self.state
        cycle = self.move_base.step(state)
        twist = self._monitor.limit(cycle.twist, state.pose_odom, self._around)
        self.plant.command(twist)
        if self._drive is not None:
            self._drive.add(cycle, state)
        for listener in self.listeners:
            listener.on_command(self.time_s, twist)
            if cycle.plan is not None:
                listener.on_plan(self.time_s, cycle.plan)
            if cycle.local_plan is not None:
                listener.on_local_plan(self.time_s, cycle.local_plan)
            if cycle.phase is not self._last_phase or cycle.recovery:
                text = f"recovery: {cycle.recovery}" if cycle.recovery else cycle.message
                listener.on_status(self.time_s, cycle.phase.value, text)
        self._last_phase = cycle.phase
