# SPDX-License-Identifier: MIT
"""A robot that explores the world it stands in: frontiers, move_base and SLAM as it goes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError, UsageError
from slamcli.evaluation.reachable_area import ReachableArea, free_cells
from slamcli.grids import OccupancyGrid
from slamcli.grids.straighten import straighten
from slamcli.navigation import move_base
from slamcli.navigation.exploration import Directive, Exploration, Phase
from slamcli.navigation.explore_parameters import ExploreParameters
from slamcli.navigation.frontiers import costs_for_exploring
from slamcli.pipelines.localisers import SlamLocaliser
from slamcli.pipelines.loop_listener import LoopListener
from slamcli.pipelines.navigate import Navigator

Array = NDArray[np.float64]

DEFAULT_TIMEOUT_S = 3600.0
_FIRST_LOOK_S = 1.0
"""What the robot sees before it chooses its first goal."""
_COVERAGE_S = 2.0
"""How often coverage is measured."""

Status = Literal["done", "stuck", "timeout"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CoveragePoint:
    """How far the exploration was at one moment."""

    time_s: float
    coverage: float
    """Share of the reachable area that the map knew, 0 to 1; NaN where the truth is not told."""
    free_m2: float
    """Area of the map's free cells."""
    driven_m: float
    """Way that the robot truly drove until then."""
    frontiers: int
    """Frontiers that were left at the last search."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Explored:
    """What an exploration ends with."""

    status: Status
    message: str
    """Why it ended."""
    grid: OccupancyGrid | None
    """The map, its cells along x and y, in coordinates in which the robot began at its start; None if there never was one."""
    history: tuple[CoveragePoint, ...]
    """In the order of time; the last one is of `grid`."""
    goals: int
    """Goals that were sent, without those that only moved."""
    reached: int
    given_up: int
    begin_s: float
    end_s: float
    clearance_m: float
    """Least distance that its body truly had to anything."""
    recoveries: tuple[str, ...]
    plans: int
    """Number of global plans."""


class Explorer(LoopListener):
    """Explores with a `Navigator` that maps as it goes.

    Examples
    --------
    >>> from slamcli.pipelines.explore import Explorer
    >>> from slamcli.pipelines.navigate import Navigator, SlamChoice
    >>> robot = Navigator(world="office", start=(2.0, 8.8, 0.0), slam=SlamChoice(algo="cartographer"))  # doctest: +SKIP
    >>> explored = Explorer(robot).explore()  # doctest: +SKIP
    >>> explored.status, explored.grid  # doctest: +SKIP

    Parameters
    ----------
    robot
        Stands where its home is.
    parameters
        Of the exploration.
    area
        What there is to explore in truth, for the figure; the robot does not look at it.

    Raises
    ------
    UsageError
        If the robot does not map as it goes.
    """

    def __init__(
        self, robot: Navigator, parameters: ExploreParameters | None = None, *, area: ReachableArea | None = None
    ) -> None:
        if not isinstance(robot.loop.localiser, SlamLocaliser):
            raise UsageError("a robot with a map has nothing to explore: give it SLAM instead of a map")
        self._robot, self._slam = robot, robot.loop.localiser
        self._parameters = parameters or ExploreParameters()
        self._exploration = Exploration(self._parameters, robot.true_pose)
        self._area = area
        self._grid: OccupancyGrid | None = None
        self._history: list[CoveragePoint] = []
        self._frontiers = 0
        self._place: Array | None = None
        self._driven_m, self._clearance_m = 0.0, math.inf
        self._recoveries: list[str] = []
        self._plans = 0
        self._goal: Array | None = None
        self._goals = self._reached = self._given_up = 0

    def on_map(self, time_s: float, grid: OccupancyGrid) -> None:  # noqa: ARG002
        """Keep the newest."""
        self._grid = grid

    def on_truth(self, time_s: float, pose_map: Array, twist: Array) -> None:  # noqa: ARG002
        """Measure the way."""
        if self._place is not None:
            self._driven_m += float(np.hypot(*(pose_map[:2] - self._place)))
        self._place = np.array(pose_map[:2])
        self._clearance_m = min(self._clearance_m, self._robot.plant.clearance_m)

    def on_plan(self, time_s: float, plan: Array) -> None:  # noqa: ARG002
        """Count it."""
        self._plans += 1

    def on_status(self, time_s: float, state: str, message: str) -> None:  # noqa: ARG002
        """Note recoveries."""
        if message.startswith("recovery: "):
            self._recoveries.append(message.removeprefix("recovery: "))

    def explore(self, timeout_s: float = DEFAULT_TIMEOUT_S) -> Explored:
        """Explore until nothing is left that can be reached, and drive home.

        Parameters
        ----------
        timeout_s
            Simulated seconds; when they are over the map is drawn as far as it has come.

        Raises
        ------
        UsageError
            If the timeout is not above 0 and finite.
        """
        if not 0.0 < timeout_s < math.inf:
            raise UsageError(f"--timeout {timeout_s:g}: give simulated seconds above 0")
        loop = self._robot.loop
        begin_s = loop.time_s
        self._robot.listen(self)
        try:
            status, message = self._run(begin_s + timeout_s, timeout_s)
        finally:
            loop.listeners.remove(self)
        grid = self._finished()
        return Explored(
            status=status, message=message, grid=grid, history=tuple(self._history), goals=self._goals, reached=self._reached,
            given_up=self._given_up, begin_s=begin_s, end_s=loop.time_s, clearance_m=self._clearance_m,
            recoveries=tuple(self._recoveries), plans=self._plans,
        )  # fmt: skip

    def _run(self, end_s: float, timeout_s: float) -> tuple[Status, str]:
        loop, period = self._robot.loop, 1.0 / self._parameters.planner_frequency
        said = ""
        loop.wait(min(_FIRST_LOOK_S, timeout_s))
        self._exploration = Exploration(
            self._parameters, self._robot.pose
        )  # only with the first scan it knows its home
        while loop.time_s < end_s - 1e-9:
            if self._grid is not None:
                self._measure_now_and_then()
                told = self._look(self._grid)
                said = told.reason or said
                if told.phase is Phase.DONE:
                    return self._verdict(said)
                self._pass_on(told)
            loop.wait(min(period, end_s - loop.time_s))
            self._hear(loop.move_base)
        where = "on the way home" if self._exploration.phase is Phase.RETURNING else f"{self._frontiers} frontiers left"
        return "timeout", f"not done after {timeout_s:.0f} simulated s ({where}): give it more with --timeout"

    def _look(self, grid: OccupancyGrid) -> Directive:
        robot = self._robot
        window = robot.costmaps.world.window()
        told = self._exploration.step(
            costs_for_exploring(window, grid), window.origin_m, window.resolution_m, robot.pose, robot.time_s
        )
        self._frontiers = len(told.frontiers)
        return told

    def _pass_on(self, told: Directive) -> None:
        """Tell move_base what has changed."""
        loop = self._robot.loop
        if told.goal is None:
            if loop.move_base.phase is not move_base.Phase.IDLE:
                loop.move_base.cancel()
            self._goal = None
        elif told.is_new:
            if self._goal is None or np.hypot(*(told.goal[:2] - self._goal[:2])) > 1.0:
                self._goals += 1
            self._goal = told.goal
            loop.send(told.goal)

    def _hear(self, driver: move_base.MoveBase) -> None:
        """Tell the exploration what has become of its goal."""
        if self._goal is None:
            return
        if driver.phase is move_base.Phase.SUCCEEDED:
            self._reached += 1
            self._exploration.reached(self._robot.time_s)
            self._goal = None
        elif driver.phase is move_base.Phase.ABORTED:
            self._given_up += 1
            self._exploration.failed(driver.message)
            self._goal = None

    def _verdict(self, said: str) -> tuple[Status, str]:
        loop = self._robot.loop
        loop.move_base.cancel()
        self._robot.plant.command(np.zeros(3))
        if self._driven_m < 0.1 and self._frontiers:
            return "stuck", f"the robot cannot leave its start: {said}"
        return ("stuck" if "failed" in said else "done"), said

    def _measure_now_and_then(self) -> None:
        if self._grid is not None and (
            not self._history or self._robot.time_s >= self._history[-1].time_s + _COVERAGE_S - 1e-6
        ):
            self._measure(self._grid)

    def _measure(self, grid: OccupancyGrid) -> None:
        free = int(free_cells(grid).sum())
        point = CoveragePoint(
            time_s=self._robot.time_s, coverage=math.nan if self._area is None else self._area.share(grid),
            free_m2=free * grid.resolution_m**2, driven_m=self._driven_m, frontiers=self._frontiers,
        )  # fmt: skip
        if self._history and self._history[-1].time_s >= point.time_s - 1e-9:
            self._history.pop()
        self._history.append(point)

    def _finished(self) -> OccupancyGrid | None:
        """Return the map that SLAM ends with, told to all who listen."""
        try:
            grid = self._slam.mapper.finish().grid
        except EstimationError:
            return None
        if grid is None:
            return None
        grid = straighten(self._slam.placed(grid))
        self._measure(grid)
        for listener in self._robot.loop.listeners:
            listener.on_map(self._robot.time_s, grid)
        return grid
