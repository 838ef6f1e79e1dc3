# SPDX-License-Identifier: MIT
"""Listens to a closed loop and tells its story afterwards."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.evaluation.drive_story import DriveStory, Event, GoalStory
from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid
from slamcli.measurements import Odometry
from slamcli.pipelines.loop_listener import LoopListener

Array = NDArray[np.float64]

_PEOPLE_S = 0.2


class StoryTeller(LoopListener):
    """Keeps what `DriveStory` has; scans, particles and costmaps it lets pass."""

    def __init__(self) -> None:
        self._grid: OccupancyGrid | None = None
        self._truth: tuple[float, Array, Array] | None = None
        self._T_map_odom: Array | None = None
        self._rows: list[tuple[float, Array, Array, Array]] = []
        self._commands: list[tuple[float, Array]] = []
        self._plans: list[Array] = []
        self._people: list[tuple[float, Array]] = []
        self._events: list[Event] = []

    def on_map(self, time_s: float, grid: OccupancyGrid) -> None:  # noqa: ARG002
        """Keep the newest."""
        self._grid = grid

    def on_truth(self, time_s: float, pose_map: Array, twist: Array) -> None:
        """Keep it until odometry comes."""
        self._truth = time_s, np.array(pose_map), np.array(twist)

    def on_odometry(self, time_s: float, odometry: Odometry) -> None:  # noqa: ARG002
        """Put truth and the localiser's opinion side by side."""
        if self._truth is None:
            return
        estimate = np.full(3, np.nan)
        if self._T_map_odom is not None:
            estimate = se2.compose(self._T_map_odom, odometry.pose_se2)
        self._rows.append((self._truth[0], self._truth[1], estimate, self._truth[2]))

    def on_localisation(self, time_s: float, T_map_odom: Array, covariance: Array, particles: Array) -> None:  # noqa: ARG002
        """Keep the correction."""
        self._T_map_odom = np.array(T_map_odom, dtype=np.float64)

    def on_command(self, time_s: float, twist: Array) -> None:
        """Keep it."""
        self._commands.append((time_s, np.array(twist)))

    def on_plan(self, time_s: float, plan: Array) -> None:  # noqa: ARG002
        """Keep it."""
        self._plans.append(np.array(plan))

    def on_people(self, time_s: float, discs: Array) -> None:
        """Keep where they are, five times a second."""
        if not self._people or time_s >= self._people[-1][0] + _PEOPLE_S - 1e-6:
            self._people.append((time_s, np.array(discs, dtype=np.float64).reshape(-1, 5)))

    def on_goal(self, time_s: float, goal: Array) -> None:
        """Keep it as an event."""
        self._events.append(
            Event(time_s=time_s, kind="goal", message=f"{goal[0]:.2f}, {goal[1]:.2f}, {goal[2]:.2f} rad")
        )

    def on_status(self, time_s: float, state: str, message: str) -> None:
        """Keep changes; a recovery has its own kind."""
        is_recovery = message.startswith("recovery: ")
        event = Event(
            time_s=time_s, kind="recovery" if is_recovery else state, message=message.removeprefix("recovery: ")
        )
        last = self._events[-1] if self._events else None
        if last is None or (last.kind, last.message) != (event.kind, event.message):
            self._events.append(event)

    def story(self, goals: Sequence[GoalStory], collisions: Sequence[Event] = ()) -> DriveStory:
        """Return what happened; `goals` and `collisions` come from who drove."""
        rows, commands = self._rows, self._commands
        return DriveStory(
            grid=self._grid,
            times_s=np.array([row[0] for row in rows]),
            truth=np.array([row[1] for row in rows]).reshape(-1, 3),
            estimate=np.array([row[2] for row in rows]).reshape(-1, 3),
            twists=np.array([row[3] for row in rows]).reshape(-1, 3),
            command_times_s=np.array([row[0] for row in commands]),
            commands=np.array([row[1] for row in commands]).reshape(-1, 3),
            plans=tuple(self._plans),
            people_times_s=np.array([row[0] for row in self._people]),
            people=tuple(row[1] for row in self._people),
            events=tuple(sorted([*self._events, *collisions], key=lambda event: event.time_s)),
            goals=tuple(goals),
        )
