# SPDX-License-Identifier: MIT
"""Regulated pure pursuit, as nav2's controller does it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.costmap import INSCRIBED, NO_INFORMATION
from slamcli.navigation.goal_latch import GoalLatch, GoalTolerances
from slamcli.navigation.local_planner import LocalCommand, NoCommandError
from slamcli.navigation.motion_check import arc, hits, is_round
from slamcli.navigation.plan_window import LocalPlan, PlanWindow
from slamcli.navigation.pursuit_parameters import PursuitParameters
from slamcli.navigation.robot_state import RobotState

_LEAST_TURN_RATE = 0.1
_END_M = 0.03
_BEYOND_STEP_M, _BEYOND_POSES = 0.05, 20
_SHARES = (1.0, 0.7, 0.5, 0.35, 0.25)


class RegulatedPurePursuit:
    """A local planner that steers along an arc to a point ahead on the plan, slower in curves and near obstacles.

    It does not drive around anything: where the arc hits an obstacle it refuses, and a new plan is needed.

    Parameters
    ----------
    parameters
        How the plan is followed.
    control_period_s
        Time between commands.

    References
    ----------
    Macenski, Singh, Martin, Gines: Regulated pure pursuit for robot path tracking, Autonomous Robots 47, 2023,
    doi:10.1007/s10514-023-10097-6.
    """

    def __init__(self, parameters: PursuitParameters, *, control_period_s: float = 0.05) -> None:
        self.parameters = parameters
        self._period_s = control_period_s
        self._plans = PlanWindow(stop_at_cusps=parameters.allow_reversing)
        self._is_car = parameters.min_turning_radius > 0.0
        self._latch = GoalLatch(
            GoalTolerances(
                xy_m=parameters.xy_goal_tolerance,
                yaw_rad=parameters.yaw_goal_tolerance,
                latch=parameters.stateful and not self._is_car,
                stopped_m_s=parameters.trans_stopped_velocity,
                stopped_rad_s=parameters.rot_stopped_velocity,
                acc=(2.5, 2.5, parameters.max_angular_accel),
                min_vel_theta=min(_LEAST_TURN_RATE, parameters.rotate_to_heading_angular_vel),
                max_vel_theta=parameters.rotate_to_heading_angular_vel,
                period_s=control_period_s,
            )
        )

    def set_plan(self, plan: NDArray[np.float64]) -> None:
        """Take a new global plan, float64 (N, 3), map frame. A new goal resets the latch."""
        if self._plans.set_plan(plan):
            self._latch.reset()

    def reset(self) -> None:
        """Forget plan and latch."""
        self._plans.clear()
        self._latch.reset()

    def is_goal_reached(self, state: RobotState) -> bool:
        """Whether the robot stands at the goal, within xy_goal_tolerance and yaw_goal_tolerance."""
        return self._plans.has_plan and self._latch.goal_reached(state.pose_map, self._plans.goal, state.twist)

    def compute_command(self, state: RobotState, costmap: CostWindow) -> LocalCommand:
        """Return the velocity for the next control period.

        Raises
        ------
        NoCommandError
            If the motion would hit something, or there is no plan within the costmap.
        """
        plan = self._plans.cut(state, costmap)
        pose, twist = state.pose_odom, state.twist
        if self._is_car:
            if self._latch.goal_reached(pose, plan.goal, np.zeros(3)):
                return LocalCommand(twist=np.zeros(3), trajectory=np.empty((0, 3)), cost=0.0)
            if plan.reaches_goal and plan.remaining_m < _END_M:
                raise NoCommandError("the plan has ended and the goal's heading is not reached: a car needs a new one")
        elif self._latch.position_reached(pose, plan.goal):
            if not self.parameters.use_rotate_to_heading:
                return LocalCommand(twist=np.zeros(3), trajectory=np.empty((0, 3)), cost=0.0)
            command = self._latch.command(pose, plan.goal, twist, lambda wanted: self._is_free(state, wanted, costmap))
            return LocalCommand(twist=command, trajectory=np.empty((0, 3)), cost=0.0)
        ahead = self._in_base(pose, plan)
        backwards = self._is_car and _leads_backwards(plan.poses)
        if self._is_car and plan.to_end:  # so that the last stretch is driven in the heading of its end
            ahead = np.vstack([ahead, _prolonged(ahead[-1], -1.0 if backwards else 1.0)])
        reach = self._lookahead(float(twist[0]))
        for share in _SHARES:
            if share < 1.0 and not self._may_shorten(reach, ahead, plan, costmap):
                break
            command, carrot = self._towards(share * reach, ahead, plan, state, costmap)
            if self._is_car and (command[0] < 0.0) != backwards:
                command = -command
            motion = self._motion(pose, command, float(np.hypot(*carrot)), costmap)
            if not self.parameters.use_collision_detection or self._passes(command, motion, costmap):
                return LocalCommand(twist=command, trajectory=motion, cost=0.0)
        raise NoCommandError(
            f"the robot would hit something within {self.parameters.max_allowed_time_to_collision_up_to_carrot:g} s"
            " on its way to the plan"
        )

    def _may_shorten(self, reach: float, ahead: NDArray[np.float64], plan: LocalPlan, costmap: CostWindow) -> bool:
        """Whether the plan itself is free as far as the point ahead, so that only the arc to it is not."""
        beyond = np.flatnonzero(np.hypot(ahead[:, 0], ahead[:, 1]) >= reach)
        end = int(beyond[0]) + 1 if len(beyond) else len(ahead)
        return self.parameters.shorten_lookahead and not hits(costmap, plan.poses[:end], escape=True)

    def _towards(
        self, reach: float, ahead: NDArray[np.float64], plan: LocalPlan, state: RobotState, costmap: CostWindow
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the twist (3,) to the point `reach` metres ahead, and that point (2,), base frame."""
        carrot = self._carrot(ahead, reach)
        angle = math.atan2(carrot[1], carrot[0])
        if self.parameters.use_rotate_to_heading and abs(angle) > self.parameters.rotate_to_heading_min_angle:
            return np.array([0.0, 0.0, self._rotation(angle, float(state.twist[2]))]), carrot
        return self._along_arc(carrot, ahead, plan, state.pose_odom, costmap), carrot

    def _lookahead(self, speed: float) -> float:
        parameters = self.parameters
        if not parameters.use_velocity_scaled_lookahead_dist:
            return parameters.lookahead_dist
        wanted = abs(speed) * parameters.lookahead_time
        return min(max(wanted, parameters.min_lookahead_dist), parameters.max_lookahead_dist)

    def _in_base(self, pose: NDArray[np.float64], plan: LocalPlan) -> NDArray[np.float64]:
        """Return the poses ahead, float64 (N, 3), in the base frame."""
        return se2.between(pose, plan.poses)

    def _carrot(self, ahead: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
        """Return the point (2,), base frame, where the plan leaves the circle of radius `reach`; its end if it does not."""
        away = np.hypot(ahead[:, 0], ahead[:, 1])
        beyond = np.flatnonzero(away >= reach)
        if not len(beyond):
            return ahead[-1, :2].copy()
        i = int(beyond[0])
        if not self.parameters.use_interpolation or i == 0:
            return ahead[i, :2].copy()
        return _circle_crossing(ahead[i - 1, :2], ahead[i, :2], reach)

    def _along_arc(
        self,
        carrot: NDArray[np.float64],
        ahead: NDArray[np.float64],
        plan: LocalPlan,
        pose: NDArray[np.float64],
        costmap: CostWindow,
    ) -> NDArray[np.float64]:
        """Return the twist (3,) on the arc to the carrot."""
        parameters = self.parameters
        curvature = _curvature(carrot)
        if parameters.use_fixed_curvature_lookahead:
            curvature = _curvature(self._carrot(ahead, parameters.curvature_lookahead_dist))
        if self._is_car:
            tightest = 1.0 / parameters.min_turning_radius
            curvature = min(max(curvature, -tightest), tightest)
        speed = min(self._regulated(curvature, pose, costmap), self._approach(plan))
        sign = -1.0 if parameters.allow_reversing and carrot[0] < 0.0 else 1.0
        return np.array([sign * speed, 0.0, sign * speed * curvature])

    def _regulated(self, curvature: float, pose: NDArray[np.float64], costmap: CostWindow) -> float:
        """Return the speed in a curve and near obstacles (equations 5 and 6 of the paper)."""
        parameters = self.parameters
        in_curve = near = parameters.desired_linear_vel
        radius = 1.0 / abs(curvature) if curvature else math.inf
        if parameters.use_regulated_linear_velocity_scaling and radius < parameters.regulated_linear_scaling_min_radius:
            in_curve *= radius / parameters.regulated_linear_scaling_min_radius
        cost = _cost_at(pose, costmap)
        if parameters.use_cost_regulated_linear_velocity_scaling and cost not in (0, NO_INFORMATION):
            distance = costmap.inscribed_radius_m
            distance -= math.log(min(cost, INSCRIBED) / (INSCRIBED - 1)) / parameters.inflation_cost_scaling_factor
            if distance < parameters.cost_scaling_dist:
                near *= parameters.cost_scaling_gain * distance / parameters.cost_scaling_dist
        return max(
            min(in_curve, near), min(parameters.regulated_linear_scaling_min_speed, parameters.desired_linear_vel)
        )

    def _approach(self, plan: LocalPlan) -> float:
        """Return the speed that the way to the goal allows."""
        parameters = self.parameters
        left = plan.remaining_m
        if left >= parameters.approach_velocity_scaling_dist:
            return math.inf
        share = left / parameters.approach_velocity_scaling_dist
        return max(parameters.desired_linear_vel * share, parameters.min_approach_linear_velocity)

    def _rotation(self, angle: float, measured: float) -> float:
        """Return the turn rate in place that can be reached now and stopped in time."""
        parameters = self.parameters
        change = parameters.max_angular_accel * self._period_s
        wanted = math.copysign(parameters.rotate_to_heading_angular_vel, angle)
        reached = min(max(wanted, measured - change), measured + change)
        most = math.sqrt(2.0 * parameters.max_angular_accel * abs(angle))
        return min(max(reached, -most), most)

    def _motion(
        self, pose: NDArray[np.float64], twist: NDArray[np.float64], carrot_m: float, costmap: CostWindow
    ) -> NDArray[np.float64]:
        """Return the poses (N, 3) up to the carrot or as long as collisions are looked for."""
        seconds = self.parameters.max_allowed_time_to_collision_up_to_carrot
        if twist[0]:
            seconds = min(seconds, carrot_m / abs(twist[0]))
        return arc(pose, twist, seconds, costmap.resolution_m)

    def _passes(self, twist: NDArray[np.float64], motion: NDArray[np.float64], costmap: CostWindow) -> bool:
        turns = not twist[:2].any()
        return (turns and is_round(costmap)) or not hits(
            costmap, motion, escape=True, margin_m=self.parameters.footprint_margin
        )

    def _is_free(self, state: RobotState, twist: NDArray[np.float64], costmap: CostWindow) -> bool:
        seconds = self.parameters.max_allowed_time_to_collision_up_to_carrot
        if not self.parameters.use_collision_detection:
            return True
        # The robot brakes at once: what it does afterwards need not be free.
        braking = max(abs(float(twist[0])) / 2.5, self._period_s) if twist[:2].any() else seconds
        motion = arc(state.pose_odom, twist, min(seconds, braking), costmap.resolution_m)
        return self._passes(twist, motion, costmap)


def _curvature(point: NDArray[np.float64]) -> float:
    """Return 1 / radius, 1/m, of the arc from the origin, along x, to a point (2,): equation 2 of the paper."""
    squared = float(point @ point)
    return 2.0 * float(point[1]) / squared if squared > 1e-6 else 0.0


def _leads_backwards(poses: NDArray[np.float64]) -> bool:
    """Whether a robot that follows poses (N, 3), which do not turn back, drives in reverse."""
    step = poses[min(len(poses) - 1, 3), :2] - poses[0, :2]
    return bool(step @ np.array([math.cos(poses[0, 2]), math.sin(poses[0, 2])]) < 0.0)


def _prolonged(end: NDArray[np.float64], direction: float) -> NDArray[np.float64]:
    """Return poses (N, 3) straight on from a pose (3,)."""
    on = direction * _BEYOND_STEP_M * np.arange(1, _BEYOND_POSES + 1)
    x, y = end[0] + on * math.cos(end[2]), end[1] + on * math.sin(end[2])
    return np.column_stack([x, y, np.full(len(on), end[2])])


def _cost_at(pose: NDArray[np.float64], costmap: CostWindow) -> int:
    column = math.floor((pose[0] - costmap.origin_m[0]) / costmap.resolution_m)
    row = math.floor((pose[1] - costmap.origin_m[1]) / costmap.resolution_m)
    height, width = costmap.costs.shape
    return int(costmap.costs[row, column]) if 0 <= row < height and 0 <= column < width else NO_INFORMATION


def _circle_crossing(inside: NDArray[np.float64], outside: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """Return the point (2,) between one in a circle about the origin and one outside of it that lies on the circle."""
    step = outside - inside
    a, b, c = float(step @ step), float(inside @ step), float(inside @ inside) - radius * radius
    if a == 0.0:
        return outside.copy()
    share = (-b + math.sqrt(max(b * b - a * c, 0.0))) / a
    return inside + min(max(share, 0.0), 1.0) * step
