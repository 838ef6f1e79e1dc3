# SPDX-License-Identifier: MIT
"""A robot with the whole navigation stack in the simulator, driven from Python: `Navigator`."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import PlanningError, UsageError
from slamcli.formats.maps import read_map
from slamcli.grids import OccupancyGrid
from slamcli.localization.amcl import Amcl
from slamcli.navigation.costmap import compute_costmap
from slamcli.navigation.endpoints import NoPathError
from slamcli.navigation.layered_costmap import LayeredCostmap
from slamcli.navigation.live_planner import LivePlanner
from slamcli.navigation.local_planners import build_local_planner
from slamcli.navigation.move_base import MoveBase, Phase
from slamcli.navigation.recovery import build_recoveries
from slamcli.pipelines.closed_loop import ClosedLoop, CostmapPair, Drive, Rates
from slamcli.pipelines.generate import open_world
from slamcli.pipelines.localisers import AmclLocaliser, Localiser, TrueLocaliser
from slamcli.pipelines.loop_listener import LoopListener
from slamcli.pipelines.navigation_config import NavigationConfig, load_navigation
from slamcli.simulation import World, resolve_settings
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Arrival:
    """What became of one goal."""

    goal: tuple[float, float, float]
    status: Literal["succeeded", "aborted", "timeout", "unreachable"]
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
        people: int = 0,
        seed: int = 0,
        listeners: Sequence[LoopListener] = (),
    ) -> None:
        self.config = config or load_navigation()
        self.grid = read_map(Path(map_path)).grid
        place = open_world(os.fspath(map_path) if world is None else world)
        self._build(place, np.array([*start, 0.0][:3], dtype=np.float64), localization, people, seed, listeners)

    def _build(
        self, place: World, start: Array, localization: str, people: int, seed: int, listeners: Sequence[LoopListener]
    ) -> None:
        config = self.config
        costmaps = CostmapPair(
            world=LayeredCostmap(config.global_costmap, name="global", static=self.grid),
            local=LayeredCostmap(config.local_costmap, name="local"),
        )
        window = costmaps.world.window()
        radius = max(window.inscribed_radius_m - max(config.global_costmap.footprint_padding, 0.0), 0.02)
        settings = resolve_settings(
            ROBOT_SETTINGS, {"robot.radius": radius, "people.count": people}, place.settings, config.simulation
        )
        self._check_start(start)
        self.plant = Plant(place, settings, start=start, seed=seed)
        localiser: Localiser = TrueLocaliser()
        if localization == "amcl":
            amcl = Amcl(config.amcl, self.grid, seed=seed)
            amcl.set_pose(start, None)
            localiser = AmclLocaliser(amcl)
        period_s = 1.0 / config.move_base.controller_frequency
        planner = build_local_planner(config.local_planner, config.local_parameters, period_s, config.dwa_scaling)
        recoveries = build_recoveries(config.move_base, config.recovery, costmaps, window.circumscribed_radius_m)
        self.move_base = MoveBase(
            config.move_base, costmaps, _MapPlanner(config, costmaps.world), planner, recoveries
        )
        rates = Rates(
            odometry=settings.odometry_rate,
            scan=settings.laser_rate,
            control=config.move_base.controller_frequency,
            local_costmap=config.local_costmap.update_frequency,
            global_costmap=config.global_costmap.update_frequency,
            publish_local=config.local_costmap.publish_frequency,
            publish_global=config.global_costmap.publish_frequency,
        )
        self.loop = ClosedLoop(self.plant, localiser, costmaps, self.move_base, rates, listeners)
        for listener in listeners:
            listener.on_map(0.0, self.grid)

    def _check_start(self, start: Array) -> None:
        static = self._static
        cell = self.grid.map_to_cell(start[None, :2])[0]
        if not self.grid.contains(cell[None])[0]:
            raise UsageError(f"start {start[0]:g},{start[1]:g} is outside the map")
        if static.costs[cell[0], cell[1]] in (253, 254):
            raise UsageError(f"start {start[0]:g},{start[1]:g}: the robot does not fit there: it is in or too near to a wall")


class _MapPlanner:
    """The global planner on the global costmap."""

    def __init__(self, config: NavigationConfig, costmap: LayeredCostmap) -> None:
        self._planner = LivePlanner(config.planner, config.global_planner)
        self._costmap = costmap

    def make_plan(self, start: Array, goal: Array) -> Array:
        """Return a plan (N, 3) in map."""
        return self._planner.plan(self._costmap.window(), start.tolist(), goal.tolist()).poses
