# SPDX-License-Identifier: MIT
"""A robot with the whole navigation stack in the simulator, driven from Python: `Navigator`."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import UsageError
from slamcli.formats.maps import read_map
from slamcli.localization.amcl import Amcl
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.costmap import INSCRIBED, LETHAL
from slamcli.navigation.endpoints import NoPathError
from slamcli.navigation.layered_costmap import LayeredCostmap
from slamcli.navigation.live_planner import LivePath, LivePlanner
from slamcli.navigation.local_planners import build_local_planner
from slamcli.navigation.move_base import MoveBase, Phase
from slamcli.navigation.planner_methods import Method
from slamcli.navigation.recovery import build_recoveries
from slamcli.navigation.shortest_path import shortest_length
from slamcli.pipelines.closed_loop import ClosedLoop, CostmapPair, Drive, Rates
from slamcli.pipelines.generate import open_world
from slamcli.pipelines.localisers import AmclLocaliser, Localiser, TrueLocaliser
from slamcli.pipelines.loop_listener import LoopListener
from slamcli.pipelines.navigation_config import NavigationConfig, load_navigation
from slamcli.simulation import resolve_settings
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


class Navigator:
    """A simulated robot that drives to goals: map server, AMCL, costmaps, planners, move_base.

    Examples
    --------
    >>> from slamcli.pipelines.navigate import Navigator
    >>> robot = Navigator("map.yaml", start=(0.0, 0.0, 0.0), people=3, seed=1)  # doctest: +SKIP
    >>> arrival = robot.go_to(3.0, 2.0)  # doctest: +SKIP
    >>> arrival.succeeded, arrival.drive.length_m  # doctest: +SKIP

    Parameters
    ----------
    map_path
        map.yaml that the robot knows.
    start
        x, y, yaw in the map.
    config
        What `load_navigation` gives; None: slamcli's own move_base.launch.
    world
        World to drive in (world file, map.yaml or built-in name) if it is not what the map shows.
    localization
        amcl or truth.
    people
        How many walk about.
    seed
        Of every draw; the same seed gives the same run.
    listeners
        Are told everything that happens.

    Raises
    ------
    UsageError
        If the start is outside the map or where the robot does not fit.
    """

    def __init__(
        self,
        map_path: str | os.PathLike[str],
        *,
        start: Sequence[float],
        config: NavigationConfig | None = None,
        world: str | None = None,
        localization: Literal["amcl", "truth"] = "amcl",
        global_planner: Method = "navfn",
        dwa_scaling: Literal["noetic", "kinetic"] = "noetic",
        people: int = 0,
        seed: int = 0,
        listeners: Sequence[LoopListener] = (),
    ) -> None:
        self.config = config = config or load_navigation()
        self.grid = read_map(Path(map_path)).grid
        place = open_world(os.fspath(map_path) if world is None else world)
        pose = np.array([*start, 0.0][:3], dtype=np.float64)
        costmaps = CostmapPair(
            world=LayeredCostmap(config.global_costmap, name="global", static=self.grid),
            local=LayeredCostmap(config.local_costmap, name="local", static=self.grid),
        )
        costmaps.world.update(pose)
        window = costmaps.world.window()
        radius = max(window.inscribed_radius_m - max(config.global_costmap.costmap.footprint_padding, 0.0), 0.02)
        settings = resolve_settings(
            ROBOT_SETTINGS, {"robot.radius": radius, "people.count": people}, place.settings, config.simulation
        )
        self._known = _KnownMap(config, window)
        self._check_start(pose)
        self.plant = Plant(place, settings, start=pose, seed=seed)
        localiser: Localiser = TrueLocaliser(pose)
        if localization == "amcl":
            amcl = Amcl(config.amcl, self.grid, seed=seed)
            amcl.set_pose(pose, None)
            localiser = AmclLocaliser(amcl)
        period_s = 1.0 / config.move_base.controller_frequency
        planner = build_local_planner(config.local_planner, config.local_parameters, period_s, dwa_scaling)
        recoveries = build_recoveries(config.move_base, config.recovery, costmaps, window.circumscribed_radius_m)
        self.move_base = MoveBase(
            config.move_base, costmaps, _MapPlanner(config, costmaps.world, global_planner), planner, recoveries
        )
        rates = Rates(
            odometry=settings.odometry_rate,
            scan=settings.laser_rate,
            control=config.move_base.controller_frequency,
            local_costmap=config.local_costmap.costmap.update_frequency,
            global_costmap=config.global_costmap.costmap.update_frequency,
            publish_local=config.local_costmap.costmap.publish_frequency or _SHOWN_HZ[0],
            publish_global=config.global_costmap.costmap.publish_frequency or _SHOWN_HZ[1],
        )
        self.loop = ClosedLoop(self.plant, localiser, costmaps, self.move_base, rates, listeners)
        for listener in listeners:
            listener.on_map(0.0, self.grid)

    def listen(self, listener: LoopListener) -> None:
        """Tell a listener everything from now on, the map first."""
        self.loop.listeners.append(listener)
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
            Radians; None: the heading with which the planned path ends.
        timeout_s
            Simulated seconds; None: what the way takes at a quarter of the robot's top speed, and a minute and a half.

        Raises
        ------
        UsageError
            If the goal is not finite.
        """
        if not all(math.isfinite(v) for v in (x, y, 0.0 if yaw is None else yaw)):
            raise UsageError(f"goal {x:g},{y:g}: not finite")
        if timeout_s is not None and not timeout_s > 0.0:
            raise UsageError(f"a timeout of {timeout_s:g} s: give seconds above 0")
        try:
            known = self._known.plan(self.pose.tolist(), (x, y) if yaw is None else (x, y, yaw))
        except NoPathError as error:
            goal = (x, y, math.nan if yaw is None else yaw)
            return Arrival(goal=goal, status="unreachable", message=str(error), optimum_m=math.nan, drive=None)
        heading = float(known.yaws_rad[-1]) if yaw is None else yaw
        optimum = self._known.shortest_m(self.true_pose.tolist(), (x, y))
        if timeout_s is None:
            timeout_s = 90.0 + 4.0 * known.length_m / max(self.config.local_parameters.max_vel_x, 0.05)
        drive = self.loop.drive_to(np.array([x, y, heading]), timeout_s)
        status = _STATUS.get(drive.phase, "timeout")
        message = (
            drive.message
            if status != "timeout"
            else f"not there after {timeout_s:g} s: {drive.message or 'on the way'}"
        )
        return Arrival(goal=(x, y, heading), status=status, message=message, optimum_m=optimum, drive=drive)

    def wait(self, seconds: float) -> None:
        """Stand still for some simulated seconds while people go on."""
        self.loop.wait(seconds)

    def _check_start(self, start: Array) -> None:
        if not np.isfinite(start).all():
            raise UsageError(f"start {start.tolist()}: not finite")
        cell = self.grid.map_to_cell(start[None, :2])[0]
        if not self.grid.contains(cell[None])[0]:
            raise UsageError(f"start {start[0]:g},{start[1]:g} is outside the map")
        if self._known.window.costs[cell[0], cell[1]] in (INSCRIBED, LETHAL):
            raise UsageError(f"start {start[0]:g},{start[1]:g}: the robot does not fit there, a wall is too near")


class _KnownMap:
    """What the map alone says, before any sensor has: whether there is a way, and how short one can be."""

    def __init__(self, config: NavigationConfig, window: CostWindow) -> None:
        self.window = dataclasses.replace(window, costs=window.costs.copy())
        self._planner = LivePlanner(config.planner)
        self._through_unknown = config.planner.allow_unknown is not False

    def plan(self, start: Sequence[float], goal: Sequence[float]) -> LivePath:
        """Return NavFn's path; raises NoPathError."""
        return self._planner.plan(self.window, start, goal)

    def shortest_m(self, start: Sequence[float], goal: Sequence[float]) -> float:
        """Return the length of the shortest way for the inflated robot, through unknown cells only if there is no other."""
        length = shortest_length(self.window, start, goal)
        if math.isinf(length) and self._through_unknown:
            length = shortest_length(self.window, start, goal, allow_unknown=True)
        return length


class _MapPlanner:
    """The global planner on the global costmap."""

    def __init__(self, config: NavigationConfig, costmap: LayeredCostmap, method: Method) -> None:
        self._planner = LivePlanner(config.planner, method)
        self._costmap = costmap

    def make_plan(self, start: Array, goal: Array) -> Array:
        """Return a plan (N, 3) in map."""
        return self._planner.plan(self._costmap.window(), start.tolist(), goal.tolist()).poses
