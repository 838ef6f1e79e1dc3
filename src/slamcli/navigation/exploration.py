# SPDX-License-Identifier: MIT
"""Where to drive next in an unknown world: the state machine of explore_lite, without a clock or a robot of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation.explore_parameters import ExploreParameters
from slamcli.navigation.frontiers import Frontier, FrontierSearch

_SAME_M = 1.0
"""A frontier that comes so near to the present goal is taken for the same one: it shrinks and moves as the map grows."""
_NEW_GOAL_M = 0.05
"""A goal that moved by less is the same goal."""
_PROGRESS_M = 0.05
"""Coming nearer by less is none."""
_DRIVEN_M = 0.5
"""Driving so far after a goal that moves is progress."""


class Phase(Enum):
    """What the exploration is doing."""

    EXPLORING = "exploring"
    """On the way to a frontier, or looking for one."""
    WAITING = "waiting"
    """There are frontiers, but the robot has just been there: the map may be late."""
    RETURNING = "returning"
    """Nothing is left; on the way home."""
    DONE = "done"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Directive:
    """What to do now."""

    phase: Phase
    goal: NDArray[np.float64] | None
    """float64 (3,), map frame: where to drive; None: stand."""
    is_new: bool
    """Whether the goal is another one than before: cancel that, and send this."""
    frontiers: tuple[Frontier, ...]
    """Those of the last search, the cheapest first."""
    reason: str
    """Why the exploration ended, or what happened since the last directive; empty for nothing."""


@dataclass(slots=True, eq=False)
class _Pursuit:
    """A goal that is driven to."""

    goal: NDArray[np.float64]
    nearest_m: float
    since_s: float
    """When the robot last came nearer."""
    place: NDArray[np.float64]
    """float64 (2,), where it was then."""


class Exploration:
    """Chooses goals among frontiers until none is left that can be reached.

    Call `step` as often as wanted, once a second is usual: frontiers are looked for at ``planner_frequency``, and at once
    after `reached` or `failed`. The goal is the cheapest frontier; the one that is driven to stays unless another is
    cheaper by ``goal_hysteresis``. Goals that fail, or that the robot does not come nearer to for ``progress_timeout``, go on the
    blacklist, and so do frontiers that are still there ``visit_patience`` after the robot has been at their goal. When
    nothing else is left those that failed are tried again, ``blacklist_retries`` times; then the robot drives home.
    """

    def __init__(self, parameters: ExploreParameters, home: NDArray[np.float64]) -> None:
        """Home is a pose (3,) in the map frame."""
        self._parameters, self._home = parameters, np.array(home, dtype=np.float64)
        self._search = FrontierSearch(parameters)
        self._phase = Phase.EXPLORING
        self._pursuit: _Pursuit | None = None
        self._sent: NDArray[np.float64] | None = None
        self._blacklist: list[NDArray[np.float64]] = []
        self._exhausted: list[NDArray[np.float64]] = []
        self._visited: list[tuple[NDArray[np.float64], float]] = []
        self._retries = parameters.blacklist_retries
        self._frontiers: tuple[Frontier, ...] = ()
        self._looked_s = -math.inf
        self._same_m = _SAME_M
        self._said: list[str] = []

    @property
    def phase(self) -> Phase:
        """What the exploration is doing."""
        return self._phase

    @property
    def blacklist(self) -> tuple[NDArray[np.float64], ...]:
        """Goals, float64 (3,) each, that are not tried any more: those that failed, then those that showed nothing."""
        return (*self._blacklist, *self._exhausted)

    def step(
        self,
        costs: NDArray[np.uint8],
        origin_m: tuple[float, float],
        resolution_m: float,
        pose: NDArray[np.float64],
        time_s: float,
    ) -> Directive:
        """Return what to do now.

        Parameters
        ----------
        costs, origin_m, resolution_m
            The map so far, see `FrontierSearch.find`: `costs_for_exploring` makes it of the global costmap.
        pose
            float64 (3,), of the robot in the map frame.
        time_s
            Simulated seconds; never less than before.
        """
        if self._phase in (Phase.RETURNING, Phase.DONE):
            return self._directive()
        self._watch(pose, time_s)
        if time_s - self._looked_s >= 1.0 / self._parameters.planner_frequency - 1e-9:
            self._looked_s, self._same_m = time_s, max(_SAME_M, 2.0 * resolution_m)
            self._frontiers = self._search.find(costs, origin_m, resolution_m, pose)
            self._choose(pose, time_s)
        return self._directive()

    def reached(self, time_s: float) -> None:
        """Say that the robot is at the goal that was sent."""
        if self._phase is Phase.RETURNING:
            self._end("home again")
        elif self._pursuit is not None:
            self._visited.append((self._pursuit.goal, time_s))
            self._forget()

    def failed(self, reason: str) -> None:
        """Say that the goal that was sent cannot be reached."""
        if self._phase is Phase.RETURNING:
            self._end(f"the way home failed: {reason}")
        elif self._pursuit is not None:
            self._said.append(f"goal given up: {reason}")
            self._blacklist.append(self._pursuit.goal)
            self._forget()

    def _forget(self) -> None:
        """Leave the goal, and look for another one at once."""
        self._pursuit, self._sent, self._looked_s = None, None, -math.inf

    def _watch(self, pose: NDArray[np.float64], time_s: float) -> None:
        """Put the goal on the blacklist if the robot has not come nearer to it for too long."""
        pursuit = self._pursuit
        if pursuit is None:
            return
        left_m = math.hypot(*(pursuit.goal[:2] - pose[:2]))
        if left_m < pursuit.nearest_m - _PROGRESS_M:
            pursuit.nearest_m, pursuit.since_s, pursuit.place = left_m, time_s, pose[:2].copy()
        elif time_s - pursuit.since_s > self._parameters.progress_timeout:
            self._said.append(f"no progress for {self._parameters.progress_timeout:g} s")
            self._blacklist.append(pursuit.goal)
            self._forget()

    def _choose(self, pose: NDArray[np.float64], time_s: float) -> None:
        """Take the best of the frontiers that are not out of the question."""
        allowed = [one for one in self._frontiers if not self._is_blacklisted(one.goal)]
        late = [one for one in allowed if self._is_stale(one.goal, time_s)]
        self._exhausted += [one.goal for one in late]
        candidates = [one for one in allowed if self._visit_of(one.goal) is None]
        if candidates:
            self._phase = Phase.EXPLORING
            self._pursue(self._preferred(candidates), pose, time_s)
        elif len(allowed) > len(late):  # the robot has just been there
            self._phase, self._pursuit, self._sent = Phase.WAITING, None, None
        elif self._retries > 0 and any(self._has_failed(one.goal) for one in self._frontiers):
            self._retries -= 1
            self._said.append("trying once more what failed")
            self._blacklist = []
            self._choose(pose, time_s)
        else:
            self._finish()

    def _preferred(self, candidates: list[Frontier]) -> Frontier:
        best = candidates[0]
        if self._pursuit is None:
            return best
        goal = self._pursuit.goal
        apart = [_distance_m(one, goal) for one in candidates]
        nearest = int(np.argmin(apart))
        if apart[nearest] > self._same_m:
            return best
        present = candidates[nearest]
        return best if best.cost < present.cost - self._parameters.goal_hysteresis else present

    def _pursue(self, frontier: Frontier, pose: NDArray[np.float64], time_s: float) -> None:
        before, goal = self._pursuit, frontier.goal
        left_m = math.hypot(*(goal[:2] - pose[:2]))
        if before is not None and _distance_m(frontier, before.goal) <= self._same_m:
            # The same frontier, seen better. It may run ahead of the robot: then that has to drive for it to be progress.
            if math.hypot(*(goal[:2] - before.goal[:2])) > _NEW_GOAL_M:
                before.goal = goal
                if math.hypot(*(pose[:2] - before.place)) > _DRIVEN_M:
                    before.nearest_m, before.since_s, before.place = left_m, time_s, pose[:2].copy()
            return
        self._pursuit = _Pursuit(goal, left_m, time_s, pose[:2].copy())

    def _finish(self) -> None:
        left = len(self._frontiers)
        self._said.append(
            "nothing is left to explore" if not left else f"{left} frontiers are left that cannot be reached"
        )
        self._pursuit, self._sent = None, None
        self._phase = Phase.RETURNING if self._parameters.return_home else Phase.DONE

    def _end(self, reason: str) -> None:
        self._phase, self._sent = Phase.DONE, None
        self._said.append(reason)

    def _directive(self) -> Directive:
        reason, self._said = "; ".join(self._said), []
        goal = self._home if self._phase is Phase.RETURNING else None
        if self._phase is Phase.EXPLORING and self._pursuit is not None:
            goal = self._pursuit.goal
        is_new = goal is not None and (self._sent is None or not np.array_equal(goal, self._sent))
        self._sent = goal
        return Directive(
            phase=self._phase, goal=None if goal is None else goal.copy(), is_new=is_new, frontiers=self._frontiers,
            reason=reason,
        )  # fmt: skip

    def _is_blacklisted(self, goal: NDArray[np.float64]) -> bool:
        return any(self._is_near(goal, other) for other in self.blacklist)

    def _has_failed(self, goal: NDArray[np.float64]) -> bool:
        """Whether a goal is on the blacklist only because it, or one beside it, failed."""
        exhausted = any(self._is_near(goal, other) for other in self._exhausted)
        return not exhausted and any(self._is_near(goal, other) for other in self._blacklist)

    def _visit_of(self, goal: NDArray[np.float64]) -> float | None:
        """Return when the robot was first at a goal; None for never."""
        return next((when for place, when in self._visited if self._is_near(goal, place)), None)

    def _is_stale(self, goal: NDArray[np.float64], time_s: float) -> bool:
        when = self._visit_of(goal)
        return when is not None and time_s - when > self._parameters.visit_patience

    def _is_near(self, goal: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
        return bool(np.abs(goal[:2] - other[:2]).max() < self._parameters.blacklist_radius)


def _distance_m(frontier: Frontier, goal: NDArray[np.float64]) -> float:
    """Return how near a frontier comes to a goal."""
    return float(np.hypot(*(frontier.points - goal[:2]).T).min())
