# SPDX-License-Identifier: MIT
"""A robot with the whole navigation stack in the simulator, driven from Python: `Navigator`."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import UsageError
from slamcli.formats.maps import read_map
from slamcli.geometry import se3
from slamcli.grids import OccupancyGrid
from slamcli.localization.amcl import Amcl
from slamcli.navigation.collision_monitor import CollisionMonitor
from slamcli.navigation.costmap import INSCRIBED, LETHAL
from slamcli.navigation.costmap_parameters import COSTMAP_2D_ROBOT_RADIUS_M
from slamcli.navigation.endpoints import NoPathError
from slamcli.navigation.layered_costmap import LayeredCostmap
from slamcli.navigation.live_planner import LivePlanner
from slamcli.navigation.local_planners import build_local_planner
from slamcli.navigation.move_base import MoveBase, Phase
from slamcli.navigation.planner_methods import Method
from slamcli.navigation.recovery import build_recoveries
from slamcli.pipelines.closed_loop import ClosedLoop, CostmapPair, Rates
from slamcli.pipelines.costmap_planner import CostmapPlanner
from slamcli.pipelines.drive_kinds import fit_to_drive
from slamcli.pipelines.drive_record import Drive
from slamcli.pipelines.generate import open_world
from slamcli.pipelines.known_map import KnownMap
from slamcli.pipelines.live_slam import build_live_slam
from slamcli.pipelines.localisers import AmclLocaliser, Localiser, SlamLocaliser, TrueLocaliser
from slamcli.pipelines.loop_listener import LoopListener
from slamcli.pipelines.navigation_config import NavigationConfig, load_navigation
from slamcli.runtime import RunLog
from slamcli.simulation import SimulationParameters, World, resolve_settings
from slamcli.simulation.laser import TOPIC as SCAN_TOPIC
from slamcli.simulation.plant import Plant

Array = NDArray[np.float64]

ROBOT_SETTINGS: Mapping[str, Any] = {
    "laser.beams": 360,
    "laser.fov": 360.0,
    "laser.range_max": 12.0,
    "laser.x": 0.0,
    "laser.sweep": 0.0,
}
"""What the simulated robot has unless the world or ``--set`` says otherwise: a scanner that looks all round."""

_SHOWN_HZ = 2.0, 0.5
"""How often listeners are told of the local and the global costmap where publish_frequency is 0: what is published is theirs to say."""
_FIRST_MAP_M = 10.0
"""Side of the unknown square that a robot without a map begins with."""
_MAP_PERIOD_S = 1.0

Localization = Literal["amcl", "truth"]
Status = Literal["succeeded", "aborted", "timeout", "unreachable"]
_STATUS: Mapping[Phase, Status] = {Phase.SUCCEEDED: "succeeded", Phase.ABORTED: "aborted"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Arrival:
    """What became of one goal."""

    goal: tuple[float, float, float]
    status: Status
    message: str
    optimum_m: float
    """Length of the shortest way for the inflated robot on the known map; NaN where it is not known."""
    drive: Drive | None
    """None where the robot did not set out, because the map shows that there is no way."""

    @property
    def succeeded(self) -> bool:
        """Whether the robot arrived."""
        return self.status == "succeeded"


@dataclass(frozen=True, slots=True, kw_only=True)
class SlamChoice:
    """Which tier maps while the robot drives, and how."""

    algo: str
    """gmapping or cartographer."""
    files: tuple[Path, ...] = ()
    sets: tuple[str, ...] = ()
    map_period_s: float = field(default=_MAP_PERIOD_S)
    """How often the map is drawn anew."""


class Navigator:
    """A simulated robot that drives to goals: map server and AMCL (or SLAM), costmaps, planners, move_base.

    Examples
    --------
    >>> from slamcli.pipelines.navigate import Navigator
    >>> robot = Navigator("map.yaml", start=(0.0, 0.0, 0.0), people=3, seed=1)  # doctest: +SKIP
    >>> arrival = robot.go_to(3.0, 2.0)  # doctest: +SKIP
    >>> arrival.succeeded, arrival.drive.length_m  # doctest: +SKIP

    Parameters
    ----------
    map_path
        map.yaml that the robot knows; None with `slam`.
    start
        x, y, yaw in the map; without a map: in the world, whose coordinates the map then has.
    config
        What `load_navigation` gives; None: slamcli's own move_base.launch.
    world
        World to drive in (world file, map.yaml or built-in name) if it is not what the map shows.
    localization
        amcl or truth.
    slam
        Map while driving, instead of a map.
    global_planner
        Of `slamcli plan`; None: what the configuration says.
    dwa_scaling
        How DWA's weights are meant: noetic, or kinetic and older.
    people
        How many walk about.
    seed
        Of every draw; the same seed gives the same run.
    listeners
        Are told everything that happens.
    log
        Gets remarks.

    Raises
    ------
    UsageError
        If there is neither map nor `slam`, or the start is outside the map or where the robot does not fit.
    """

    def __init__(
        self,
        map_path: str | os.PathLike[str] | None = None,
        *,
        start: Sequence[float],
        config: NavigationConfig | None = None,
        world: str | None = None,
        localization: Localization = "amcl",
        slam: SlamChoice | None = None,
        global_planner: Method | None = None,
        dwa_scaling: Literal["noetic", "kinetic"] = "noetic",
        people: int = 0,
        seed: int = 0,
        listeners: Sequence[LoopListener] = (),
        log: RunLog | None = None,
    ) -> None:
        config = config or load_navigation()
        pose = np.array([*start, 0.0][:3], dtype=np.float64)
        if not np.isfinite(pose).all():
            raise UsageError(f"start {','.join(f'{v:g}' for v in start)}: not finite")
        place, grid = _opened(map_path, world, slam, pose)
        settings = _settings(config, place, people)
        config = replace(config, global_planner=global_planner or config.global_planner)
        self.config = config = fit_to_drive(config, settings, log or RunLog())
        self.costmaps = CostmapPair(
            world=LayeredCostmap(config.global_costmap, name="global", static=grid),
            local=LayeredCostmap(config.local_costmap, name="local", static=grid),
        )
        self.costmaps.world.update(pose)
        surveyor = _surveyor(config)
        self._known = None
        if slam is None:
            self._known = KnownMap(config.planner, self.costmaps.world.window(), surveyor)
        self._check_start(pose)
        self.plant = Plant(place, settings, start=pose, seed=seed, odometry_start=pose if slam else None)
        self.localiser = self._localised(localization, slam, grid, pose, seed, log)
        self.loop = ClosedLoop(
            self.plant, self.localiser, self.costmaps, self._move_base(dwa_scaling),
            self._rates(settings), CollisionMonitor(config.monitor, self.costmaps.world.window().circumscribed_radius_m),
            listeners,
        )  # fmt: skip
        if slam is None:
            self.loop.know_walls(grid)
        self.grid = grid
        """The map: the one that was given, or the newest of SLAM's."""
        self._maps_itself = slam is not None
        for listener in listeners:
            self._show_map(listener)

    def listen(self, listener: LoopListener) -> None:
        """Tell a listener everything from now on, the map first."""
        self.loop.listeners.append(listener)
        self._show_map(listener)

    def _show_map(self, listener: LoopListener) -> None:
        if not self._maps_itself:
            listener.on_map(self.time_s, self.grid)

    @property
    def pose(self) -> Array:
        """float64 (3,): where the robot believes it is, in the map."""
        return self.loop.state.pose_map

    @property
    def true_pose(self) -> Array:
        """float64 (3,): where it is."""
        return self.plant.pose

    @property
    def time_s(self) -> float:
        """Simulated seconds since the start."""
        return self.loop.time_s

    def go_to(self, x: float, y: float, yaw: float | None = None, *, timeout_s: float | None = None) -> Arrival:
        """Drive to a goal in the map.

        Parameters
        ----------
        x, y
            Metres.
        yaw
            Radians; None: the heading with which the planned path ends (without a map: the direction of the goal).
        timeout_s
            Simulated seconds; None: what the way takes at a quarter of the robot's top speed, and a minute and a half.

        Raises
        ------
        UsageError
            If the goal or the timeout is not finite, or the timeout not above 0.
        """
        if not all(math.isfinite(v) for v in (x, y, 0.0 if yaw is None else yaw)):
            raise UsageError(f"goal {x:g},{y:g}: not finite")
        if timeout_s is not None and not 0.0 < timeout_s < math.inf:
            raise UsageError(f"a timeout of {timeout_s:g} s: give seconds above 0")
        optimum, away = math.nan, float(np.hypot(x - self.pose[0], y - self.pose[1]))
        heading = math.atan2(y - self.pose[1], x - self.pose[0])
        if self._known is not None:
            try:
                known = self._known.plan(self.pose.tolist(), (x, y) if yaw is None else (x, y, yaw))
            except NoPathError as error:
                goal = (x, y, math.nan if yaw is None else yaw)
                return Arrival(goal=goal, status="unreachable", message=str(error), optimum_m=math.nan, drive=None)
            heading, away = float(known.yaws_rad[-1]), known.length_m
            optimum = self._known.shortest_m(self.true_pose.tolist(), (x, y))
        if yaw is not None:
            heading = yaw
        if timeout_s is None:
            way = away if self._known is not None else 3.0 * away
            timeout_s = 90.0 + 4.0 * way / max(self.config.local_parameters.max_vel_x, 0.05)
        drive = self.loop.drive_to(np.array([x, y, heading]), timeout_s)
        status = _STATUS.get(drive.phase, "timeout")
        message = drive.message
        if status == "timeout":
            message = f"not there after {timeout_s:.0f} s" + (f": {message}" if message else "")
        return Arrival(goal=(x, y, heading), status=status, message=message, optimum_m=optimum, drive=drive)

    def wait(self, seconds: float) -> None:
        """Stand still for some simulated seconds while people go on."""
        self.loop.wait(seconds)

    def _check_start(self, start: Array) -> None:
        if self._known is None:
            return
        cost = self._known.cost(float(start[0]), float(start[1]))
        where = f"start {start[0]:g},{start[1]:g}"
        if cost is None:
            raise UsageError(f"{where} is outside the map")
        if cost in (INSCRIBED, LETHAL):
            raise UsageError(f"{where}: the robot does not fit there, a wall is too near")

    def _localised(
        self,
        kind: Localization,
        slam: SlamChoice | None,
        grid: OccupancyGrid,
        start: Array,
        seed: int,
        log: RunLog | None,
    ) -> Localiser:
        if slam is not None:
            mapper = build_live_slam(
                slam.algo, slam.files, slam.sets, scan_topic=SCAN_TOPIC, T_base_laser=se3.from_se2(self.plant.T_base_laser), seed=seed,
                log=log,
            )  # fmt: skip
            return SlamLocaliser(mapper, start, slam.map_period_s)
        if kind == "truth":
            return TrueLocaliser(start)
        amcl = Amcl(self.config.amcl, grid, seed=seed)
        amcl.set_pose(start, None)
        return AmclLocaliser(amcl)

    def _move_base(self, dwa_scaling: str) -> MoveBase:
        config, world = self.config, self.costmaps.world
        local = build_local_planner(
            config.local_planner, config.local_parameters, 1.0 / config.move_base.controller_frequency, dwa_scaling
        )
        radius = world.window().circumscribed_radius_m
        recoveries = build_recoveries(config.move_base, config.recovery, self.costmaps, radius, config.behaviours)
        method = config.global_planner
        planner = CostmapPlanner(
            LivePlanner(config.planner, method), world, getattr(config.local_parameters, "xy_goal_tolerance", 0.0)
        )
        return MoveBase(config.move_base, self.costmaps, planner, local, recoveries)

    def _rates(self, settings: SimulationParameters) -> Rates:
        world, local = self.config.global_costmap.costmap, self.config.local_costmap.costmap
        return Rates(
            odometry=settings.odometry_rate,
            scan=settings.laser_rate,
            control=self.config.move_base.controller_frequency,
            local_costmap=local.update_frequency,
            global_costmap=world.update_frequency,
            publish_local=local.publish_frequency or _SHOWN_HZ[0],
            publish_global=world.publish_frequency or _SHOWN_HZ[1],
        )


def _surveyor(config: NavigationConfig) -> Method:
    """Return the planner that says on the known map whether there is a way."""
    return "hybrid_astar" if config.global_planner == "hybrid_astar" else "navfn"


def _settings(config: NavigationConfig, place: World, people: int) -> SimulationParameters:
    """Return the robot's body and sensors; the body is the one that the costmaps are told of."""
    costmap = config.global_costmap.costmap
    radius = COSTMAP_2D_ROBOT_RADIUS_M if costmap.robot_radius is None else costmap.robot_radius
    body: dict[str, Any] = {"robot.radius": max(radius, 0.02), "robot.footprint": costmap.footprint}
    return resolve_settings(ROBOT_SETTINGS, {"people.count": people}, place.settings, body, config.simulation)


def _opened(
    map_path: str | os.PathLike[str] | None, world: str | None, slam: SlamChoice | None, start: Array
) -> tuple[World, OccupancyGrid]:
    """Return the world to drive in and the map that the robot begins with."""
    if slam is not None:
        if map_path is not None or world is None:
            raise UsageError("SLAM while driving needs a world to drive in, and no map")
        place = open_world(world)
        resolution = 0.05
        side = round(_FIRST_MAP_M / resolution)
        low = start[:2] - _FIRST_MAP_M / 2.0
        cells = np.full((side, side), OccupancyGrid.UNKNOWN, dtype=np.int8)
        return place, OccupancyGrid(cells, resolution, (float(low[0]), float(low[1]), 0.0))
    if map_path is None:
        raise UsageError("a map is needed: --map map.yaml, or --slam gmapping|cartographer in a world")
    grid = read_map(Path(map_path)).grid
    return open_world(os.fspath(map_path) if world is None else world), grid
