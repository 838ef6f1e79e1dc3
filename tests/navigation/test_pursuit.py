# SPDX-License-Identifier: MIT
from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from naive_dwa import NaiveDwa

from slamcli.errors import ConfigError
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.dwa_parameters import DwaParameters
from slamcli.navigation.footprint import padded_polygon, radii
from slamcli.navigation.local_planner import NoCommandError
from slamcli.navigation.motion_check import arc, hits, is_round
from slamcli.navigation.pursuit import RegulatedPurePursuit
from slamcli.navigation.pursuit_parameters import PursuitParameters
from slamcli.navigation.robot_state import RobotState

pytestmark = pytest.mark.kernels
SQUARE = ((0.3, 0.1), (-0.1, 0.1), (-0.1, -0.1), (0.3, -0.1))


def window(costs: np.ndarray | None = None, *, footprint: tuple[tuple[float, float], ...] = ()) -> CostWindow:
    polygon = padded_polygon(footprint, 0.15, 0.0)
    inscribed, circumscribed = radii(polygon)
    return CostWindow(
        costs=np.zeros((80, 80), dtype=np.uint8) if costs is None else costs,
        origin_m=(-2.0, -2.0),
        resolution_m=0.05,
        frame="odom",
        footprint=polygon,
        inscribed_radius_m=inscribed,
        circumscribed_radius_m=circumscribed,
    )


def walls(*boxes: tuple[int, int, int, int], cost: int = 254) -> np.ndarray:
    """Costs with boxes of rows and columns."""
    costs = np.zeros((80, 80), dtype=np.uint8)
    for r0, r1, c0, c1 in boxes:
        costs[r0:r1, c0:c1] = cost
    return costs


def state(twist: tuple[float, float, float] = (0.0, 0.0, 0.0), pose: tuple[float, ...] = (0.0, 0.0, 0.0)) -> RobotState:
    return RobotState(time_s=0.0, pose_odom=np.array(pose), T_map_odom=np.zeros(3), twist=np.array(twist))


def ray(angle: float, length: float = 1.8) -> np.ndarray:
    along = np.arange(0.0, length, 0.02)
    return np.column_stack([along * math.cos(angle), along * math.sin(angle), np.full(len(along), angle)])


def follower(plan: np.ndarray, **values: object) -> RegulatedPurePursuit:
    planner = RegulatedPurePursuit(PursuitParameters(**values))  # type: ignore[arg-type]
    planner.set_plan(plan)
    return planner


def test_drives_the_arc_to_the_point_ahead() -> None:
    # Carrot at 0.6 (cos 0.2, sin 0.2): curvature 2 y / r^2 = 2 sin 0.2 / 0.6, radius 1.51 m: not slowed down.
    command = follower(ray(0.2)).compute_command(state(), window())
    curvature = 2.0 * math.sin(0.2) / 0.6
    assert command.twist == pytest.approx([0.5, 0.0, 0.5 * curvature], rel=1e-9)
    end = command.trajectory[-1]
    assert end[2] == pytest.approx(0.5 * curvature * 1.0)  # a second ahead
    # Carrot at 0.7 rad: radius 0.6 / (2 sin 0.7) = 0.466 m < 0.9 m.
    slower = follower(ray(0.7)).compute_command(state(), window()).twist
    radius = 0.3 / math.sin(0.7)
    assert slower[0] == pytest.approx(max(0.5 * radius / 0.9, 0.25))
    assert slower[2] == pytest.approx(slower[0] / radius)


def test_curves_do_not_slow_below_the_least_speed() -> None:
    planner = follower(ray(0.7), regulated_linear_scaling_min_radius=2.0, regulated_linear_scaling_min_speed=0.3)
    assert planner.compute_command(state(), window()).twist[0] == pytest.approx(0.3)
    free = follower(ray(0.7), use_regulated_linear_velocity_scaling=False)
    assert free.compute_command(state(), window()).twist[0] == pytest.approx(0.5)


def test_slows_down_near_obstacles_and_the_goal() -> None:
    # A cost of 100 at factor 10: ln(252 / 100) / 10 = 0.0924 m beyond the inscribed radius.
    near = window(walls((0, 80, 0, 80), cost=100))
    distance = near.inscribed_radius_m + math.log(252 / 100) / 10.0
    twist = follower(ray(0.0), regulated_linear_scaling_min_speed=0.0).compute_command(state(), near).twist
    assert twist[0] == pytest.approx(0.5 * distance / 0.6)
    goal = follower(ray(0.0, 0.41)).compute_command(state(), window()).twist
    assert goal[0] == pytest.approx(0.5 * 0.4 / 0.6)
    crawl = follower(ray(0.0, 0.31), min_approach_linear_velocity=0.3).compute_command(state(), window()).twist
    assert crawl[0] == pytest.approx(0.3)


def test_turns_in_place_to_a_point_at_its_side() -> None:
    planner = follower(ray(2.0))
    assert planner.compute_command(state(), window()).twist == pytest.approx([0.0, 0.0, 3.2 * 0.05])
    assert planner.compute_command(state((0.0, 0.0, 1.7)), window()).twist == pytest.approx([0.0, 0.0, 1.8])
    assert follower(ray(-2.0)).compute_command(state(), window()).twist[2] == pytest.approx(-3.2 * 0.05)
    braking = follower(ray(0.8)).compute_command(state((0.0, 0.0, 1.8)), window()).twist
    assert 1.6 < braking[2] <= math.sqrt(2.0 * 3.2 * 0.8)


def test_the_lookahead_grows_with_speed() -> None:
    plan = ray(0.0)
    plan[:, 1] = 0.1  # a line at the side: sin of the angle is 0.1 / distance
    scaled = follower(plan, use_velocity_scaled_lookahead_dist=True)
    slow = scaled.compute_command(state((0.1, 0.0, 0.0)), window()).twist
    fast = scaled.compute_command(state((0.5, 0.0, 0.0)), window()).twist
    assert slow[2] / slow[0] == pytest.approx(2 * 0.1 / 0.3**2)  # min_lookahead_dist
    assert fast[2] / fast[0] == pytest.approx(2 * 0.1 / 0.75**2)  # 0.5 m/s for 1.5 s
    fixed = follower(plan, use_fixed_curvature_lookahead=True, curvature_lookahead_dist=1.0)
    twist = fixed.compute_command(state(), window()).twist
    assert twist[2] / twist[0] == pytest.approx(2 * 0.1)


def test_backs_up_along_a_plan_that_does() -> None:
    planner = follower(ray(math.pi), use_rotate_to_heading=False, allow_reversing=True)
    twist = planner.compute_command(state(), window()).twist
    assert twist[0] == pytest.approx(-0.5)
    assert abs(twist[2]) < 1e-9
    back = np.arange(0.4, -0.8, -0.02)
    cusp = np.vstack([ray(0.0, 0.4), np.column_stack([back, 0.0 * back, 0.0 * back])])
    ahead = follower(cusp, use_rotate_to_heading=False, allow_reversing=True).compute_command(state(), window()).twist
    assert ahead[0] > 0.0  # up to the cusp first
    with pytest.raises(ConfigError, match="exclude each other"):
        PursuitParameters(allow_reversing=True)


def test_refuses_arcs_that_hit_something() -> None:
    wall = window(walls((30, 50, 47, 49)))  # its face is 0.35 m ahead of the centre
    with pytest.raises(NoCommandError, match="would hit something within 1 s"):
        follower(ray(0.0)).compute_command(state(), wall)
    blind = follower(ray(0.0), use_collision_detection=False)
    assert blind.compute_command(state(), wall).twist[0] > 0.0
    brief = follower(ray(0.0), max_allowed_time_to_collision_up_to_carrot=0.1)
    assert brief.compute_command(state(), wall).twist[0] > 0.0


def test_takes_nearer_points_round_a_corner() -> None:
    up = np.arange(60) * 0.02
    corner = np.vstack([ray(0.0, 0.46), np.column_stack([np.full(60, 0.45), up, np.full(60, 1.57)])])
    pillar = window(walls((44, 46, 43, 45)))  # beside the plan, on the arc to the point ahead
    twist = follower(corner).compute_command(state(), pillar).twist
    assert twist[0] > 0.0
    assert abs(twist[2]) < 1e-9
    with pytest.raises(NoCommandError):
        follower(corner, shorten_lookahead=False).compute_command(state(), pillar)


def test_stops_and_turns_at_the_goal() -> None:
    plan = ray(0.0, 0.2)
    plan[-1, 2] = 2.0
    planner = follower(plan)
    assert planner.compute_command(state((0.5, 0.0, 0.0)), window()).twist[0] == pytest.approx(0.375)
    assert planner.compute_command(state(), window()).twist[2] == pytest.approx(0.16)
    assert not planner.is_goal_reached(state())
    assert planner.is_goal_reached(state(pose=(0.1, 0.0, 1.9)))
    planner.reset()
    assert not planner.is_goal_reached(state(pose=(0.1, 0.0, 1.9)))
    with pytest.raises(NoCommandError, match="no global plan"):
        planner.compute_command(state(), window())


def test_wrong_parameters_are_refused() -> None:
    with pytest.raises(ConfigError, match="not a finite number"):
        PursuitParameters(lookahead_dist=math.nan)
    with pytest.raises(ConfigError, match=r"min_lookahead_dist=2 is above max_lookahead_dist=0\.9"):
        PursuitParameters(min_lookahead_dist=2.0)
    assert dataclasses.replace(PursuitParameters(), desired_linear_vel=0.3).max_vel_x == 0.3


def test_arcs_are_exact() -> None:
    quarter = arc(np.array([1.0, 2.0, 0.0]), np.array([1.0, 0.0, math.pi / 2]), 1.0, 0.05)
    radius = 2.0 / math.pi
    assert quarter[-1] == pytest.approx([1.0 + radius, 2.0 + radius, math.pi / 2])
    assert np.hypot(*np.diff(quarter[:, :2], axis=0).T).max() <= 0.05
    sideways = arc(np.zeros(3), np.array([0.0, 0.4, 0.0]), 1.0, 0.1)
    assert sideways[-1] == pytest.approx([0.0, 0.4, 0.0])


def test_outlines_equal_the_naive_twin() -> None:
    random = np.random.default_rng(2)
    costs = np.where(random.random((80, 80)) < 0.01, 254, 0).astype(np.uint8)
    costmap = window(costs, footprint=SQUARE)
    assert not is_round(costmap)
    naive = NaiveDwa(DwaParameters(), costmap, ray(0.0), np.zeros(3), "noetic")
    blocked = 0
    for _ in range(300):
        pose = np.array([*random.uniform(-1.7, 1.7, 2), random.uniform(-3, 3)])
        expected = naive.footprint_cost(*pose) < 0
        assert hits(costmap, pose[None]) == expected
        blocked += expected
    assert 60 < blocked < 240


def test_a_robot_in_an_obstacle_may_leave_and_not_enter() -> None:
    costmap = window(walls((30, 50, 42, 43)))
    back, ahead = (arc(np.zeros(3), np.array([v, 0.0, 0.0]), 1.0, 0.05) for v in (-0.3, 0.3))
    assert hits(costmap, back)
    assert not hits(costmap, back, escape=True)
    assert hits(costmap, ahead, escape=True)
    assert hits(costmap, np.array([[1.95, 0.0, 0.0]]))  # off the costmap


CAR = PursuitParameters(
    min_turning_radius=0.5,
    allow_reversing=True,
    use_rotate_to_heading=False,
    lookahead_dist=0.4,
    yaw_goal_tolerance=0.1,
)


def car_drives(plan: np.ndarray, start: tuple[float, float, float], seconds: float = 30.0) -> tuple[np.ndarray, bool]:
    """Return the twists that lead a car without inertia along a plan, and whether it arrived."""
    planner = RegulatedPurePursuit(CAR)
    planner.set_plan(plan)
    pose, twists, now = np.array(start), [], np.zeros(3)
    for _ in range(round(seconds / 0.05)):
        here = state(tuple(now), tuple(pose))
        if planner.is_goal_reached(here):
            return np.array(twists), True
        now = planner.compute_command(here, window()).twist
        twists.append(now)
        pose = arc(pose, now, 0.05, 0.05)[-1]
    return np.array(twists), False


def test_a_car_follows_forward_and_reverse_pieces_within_its_curvature() -> None:
    turn = np.linspace(0.0, 1.2, 30)
    ahead = np.column_stack([0.6 * np.sin(turn), 0.6 * (1.0 - np.cos(turn)), turn])
    back = arc(ahead[-1], np.array([-0.6, 0.0, 0.8]), 1.5, 0.03)
    twists, arrived = car_drives(np.vstack([ahead, back[1:]]), (0.0, 0.0, 0.0))
    assert arrived
    moving = twists[np.abs(twists[:, 0]) > 0.0]
    assert np.abs(moving[:, 2] / moving[:, 0]).max() <= 2.0 + 1e-9
    signs = np.sign(moving[:, 0])
    assert (signs[0], signs[-1]) == (1.0, -1.0)
    assert (np.diff(signs) != 0.0).sum() == 1


def test_a_car_at_the_goal_in_another_heading_wants_a_new_plan() -> None:
    line = np.column_stack([np.linspace(0.0, 1.0, 21), np.zeros(21), np.zeros(21)])
    line[-1, 2] = 1.5
    planner = RegulatedPurePursuit(CAR)
    planner.set_plan(line)
    assert planner.compute_command(state(pose=(0.5, 0.0, 0.0)), window()).twist[0] > 0.0
    with pytest.raises(NoCommandError, match="a car needs a new one"):
        planner.compute_command(state(pose=(0.99, 0.0, 0.0)), window())
