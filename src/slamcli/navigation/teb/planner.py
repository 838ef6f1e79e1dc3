# SPDX-License-Identifier: MIT
"""The local planner teb_local_planner: timed elastic bands round what the costmap shows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.local_planner import LocalCommand, NoCommandError
from slamcli.navigation.plan_window import LocalPlan, PlanWindow
from slamcli.navigation.robot_state import RobotState
from slamcli.navigation.teb.alternatives import Alternative, Alternatives
from slamcli.navigation.teb.band import Band
from slamcli.navigation.teb.command import first_twist, saturated, steering
from slamcli.navigation.teb.local_plan import spaced, trimmed
from slamcli.navigation.teb.moving_obstacles import PLUGIN, MovingObstacles
from slamcli.navigation.teb.obstacle_field import ObstacleField, obstacle_field
from slamcli.navigation.teb.optimise import BandOptimiser
from slamcli.navigation.teb.oscillation import HorizonBackup, OscillationRecovery
from slamcli.navigation.teb.parameters import TebParameters

Array = NDArray[np.float64]
_NO_NEARER_M = 0.005
_CHECK_EVERY_RAD = 0.2


class TebPlanner:
    """Follows a global plan by a timed elastic band; a `LocalPlanner`.

    Each cycle the bands of the last one are moved to where the robot is, alternatives that pass obstacles on other sides
    are looked for, all are optimised, and the best one whose beginning is free of collisions gives the command.

    Parameters
    ----------
    parameters
        Under the names of TebLocalPlannerROS.
    control_period_s
        Seconds between two commands.
    seed
        For the random points from which alternatives are found.

    Notes
    -----
    The footprint and the distance to keep come from the costmap unless ``footprint_model.type`` says otherwise; the
    original's point of 0.5 m is too large for doors under 1 m. Bands end with the robot at rest where the local plan ends.

    References
    ----------
    Roesmann, Feiten, Woesch, Hoffmann, Bertram, 2012, 2013; Roesmann, Hoffmann, Bertram, 2017; ROS package
    teb_local_planner.
    """

    def __init__(self, parameters: TebParameters, *, control_period_s: float = 0.05, seed: int = 0) -> None:
        self._parameters = parameters
        self._window = PlanWindow(
            keep_behind_m=parameters.trajectory.global_plan_prune_distance,
            stop_at_cusps=parameters.robot.min_turning_radius > 0.0,
        )
        self._alternatives = Alternatives(parameters, seed=seed)
        self._oscillation = OscillationRecovery(parameters, control_period_s)
        self._horizon = HorizonBackup(parameters)
        self._discs = np.zeros((0, 5))
        self._moving = MovingObstacles() if parameters.obstacles.costmap_converter_plugin == PLUGIN else None
        self._via_points_left = 0

    @property
    def alternatives(self) -> tuple[Alternative, ...]:
        """The bands of the last cycle, the chosen one first; for drawing."""
        return self._alternatives.kept

    def set_plan(self, plan: Array) -> None:
        """Take a new global plan; see `LocalPlanner`."""
        if self._window.set_plan(plan):
            self._horizon.clear()

    def set_moving_obstacles(self, discs: Array) -> None:
        """Take what is known to move: float64 (D, 5) x, y, radius, vx, vy in the odometry frame, until the next call."""
        self._discs = np.array(discs, dtype=np.float64).reshape(-1, 5)

    def reset(self) -> None:
        """Forget plan, bands and what was noticed."""
        self._window.clear()
        self._alternatives.clear()
        self._oscillation.clear()
        self._horizon.clear()

    def compute_command(self, state: RobotState, costmap: CostWindow) -> LocalCommand:
        """Return the velocity for the next control period.

        With ``cmd_angle_instead_rotvel`` the third number is the steering angle in radians.

        Raises
        ------
        NoCommandError
            If there is no plan near, or no band whose first poses are free of collisions.
        """
        rules = self._parameters
        plan = self._window.cut(state, costmap)
        path, via_points, reaches_goal = self._local_plan(plan, state, costmap)
        obstacles = obstacle_field(
            costmap,
            state.pose_odom,
            behind_m=rules.obstacles.costmap_obstacles_behind_robot_dist,
            use_cells=rules.obstacles.include_costmap_obstacles,
            discs=self._moving_discs(state, costmap),
        )
        optimiser = BandOptimiser(
            rules,
            obstacles,
            start_twist=state.twist,
            turning=self._oscillation.turning,
            via_points=via_points,
            room_m=obstacles.room_m(path, to_goal=reaches_goal),
        )
        bands = self._alternatives.plan(path, optimiser, obstacles, state.time_s)
        band = self._first_feasible(bands, obstacles, state)
        twist = saturated(first_twist(band, rules), rules.robot)
        cost = self._checked_cost(twist)
        self._oscillation.observe(twist, state.time_s)
        if rules.robot.cmd_angle_instead_rotvel:
            twist[2] = steering(twist, rules.robot)
        return LocalCommand(twist=twist, trajectory=band.poses, cost=cost)

    def is_goal_reached(self, state: RobotState) -> bool:
        """Whether the robot stands at the goal, within tolerances."""
        if not self._window.has_plan:
            return False
        rules = self._parameters.goal
        away = se2.between(state.pose_map, self._window.goal)
        if np.hypot(away[0], away[1]) > rules.xy_goal_tolerance or abs(away[2]) > rules.yaw_goal_tolerance:
            return False
        stands = (
            np.hypot(*state.twist[:2]) <= rules.trans_stopped_vel and abs(state.twist[2]) <= rules.theta_stopped_vel
        )
        left = rules.complete_global_plan and self._via_points_left > 0
        return bool((stands or rules.free_goal_vel) and not left)

    def _checked_cost(self, twist: Array) -> float:
        """Return what the chosen band costs."""
        costs, bounds = self._alternatives.kept[0].costs, self._parameters.recovery
        total = 0.0 if costs is None else costs.time + costs.obstacles + costs.via_points + costs.other
        diverged = bounds.divergence_detection_enable and total > bounds.divergence_detection_max_chi_squared
        if diverged or not np.isfinite(twist).all():
            self._alternatives.clear()
            raise NoCommandError(f"the band diverged: it costs {total:.3g}")
        return float(total)

    def _moving_discs(self, state: RobotState, costmap: CostWindow) -> Array:
        """Return what is known to move, or else what is seen to."""
        if self._moving is None or len(self._discs):
            return self._discs
        return self._moving.observe(costmap, state.time_s)

    def _local_plan(self, plan: LocalPlan, state: RobotState, costmap: CostWindow) -> tuple[Array, Array, bool]:
        """Return the local plan from the robot on, float64 (N, 3), N >= 2, via-points on it (V, 2), and if it is all."""
        rules = self._parameters.trajectory
        path, reaches_goal = trimmed(plan, state.pose_odom, costmap, rules)
        path = self._horizon.shortened(path, reaches_goal=reaches_goal, time_s=state.time_s)
        via_points = spaced(path, rules.global_plan_viapoint_sep)
        self._via_points_left = len(via_points) if not reaches_goal else 0
        return path, via_points, reaches_goal

    def _first_feasible(self, bands: tuple[Band, ...], obstacles: ObstacleField, state: RobotState) -> Band:
        rules = self._parameters.trajectory
        for place, band in enumerate(bands):
            poses = band.poses
            if rules.feasibility_check_no_poses >= 0:
                poses = poses[: rules.feasibility_check_no_poses + 1]
            if rules.feasibility_check_lookahead_distance > 0.0:
                far = np.hypot(*(poses[:, :2] - poses[0, :2]).T) > rules.feasibility_check_lookahead_distance
                poses = poses[: int(np.argmax(far))] if far.any() else poses
            if self._is_feasible(poses, obstacles):
                self._horizon.observe(feasible=True, time_s=state.time_s)
                self._alternatives.drop_first(place)
                return band
        self._horizon.observe(feasible=False, time_s=state.time_s)
        self._alternatives.clear()
        raise NoCommandError(f"none of {len(bands)} timed elastic bands is free of collisions over its first poses")

    def _is_feasible(self, poses: Array, obstacles: ObstacleField) -> bool:
        """Whether a robot at the first of `poses` may take the others.

        One that touches an obstacle already, because this came to it or cells are coarse, may where it comes no nearer.
        """
        step_rad = min(self._parameters.trajectory.min_resolution_collision_check_angular, _CHECK_EVERY_RAD)
        if obstacles.collision(poses, step_rad) < 0:
            return True
        if obstacles.collision(poses[:1], step_rad) < 0:
            return False
        clearances = obstacles.clearance_m(poses)
        touching = clearances < obstacles.costmap.resolution_m
        return bool((clearances >= clearances[0] - _NO_NEARER_M)[touching].all())
