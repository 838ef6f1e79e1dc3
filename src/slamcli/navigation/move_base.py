# SPDX-License-Identifier: MIT
"""move_base: from a goal to velocities, by planning, controlling and recovering, in simulated time.

Reference: the state machine of ROS's ``move_base`` (MoveBase::executeCycle and planThread). What runs there in threads runs
here in turn, so that a run depends on nothing but its input.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import PlanningError
from slamcli.navigation.local_planner import LocalPlanner, NoCommandError
from slamcli.navigation.move_base_parameters import MoveBaseParameters
from slamcli.navigation.recovery import Costmaps, MoveSlowAndClear, Recovery
from slamcli.navigation.robot_state import RobotState

Array = NDArray[np.float64]
STOP = np.zeros(3)


class Phase(Enum):
    """What move_base is doing."""

    IDLE = "idle"
    PLANNING = "planning"
    CONTROLLING = "controlling"
    CLEARING = "clearing"
    SUCCEEDED = "succeeded"
    ABORTED = "aborted"


class _Trigger(Enum):
    PLANNING = "no valid plan"
    CONTROLLING = "no valid control"
    OSCILLATION = "oscillating"


class PlanMaker(Protocol):
    """The global planner as move_base uses it."""

    def make_plan(self, start: Array, goal: Array) -> Array:
        """Return a plan (N, 3), poses in map, on the global costmap as it is now; raises PlanningError."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cycle:
    """What one control cycle ends with."""

    twist: Array
    """float64 (3,), the velocity that the robot is asked for."""
    phase: Phase
    message: str = ""
    """Why the phase changed, or what the last failure was."""
    plan: Array | None = None
    """A new global plan, (N, 3) in map, if one was made in this cycle."""
    local_plan: Array | None = None
    """What the local planner expects, (N, 3) in odom, if it gave a velocity."""
    recovery: str = ""
    """Name of a recovery behaviour that began in this cycle."""


class MoveBase:
    """One robot's navigation: give it a goal, then call `step` once per control period until the phase ends."""

    def __init__(
        self,
        parameters: MoveBaseParameters,
        costmaps: Costmaps,
        planner: PlanMaker,
        local_planner: LocalPlanner,
        recoveries: Sequence[Recovery],
    ) -> None:
        self.parameters = parameters
        self.phase, self.message = Phase.IDLE, ""
        self._costmaps, self._planner, self._local = costmaps, planner, local_planner
        self._recoveries = tuple(recoveries) if parameters.recovery_behavior_enabled else ()
        self._limits = [r for r in self._recoveries if isinstance(r, MoveSlowAndClear)]
        self._goal: Array = STOP
        self._active: Recovery | None = None
        self._next_recovery = 0
        self._trigger = _Trigger.PLANNING
        self._retries = 0
        self._last_plan_s = self._last_control_s = self._last_progress_s = 0.0
        self._next_replan_s = np.inf
        self._progress_from: Array = np.zeros(2)

    def set_goal(self, goal: Array, state: RobotState) -> None:
        """Take a goal (3,) in map; planning begins with the next cycle."""
        self._goal = np.asarray(goal, dtype=np.float64)
        self._local.reset()
        self._active, self._next_recovery, self._trigger = None, 0, _Trigger.PLANNING
        self._begin_planning(state.time_s)
        self._last_control_s = self._last_progress_s = state.time_s
        self._progress_from = state.pose_odom[:2].copy()
        self.message = ""

    def cancel(self) -> None:
        """Give the goal up; the robot is asked to stop."""
        self.phase = Phase.IDLE
        self._local.reset()

    def step(self, state: RobotState) -> Cycle:
        """Return the velocity for the period that begins now."""
        if self.phase in (Phase.IDLE, Phase.SUCCEEDED, Phase.ABORTED):
            return Cycle(twist=STOP, phase=self.phase, message=self.message)
        moved = float(np.hypot(*(state.pose_odom[:2] - self._progress_from)))
        if moved >= self.parameters.oscillation_distance:
            self._last_progress_s, self._progress_from = state.time_s, state.pose_odom[:2].copy()
            if self._trigger is _Trigger.OSCILLATION:
                self._next_recovery = 0
        late = self._costmaps.local.out_of_date(state.time_s)
        if late:  # expected_update_rate: who does not see does not drive
            self.message = f"no news from {', '.join(late)}: the local costmap is out of date"
            return self._cycle(STOP)
        if self.phase is Phase.PLANNING:
            return self._plan(state)
        if self.phase is Phase.CONTROLLING:
            return self._control(state)
        return self._clear(state)

    def _begin_planning(self, now_s: float) -> None:
        self.phase, self._last_plan_s, self._retries = Phase.PLANNING, now_s, 0

    def _plan(self, state: RobotState) -> Cycle:
        try:
            plan = self._take_plan(state)
        except PlanningError as error:
            self.message = str(error)
            self._retries += 1
            p = self.parameters
            if state.time_s > self._last_plan_s + p.planner_patience or 0 <= p.max_planning_retries < self._retries:
                self._begin_clearing(_Trigger.PLANNING)
            return self._cycle(STOP)
        self.phase = Phase.CONTROLLING
        return self._control(state, plan)

    def _take_plan(self, state: RobotState) -> Array:
        """Make a plan and hand it to the local planner."""
        plan = self._planner.make_plan(state.pose_map, self._goal)
        self._last_plan_s, self._retries = state.time_s, 0
        period = self.parameters.planner_frequency
        self._next_replan_s = state.time_s + 1.0 / period if period > 0.0 else np.inf
        if self._trigger is _Trigger.PLANNING:
            self._next_recovery = 0
        self._local.set_plan(plan)
        return plan

    def _control(self, state: RobotState, plan: Array | None = None) -> Cycle:
        if plan is None and state.time_s >= self._next_replan_s - 1e-9:
            try:
                plan = self._take_plan(state)
            except PlanningError:  # the plan that there is stays good until control fails
                self._next_replan_s += 1.0 / self.parameters.planner_frequency
        if self._local.is_goal_reached(state):
            self.phase, self.message = Phase.SUCCEEDED, "goal reached"
            return self._cycle(STOP, plan)
        timeout = self.parameters.oscillation_timeout
        if timeout > 0.0 and state.time_s > self._last_progress_s + timeout:
            self.message = f"moved less than {self.parameters.oscillation_distance:g} m in {timeout:g} s"
            self._begin_clearing(_Trigger.OSCILLATION)
            return self._cycle(STOP, plan)
        try:
            command = self._local.compute_command(state, self._costmaps.local.window())
        except NoCommandError as error:
            self.message = str(error)
            if state.time_s > self._last_control_s + self.parameters.controller_patience:
                self._begin_clearing(_Trigger.CONTROLLING)
            else:
                self._begin_planning(state.time_s)
            return self._cycle(STOP, plan)
        self._last_control_s = state.time_s
        if self._trigger is _Trigger.CONTROLLING:
            self._next_recovery = 0
        twist = command.twist
        for limited in self._limits:
            twist = limited.limit(state, twist)
        return self._cycle(twist, plan, command.trajectory)

    def _begin_clearing(self, trigger: _Trigger) -> None:
        self.phase, self._trigger, self._active = Phase.CLEARING, trigger, None

    def _clear(self, state: RobotState) -> Cycle:
        begun = ""
        if self._active is None:
            if self._next_recovery >= len(self._recoveries):
                return self._abort()
            self._active = self._recoveries[self._next_recovery]
            self._next_recovery += 1
            begun = self._active.name
            self._active.begin(state)
        twist = self._active.step(state)
        if twist is None:
            self._active = None
            self._last_progress_s = state.time_s
            self._progress_from = state.pose_odom[:2].copy()
            self._begin_planning(state.time_s)
            twist = STOP
        return self._cycle(twist, recovery=begun)

    def _abort(self) -> Cycle:
        failure = {
            _Trigger.PLANNING: "failed to find a valid plan",
            _Trigger.CONTROLLING: "failed to find a valid control",
            _Trigger.OSCILLATION: "the robot is oscillating",
        }[self._trigger]
        tried = " even after executing all recovery behaviours" if self._recoveries else ""
        why = f": {self.message}" if self.message else ""
        self.phase, self.message = Phase.ABORTED, f"{failure}{tried}{why}"
        return self._cycle(STOP)

    def _cycle(
        self, twist: Array, plan: Array | None = None, local_plan: Array | None = None, recovery: str = ""
    ) -> Cycle:
        return Cycle(
            twist=twist, phase=self.phase, message=self.message, plan=plan, local_plan=local_plan, recovery=recovery
        )
