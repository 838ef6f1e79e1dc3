# SPDX-License-Identifier: MIT
"""From the global plan to the part of it that a local planner can see, in the odometry frame."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.geometry import se2
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.local_planner import NoCommandError
from slamcli.navigation.robot_state import RobotState

_SPACING_M = 0.05
_PRUNE_RADIUS_M = 1.0  # base_local_planner's goal functions have it as a constant
_SAME_GOAL = 1e-9
_TIE_M = 0.1
_CUSP_M = 0.05
_LEAST_STEP_M = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LocalPlan:
    """The part of the global plan within the local costmap."""

    poses: NDArray[np.float64]
    """float64 (N, 3), N >= 1, in odom: x, y (metres), yaw (radians)."""
    goal: NDArray[np.float64]
    """float64 (3,), in odom: the end of the global plan, which may lie outside the costmap."""
    reaches_goal: bool
    """Whether the last pose is the goal."""
    distance_m: float
    """From the robot to the nearest of the poses."""
    to_end: bool
    """Whether the last pose is the goal or a cusp where the plan is cut."""
    remaining_m: float
    """Along the global plan from the pose nearest to the robot to the goal, or to the cusp where the plan is cut."""


class PlanWindow:
    """Holds the global plan and how far along it the robot has come.

    Parameters
    ----------
    keep_behind_m
        How much of the plan behind the robot stays, metres.
    follow_progress
        Look for the robot only where it can have come since the last time. False does what base_local_planner does: the
        window begins with the first pose of the plan that is near enough, be it a stretch that the robot has left long
        ago; then `prune` drops poses for good until one is within 1 m.
    prune
        ``prune_plan``; only without `follow_progress`.
    stop_at_cusps
        Show the plan only as far as the place where it turns back (from forward to reverse, or the other way), and go on
        from there when the robot is within 5 cm of it: so that a car drives there and does not cut it short.

    References
    ----------
    ROS package base_local_planner, ``goal_functions`` (``transformGlobalPlan``, ``prunePlan``).
    """

    def __init__(
        self,
        *,
        keep_behind_m: float = 0.0,
        follow_progress: bool = True,
        prune: bool = False,
        stop_at_cusps: bool = False,
    ) -> None:
        self._keep_behind_m = keep_behind_m
        self._stop_at_cusps = stop_at_cusps
        self._follow_progress = follow_progress
        self._prune = prune
        self.clear()

    def clear(self) -> None:
        """Forget the plan."""
        self._goal: NDArray[np.float64] | None = None
        self._later: list[NDArray[np.float64]] = []
        self._show(np.empty((0, 3)))

    @property
    def goal(self) -> NDArray[np.float64]:
        """float64 (3,), map frame: the end of the plan.

        Raises
        ------
        NoCommandError
            If there is no plan.
        """
        if self._goal is None:
            raise NoCommandError("there is no global plan")
        return self._goal

    @property
    def has_plan(self) -> bool:
        """Whether there is a plan."""
        return self._goal is not None

    def set_plan(self, plan: NDArray[np.float64]) -> bool:
        """Take a plan, float64 (N, 3), map frame; return whether it has another goal than the one before.

        Stretches longer than 5 cm get poses between, so that any planner's plan can be cut and searched.

        Raises
        ------
        DataError
            If it has no poses, or numbers that are not finite.
        """
        plan = np.ascontiguousarray(plan, dtype=np.float64)
        if plan.ndim != 2 or plan.shape[1:] != (3,) or not len(plan) or not np.isfinite(plan).all():
            raise DataError(f"a global plan needs finite poses (N, 3), N >= 1; got shape {plan.shape}")
        new = self._goal is None or bool(np.abs(plan[-1] - self._goal).max() > _SAME_GOAL)
        self._goal = plan[-1].copy()
        first, *self._later = between_cusps(plan) if self._stop_at_cusps else [plan]
        self._show(_dense(first))
        return new

    def _show(self, stretch: NDArray[np.float64]) -> None:
        """Take a stretch of the plan as what there is to follow."""
        self._plan = stretch
        self._along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(stretch[:, :2], axis=0).T))])
        self._progress = 0
        self._known = False

    def cut(self, state: RobotState, costmap: CostWindow) -> LocalPlan:
        """Return what of the plan lies ahead and within reach of the costmap: half its longer side from the robot.

        Raises
        ------
        NoCommandError
            If there is no plan, or it is nowhere that near.
        """
        goal = self.goal
        robot = state.pose_map
        reach = 0.5 * max(costmap.costs.shape) * costmap.resolution_m
        first, nearest, offset = self._beginning(robot, reach)
        while self._later and self._along[-1] - self._along[nearest] < _CUSP_M:
            self._show(_dense(self._later.pop(0)))
            first, nearest, offset = self._beginning(robot, reach)
        last = min(
            first + 1 + int(np.searchsorted(self._along[first:], self._along[first] + 8.0 * reach)), len(self._plan)
        )
        beyond = np.flatnonzero(_squared(self._plan[first:last], robot) > reach * reach)
        inside = beyond[beyond > nearest - first]
        end = first + int(inside[0]) if len(inside) else last
        T_odom_map = state.T_odom_map
        return LocalPlan(
            poses=np.ascontiguousarray(se2.compose(T_odom_map, self._plan[first:end])),
            goal=se2.compose(T_odom_map, goal),
            reaches_goal=end == len(self._plan) and not self._later,
            distance_m=offset,
            to_end=end == len(self._plan),
            remaining_m=float(self._along[-1] - self._along[nearest]),
        )

    def _beginning(self, robot: NDArray[np.float64], reach: float) -> tuple[int, int, float]:
        """Return where the window begins, the pose nearest to the robot, and its distance in metres."""
        squared = _squared(self._plan, robot)
        if self._follow_progress:
            nearest = self._advance(squared, reach)
            self._check_reach(squared[nearest], reach)
            first = int(np.searchsorted(self._along, self._along[nearest] - self._keep_behind_m))
            while squared[first] > reach * reach:
                first += 1
            return min(first, nearest), nearest, float(np.sqrt(squared[nearest]))
        self._check_reach(squared[self._progress :].min(), reach)
        near = np.flatnonzero(squared[self._progress :] <= reach * reach) + self._progress
        first = int(near[0])
        if self._prune:
            pruned = np.flatnonzero(squared[first:] < _PRUNE_RADIUS_M**2)
            self._progress = first = first + int(pruned[0]) if len(pruned) else first
        away = np.flatnonzero(squared[first:] > reach * reach)
        nearest = first + int(np.argmin(squared[first : first + int(away[0]) if len(away) else len(squared)]))
        return first, nearest, float(np.sqrt(squared[nearest]))

    def _advance(self, squared: NDArray[np.float64], reach: float) -> int:
        """Return the pose nearest to the robot among those it can have come to: none far along the plan from the last."""
        if self._known:
            begin = int(np.searchsorted(self._along, self._along[self._progress] - 0.5 * reach))
            end = int(np.searchsorted(self._along, self._along[self._progress] + 0.5 * reach, side="right"))
            nearest = begin + int(np.argmin(squared[begin:end]))
            if squared[nearest] <= 0.25 * reach * reach:
                self._progress = nearest
                return nearest
        # Lost, or a new plan. Where ways lie side by side the first one wins: a plan begins where the robot is.
        close = squared <= (float(np.sqrt(squared.min())) + _TIE_M) ** 2
        begin = int(np.argmax(close))
        length = int(np.argmin(np.append(close[begin:], False)))
        nearest = begin + int(np.argmin(squared[begin : begin + length]))
        self._progress, self._known = nearest, True
        return nearest

    def _check_reach(self, squared: float, reach: float) -> None:
        if squared > reach * reach:
            raise NoCommandError(
                f"the global plan is {squared**0.5:.2f} m away from the robot, more than the local costmap reaches"
                f" ({reach:.2f} m)"
            )


def between_cusps(plan: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return a plan (N, 3) cut where it turns back by more than a right angle; a cusp ends one piece and begins the next.

    Poses less than a millimetre from the one before are left out, but for the last, which stays as it is.
    """
    steps = np.hypot(*np.diff(plan[:, :2], axis=0).T)
    kept = plan[np.concatenate([[True], steps >= _LEAST_STEP_M])]
    if len(kept) == 1:
        return [plan]
    kept[-1] = plan[-1]
    ways = np.diff(kept[:, :2], axis=0)
    cusps = np.flatnonzero((ways[:-1] * ways[1:]).sum(axis=1) < 0.0) + 1
    borders = [0, *cusps.tolist(), len(kept) - 1]
    return [kept[a : b + 1] for a, b in itertools.pairwise(borders)]


def _squared(plan: NDArray[np.float64], robot: NDArray[np.float64]) -> NDArray[np.float64]:
    dx, dy = plan[:, 0] - robot[0], plan[:, 1] - robot[1]
    return dx * dx + dy * dy


def _dense(plan: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the plan with poses added so that neighbours are at most 5 cm apart; yaws turn the shorter way."""
    lengths = np.hypot(*np.diff(plan[:, :2], axis=0).T)
    pieces = np.maximum(np.ceil(lengths / _SPACING_M), 1).astype(np.int64)
    if len(pieces) == 0 or pieces.max() == 1:
        return plan
    segment = np.repeat(np.arange(len(pieces)), pieces)
    share = (np.arange(pieces.sum()) - (np.cumsum(pieces) - pieces)[segment]) / pieces[segment]
    steps = np.diff(plan, axis=0)
    steps[:, 2] = se2.wrap_angle(steps[:, 2])
    return np.vstack([plan[segment] + share[:, None] * steps[segment], plan[-1:]])
