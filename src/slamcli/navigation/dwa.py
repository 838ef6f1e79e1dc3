# SPDX-License-Identifier: MIT
"""The dynamic window approach, as ROS' DWAPlannerROS does it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.dwa_parameters import DwaParameters
from slamcli.navigation.dwa_scoring import DwaScoring, Scaling, ScoredMotions
from slamcli.navigation.goal_latch import GoalLatch, GoalTolerances
from slamcli.navigation.local_planner import LocalCommand, NoCommandError
from slamcli.navigation.oscillation import Oscillation
from slamcli.navigation.plan_heading import TurnToPlan
from slamcli.navigation.plan_window import LocalPlan, PlanWindow
from slamcli.navigation.robot_state import RobotState
from slamcli.navigation.velocity_samples import sample_velocities


class DwaPlanner:
    """A local planner that tries the velocities within reach and takes the one whose motion costs least.

    Parameters
    ----------
    parameters
        What the robot can do and what motions cost.
    control_period_s
        Time between commands; DWAPlannerROS takes it from move_base's controller_frequency.
    scaling
        How weights are meant: ``noetic`` or ``kinetic`` (before release 1.16).

    References
    ----------
    Fox, Burgard, Thrun: The dynamic window approach to collision avoidance, 1997, doi:10.1109/100.580977; Gerkey, Konolige:
    Planning and control in unstructured terrain, 2008; ROS packages dwa_local_planner and base_local_planner.
    """

    def __init__(
        self, parameters: DwaParameters, *, control_period_s: float = 0.05, scaling: Scaling = "noetic"
    ) -> None:
        self.parameters = parameters
        self._period_s = control_period_s
        self._scoring = DwaScoring(parameters, scaling)
        self._plans = PlanWindow(follow_progress=parameters.follow_progress, prune=parameters.prune_plan)
        self._tolerances = GoalTolerances(
            xy_m=parameters.xy_goal_tolerance,
            yaw_rad=parameters.yaw_goal_tolerance,
            latch=parameters.latch_xy_goal_tolerance,
            stopped_m_s=parameters.trans_stopped_vel,
            stopped_rad_s=parameters.theta_stopped_vel,
            acc=(parameters.acc_lim_x, parameters.acc_lim_y, parameters.acc_lim_theta),
            min_vel_theta=parameters.min_vel_theta,
            max_vel_theta=parameters.max_vel_theta,
            period_s=control_period_s,
        )
        self._latch = GoalLatch(self._tolerances)
        self._turn = TurnToPlan(parameters.turn_to_plan, self._tolerances)
        self._oscillation = Oscillation(parameters.oscillation_reset_dist, parameters.oscillation_reset_angle)

    def set_plan(self, plan: NDArray[np.float64]) -> None:
        """Take a new global plan, float64 (N, 3), map frame. A new goal resets the latch and the oscillation flags."""
        if self._plans.set_plan(plan):
            self._latch.reset()
            self._turn.reset()
            self._oscillation.reset()

    def reset(self) -> None:
        """Forget plan, latch and oscillation."""
        self._plans.clear()
        self._latch.reset()
        self._turn.reset()
        self._oscillation.reset()

    def is_goal_reached(self, state: RobotState) -> bool:
        """Whether the robot stands at the goal, within xy_goal_tolerance and yaw_goal_tolerance."""
        return self._plans.has_plan and self._latch.goal_reached(state.pose_map, self._plans.goal, state.twist)

    def compute_command(self, state: RobotState, costmap: CostWindow) -> LocalCommand:
        """Return the velocity for the next control period.

        Raises
        ------
        NoCommandError
            If every motion is out (the message counts why), or there is no plan within the costmap.
        """
        plan = self._plans.cut(state, costmap)
        pose = state.pose_odom
        self._scoring.prepare(pose, plan.poses, costmap, ends=plan.reaches_goal)
        if self._latch.position_reached(pose, plan.goal):
            twist = self._latch.command(pose, plan.goal, state.twist, lambda sample: self._is_free(state, sample))
            return LocalCommand(twist=twist, trajectory=np.empty((0, 3)), cost=0.0)
        turn = self._turn.command(pose, state.twist, plan.poses, 2.0 * self.parameters.min_vel_trans)
        if turn is not None and self._is_free(state, turn):
            return LocalCommand(twist=turn, trajectory=np.empty((0, 3)), cost=0.0)
        motions = self._best(state, self._samples(state, plan))
        command = motions.commands[motions.chosen].copy()
        self._oscillation.update(pose, command, self.parameters.min_vel_trans)
        return LocalCommand(
            twist=command,
            trajectory=self._scoring.motion(pose, state.twist, motions.samples[motions.chosen]),
            cost=float(motions.totals[motions.chosen]),
        )

    def evaluate(self, state: RobotState, costmap: CostWindow) -> ScoredMotions:
        """Return what every critic says of every motion now; changes nothing.

        Raises
        ------
        NoCommandError
            If there is no plan within the costmap.
        """
        plan = self._plans.cut(state, costmap)
        self._scoring.prepare(state.pose_odom, plan.poses, costmap, ends=plan.reaches_goal)
        samples = self._samples(state, plan)
        return self._scoring.score(state.pose_odom, state.twist, samples, self._oscillation.forbidden, every=True)

    def _best(self, state: RobotState, samples: NDArray[np.float64]) -> ScoredMotions:
        """Return scored motions of which one is chosen, those of the first stage that has a valid one."""
        pose, twist, forbidden = state.pose_odom, state.twist, self._oscillation.forbidden
        for tried in self._stages(samples):
            motions = self._scoring.score(pose, twist, tried, forbidden)
            if motions.chosen >= 0:
                return motions
        refusals = self._scoring.score(pose, twist, samples, forbidden, every=True).refusals()
        raise NoCommandError(f"none of {len(samples)} motions will do: {refusals}")

    def _stages(self, samples: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Return what is tried in turn: what gets on, then turning, then backing up."""
        if not self.parameters.progress:
            return [samples]
        back = samples[:, 0] < 0.0
        on = (np.hypot(samples[:, 0], samples[:, 1]) >= self.parameters.min_vel_trans - 1e-4) & ~back
        return [samples[on], samples[~on & ~back], samples[back]]

    def _samples(self, state: RobotState, plan: LocalPlan) -> NDArray[np.float64]:
        distance = math.hypot(*(plan.poses[-1, :2] - state.pose_odom[:2]))
        return sample_velocities(self.parameters, state.twist, distance, self._period_s)

    def _is_free(self, state: RobotState, sample: NDArray[np.float64]) -> bool:
        """Whether a motion hits nothing; one too slow to be sampled always passes, as in DWAPlannerROS."""
        self._oscillation.reset()
        motions = self._scoring.score(state.pose_odom, state.twist, sample[None], every=True)
        return motions.chosen == 0 or motions.totals[0] == -1.0
