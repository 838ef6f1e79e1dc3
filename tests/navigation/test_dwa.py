# SPDX-License-Identifier: MIT
from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from naive_dwa import NaiveDwa

from slamcli.grids import OccupancyGrid
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.costmap import compute_costmap
from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.dwa import DwaPlanner
from slamcli.navigation.dwa_parameters import AS_DWAPLANNERROS, DwaParameters
from slamcli.navigation.dwa_scoring import CRITICS, DwaScoring
from slamcli.navigation.footprint import padded_polygon, radii
from slamcli.navigation.local_planner import NoCommandError
from slamcli.navigation.robot_state import RobotState
from slamcli.navigation.velocity_samples import sample_velocities, speeds

pytestmark = pytest.mark.kernels

ORIGINAL = DwaParameters(
    **AS_DWAPLANNERROS, max_vel_y=0.0, min_vel_y=0.0, vx_samples=5, vy_samples=1, vth_samples=7, min_vel_x=-0.1
)
SQUARE = ((0.12, 0.1), (-0.12, 0.1), (-0.12, -0.1), (0.12, -0.1))


def window(occupied: np.ndarray, *, radius: float = 0.1, footprint: tuple[tuple[float, float], ...] = ()) -> CostWindow:
    """A local costmap around the origin, cells of 5 cm."""
    costmap = compute_costmap(
        OccupancyGrid(occupied.astype(np.int8), 0.05),
        CostmapParameters(robot_radius=radius, footprint=str([list(c) for c in footprint]), inflation_radius=0.4),
    )
    polygon = padded_polygon(footprint, radius, 0.01)
    inscribed, circumscribed = radii(polygon)
    height, width = occupied.shape
    return CostWindow(
        costs=np.ascontiguousarray(costmap.costs),
        origin_m=(-0.025 * width, -0.025 * height),
        resolution_m=0.05,
        frame="odom",
        footprint=polygon,
        inscribed_radius_m=inscribed,
        circumscribed_radius_m=circumscribed,
    )


def free(cells: int = 60) -> CostWindow:
    return window(np.zeros((cells, cells)))


def line(x: float, y: float, count: int = 40) -> np.ndarray:
    points = np.linspace([0.0, 0.0], [x, y], count)
    return np.column_stack([points, np.full(count, math.atan2(y, x))])


def literal(plan: np.ndarray) -> DwaPlanner:
    """DWAPlannerROS with a plan."""
    planner = DwaPlanner(ORIGINAL)
    planner.set_plan(plan)
    return planner


def standing(
    twist: tuple[float, float, float] = (0.0, 0.0, 0.0), pose: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> RobotState:
    return RobotState(time_s=0.0, pose_odom=np.array(pose), T_map_odom=np.zeros(3), twist=np.array(twist))


@pytest.mark.parametrize(
    ("seed", "scaling"), [(0, "noetic"), (1, "kinetic"), (2, "noetic"), (3, "kinetic"), (4, "noetic"), (5, "noetic")]
)
def test_equals_the_naive_twin(seed: int, scaling: str) -> None:
    random = np.random.default_rng(seed)
    occupied = np.where(random.random((60, 60)) < 0.004, 100, 0)
    occupied[27:34, 27:34] = 0
    occupied[random.integers(60), :5] = -1
    costmap = window(occupied, footprint=SQUARE if seed % 2 else ())
    parameters = dataclasses.replace(
        ORIGINAL,
        use_dwa=seed != 3,
        sum_scores=seed == 4,
        twirling_scale=0.3 * (seed == 2),
        path_distance_bias=32.0,
        goal_distance_bias=24.0,
        occdist_scale=0.1,
        acc_lim_theta=6.0,
    )
    pose = np.array([*random.uniform(-0.05, 0.05, 2), random.uniform(-3, 3)])
    twist = np.array([0.3, 0.0, random.uniform(-0.5, 0.5)])
    plan = line(*random.uniform(0.8, 2.5, 2))
    samples = sample_velocities(parameters, twist, 1.0, 0.05)
    naive = NaiveDwa(parameters, costmap, plan, pose, scaling)
    scoring = DwaScoring(parameters, scaling)
    scoring.prepare(pose, plan, costmap)
    every = scoring.score(pose, twist, samples, every=True)
    for s, sample in enumerate(samples):
        costs, total = naive.total(sample, twist, -1.0)
        if total < 0:
            assert every.totals[s] == total
        else:
            np.testing.assert_allclose(every.costs[s], costs, rtol=1e-12)
            assert every.totals[s] == pytest.approx(total, rel=1e-12)
    assert every.chosen == naive.choose(samples, twist)
    pruned = scoring.score(pose, twist, samples)
    assert pruned.chosen == every.chosen
    assert (every.totals >= 0).any() or every.chosen == -1
    if every.chosen >= 0:
        np.testing.assert_array_equal(pruned.costs[pruned.chosen], every.costs[every.chosen])


def test_speeds_have_zero_between_and_both_ends() -> None:
    assert speeds(-0.1, 0.5, 4) == pytest.approx([-0.1, 0.0, 0.1, 0.3, 0.5])
    assert speeds(0.0, 0.5, 3) == [0.0, 0.25, 0.5]
    assert speeds(-0.2, 0.3, 1) == [-0.2, 0.0, 0.3]
    assert speeds(0.2, 0.2, 7) == [0.2]


def test_the_window_is_what_acceleration_reaches_in_a_period() -> None:
    samples = sample_velocities(ORIGINAL, np.array([0.2, 0.0, 0.5]), 1.0, 0.1)
    assert samples.min(axis=0) == pytest.approx([-0.05, 0.0, 0.18])
    assert samples.max(axis=0) == pytest.approx([0.45, 0.0, 0.82])
    assert len(samples) == 6 * 7
    rollout = dataclasses.replace(ORIGINAL, use_dwa=False, sim_time=2.0)
    samples = sample_velocities(rollout, np.array([0.2, 0.0, 0.5]), 0.8, 0.1)
    assert samples[:, 0].max() == pytest.approx(0.4)  # no faster than gets to the goal in sim_time
    assert samples[:, 2].min() == -1.0


def test_measured_speeds_beyond_the_limits_leave_samples_within() -> None:
    samples = sample_velocities(ORIGINAL, np.array([0.9, 0.01, -3.0]), 1.0, 0.05)
    assert samples[:, 0].max() == 0.55
    assert not samples[:, 1].any()
    assert samples[:, 2].min() == -1.0


def test_turns_in_place_that_acceleration_does_not_reach_at_once() -> None:
    able = dataclasses.replace(ORIGINAL, turn_in_place=True)
    plain = sample_velocities(ORIGINAL, np.zeros(3), 1.0, 0.05)
    more = sample_velocities(able, np.zeros(3), 1.0, 0.05)
    np.testing.assert_array_equal(more[: len(plain)], plain)
    np.testing.assert_array_equal(more[len(plain) :], [[0.0, 0.0, 0.4], [0.0, 0.0, -0.4]])


def scored(
    parameters: DwaParameters, costmap: CostWindow, plan: np.ndarray, sample: tuple[float, float, float]
) -> dict[str, float]:
    """Costs of one motion from the origin, by critic."""
    scoring = DwaScoring(parameters, "noetic")
    scoring.prepare(np.zeros(3), plan, costmap)
    motions = scoring.score(np.zeros(3), np.zeros(3), np.array([sample]), every=True)
    return dict(zip(CRITICS, motions.costs[0].tolist(), strict=True)) | {"total": float(motions.totals[0])}


def test_each_critic_by_hand() -> None:
    """A straight motion of 0.5 m/s for 1 s along the plan: 20 points, the last at 0.475 m, which is cell 39."""
    parameters = dataclasses.replace(
        ORIGINAL, sim_time=1.0, forward_point_distance=0.3, path_distance_bias=20.0, goal_distance_bias=40.0,
        twirling_scale=7.0,
    )  # fmt: skip
    plan = line(1.2, 0.0)  # ends in cell 54; the front goal, 0.3 m ahead, would be off the costmap: cell 59
    costs = scored(parameters, free(), plan, (0.5, 0.0, 0.0))
    assert costs["obstacle"] == 0.0
    assert costs["path"] == 0.0
    assert costs["goal"] == pytest.approx((54 - 39) * 0.05 * 40.0)
    assert costs["alignment"] == 0.0
    assert costs["goal_front"] == pytest.approx((59 - 45) * 0.05 * 40.0)
    assert costs["twirling"] == 0.0
    assert costs["total"] == pytest.approx(sum(costs[c] for c in CRITICS))
    # Turning in place by 0.9 * 1 rad: the robot stays on the plan, its nose, at 0.3 (cos, sin), leaves it by 4 cells.
    turned = scored(parameters, free(), plan, (0.0, 0.0, 0.9))
    yaw = 0.9 * 8 / 9
    assert turned["path"] == 0.0
    assert turned["alignment"] == pytest.approx(math.floor(0.3 * math.sin(yaw) / 0.05) * 0.05 * 20.0)
    assert turned["twirling"] == pytest.approx(0.9 * 7.0)


def test_footprints_are_laid_on_the_costmap() -> None:
    occupied = np.zeros((60, 60))
    occupied[:, 48] = 100  # a wall whose face is 0.9 m ahead
    near = dataclasses.replace(ORIGINAL, sim_time=1.6, occdist_scale=1.0, max_vel_x=0.7, max_vel_trans=0.7)
    assert scored(near, window(occupied), line(0.7, 0.0), (0.3, 0.0, 0.0))["obstacle"] < 30.0
    grazing = scored(near, window(occupied), line(0.7, 0.0), (0.5, 0.0, 0.0))
    assert grazing["total"] > 0
    assert grazing["obstacle"] > 200.0
    assert scored(near, window(occupied), line(0.7, 0.0), (0.6, 0.0, 0.0))["total"] == -6.0
    grown = dataclasses.replace(near, scale_footprint=True, max_scaling_factor=1.0)
    assert scored(grown, window(occupied), line(0.7, 0.0), (0.5, 0.0, 0.0))["total"] == -6.0


def test_the_alignment_critic_rests_near_the_goal() -> None:
    turn = (0.0, 0.0, 0.9)
    assert scored(ORIGINAL, free(), line(0.3, 0.0), turn)["alignment"] == 0.0
    assert scored(ORIGINAL, free(), line(0.4, 0.0), turn)["alignment"] > 0.0
    cheating = dataclasses.replace(ORIGINAL, cheat_factor=2.0)
    assert scored(cheating, free(), line(0.4, 0.0), turn)["alignment"] == 0.0


def test_follows_a_plan_and_explains_itself() -> None:
    planner = DwaPlanner(DwaParameters(min_vel_x=-0.1, vx_samples=8))
    planner.set_plan(line(1.0, 0.5))
    command = planner.compute_command(standing((0.3, 0.0, 0.0)), free())
    assert command.twist[0] > 0.3
    assert command.twist[2] > 0.0
    assert command.trajectory.shape[1] == 3
    every = planner.evaluate(standing((0.3, 0.0, 0.0)), free())
    assert every.totals[every.chosen] == pytest.approx(command.cost)
    assert every.totals[every.chosen] == every.totals[every.totals >= 0].min()
    np.testing.assert_array_equal(every.commands[every.chosen], command.twist)


def test_an_omnidirectional_robot_moves_sideways() -> None:
    planner = DwaPlanner(
        dataclasses.replace(
            DwaParameters(**AS_DWAPLANNERROS), max_vel_y=0.3, min_vel_y=-0.3, vy_samples=7, vx_samples=5
        )
    )
    planner.set_plan(line(0.02, 1.0))
    twist = np.zeros(3)
    for _ in range(6):
        twist = planner.compute_command(standing(tuple(twist)), free()).twist
    assert twist[1] > 0.2


def test_turns_to_a_plan_that_leads_back() -> None:
    planner = DwaPlanner(DwaParameters(max_vel_y=0.0, min_vel_y=0.0))
    planner.set_plan(line(-1.0, -0.2))
    command = planner.compute_command(standing(), free())
    assert command.twist[:2].tolist() == [0.0, 0.0]
    assert command.twist[2] <= -0.4
    assert literal(line(-1.0, -0.2)).compute_command(standing(), free()).twist[0] == -0.1


def test_stops_and_turns_at_the_goal() -> None:
    planner = DwaPlanner(DwaParameters(xy_goal_tolerance=0.15, latch_xy_goal_tolerance=True))
    plan = line(0.1, 0.0, 3)
    plan[-1, 2] = 1.0
    planner.set_plan(plan)
    braking = planner.compute_command(standing((0.4, 0.0, 0.0)), free())
    assert braking.twist == pytest.approx([0.4 - 2.5 * 0.05, 0.0, 0.0])
    turning = planner.compute_command(standing(), free())
    assert turning.twist.tolist() == [0.0, 0.0, 0.4]
    assert not planner.is_goal_reached(standing())
    away = standing(pose=(-0.3, 0.0, 0.95))
    assert planner.is_goal_reached(away)  # latched
    assert planner.compute_command(away, free()).twist.tolist() == [0.0, 0.0, 0.0]
    planner.set_plan(plan)
    assert planner.is_goal_reached(away)  # the same goal
    planner.set_plan(line(0.1, 0.01, 3))
    assert not planner.is_goal_reached(standing(pose=(-0.3, 0.0, 0.0)))


def test_a_robot_that_cannot_move_says_why() -> None:
    occupied = np.full((60, 60), 100)
    occupied[27:33, 27:33] = 0
    planner = literal(line(1.0, 0.0))
    with pytest.raises(NoCommandError, match=r"none of 35 motions will do: 35 hit an obstacle"):
        planner.compute_command(standing((0.3, 0.0, 0.0)), window(occupied))
    nowhere = window(np.full((60, 60), -1))
    with pytest.raises(NoCommandError, match="known cell"):
        planner.compute_command(standing(), nowhere)


def test_escapes_from_an_obstacle_and_does_not_go_nearer() -> None:
    occupied = np.zeros((60, 60))
    occupied[20:40, 31] = 100  # touches the outline ahead
    planner = DwaPlanner(dataclasses.replace(DwaParameters(), min_vel_x=-0.2, max_vel_y=0.0, min_vel_y=0.0))
    planner.set_plan(line(-1.0, 0.0))
    with pytest.raises(NoCommandError):
        literal(line(-1.0, 0.0)).compute_command(standing(), window(occupied))
    backing = dataclasses.replace(planner.parameters, turn_to_plan=0.0, turn_in_place=False)
    leaving = DwaPlanner(backing)
    leaving.set_plan(line(-1.0, 0.0))
    assert leaving.compute_command(standing((-0.1, 0.0, 0.0)), window(occupied)).twist[0] < 0.0
    assert planner.compute_command(standing(), window(occupied)).twist[0] == 0.0  # a round robot turns


def test_drives_up_to_a_block_of_the_plan_and_no_farther() -> None:
    """A wall across all of the costmap, which the map does not have: its face is 0.9 m ahead, or 0.5 m."""
    for column, way in ((48, True), (40, False)):
        occupied = np.zeros((60, 60))
        occupied[:, column] = 100
        planner = DwaPlanner(DwaParameters(max_vel_y=0.0, min_vel_y=0.0, vx_samples=5))
        planner.set_plan(line(1.4, 0.0))
        if way:
            assert planner.compute_command(standing((0.2, 0.0, 0.0)), window(occupied)).twist[0] > 0.2
        else:
            with pytest.raises(NoCommandError, match=r"the plan is blocked 0\.\d\d m ahead"):
                planner.compute_command(standing((0.2, 0.0, 0.0)), window(occupied))
        with pytest.raises(NoCommandError, match="have no way to the goal"):
            literal(line(1.4, 0.0)).compute_command(standing((0.2, 0.0, 0.0)), window(occupied))


def test_the_margin_keeps_off() -> None:
    occupied = np.zeros((60, 60))
    occupied[34, 20:50] = 100  # a wall beside the plan whose face is 0.2 m away; the outline reaches 0.11 m
    sample = (0.3, 0.0, 0.0)
    assert scored(ORIGINAL, window(occupied), line(1.0, 0.0), sample)["total"] > 0
    careful = dataclasses.replace(ORIGINAL, footprint_margin=0.1)
    assert scored(careful, window(occupied), line(1.0, 0.0), sample)["total"] == -6.0


def test_backs_up_last() -> None:
    """In front of a wall, facing it, a rectangle too long to turn between walls: nothing is left but going back."""
    occupied = np.zeros((60, 60))
    occupied[20:40, 38] = 100
    occupied[[25, 34], :] = 100
    long = ((0.3, 0.12), (-0.3, 0.12), (-0.3, -0.12), (0.3, -0.12))
    planner = DwaPlanner(DwaParameters(min_vel_x=-0.2, max_vel_y=0.0, min_vel_y=0.0, turn_to_plan=0.6))
    planner.set_plan(line(-1.2, 0.0))
    twist = planner.compute_command(standing((-0.05, 0.0, 0.0)), window(occupied, footprint=long)).twist
    assert twist[0] <= -0.1


def test_a_goal_that_is_cut_off_is_approached_within_its_tolerance() -> None:
    occupied = np.zeros((60, 60))
    occupied[:, 43] = 100  # the face is 0.65 m ahead: the last cell that the centre may be on is 0.5 m ahead
    parameters = DwaParameters(max_vel_y=0.0, min_vel_y=0.0, xy_goal_tolerance=0.6)
    near = DwaPlanner(parameters)
    near.set_plan(line(1.0, 0.0))
    pose = (0.15, 0.0, 0.0)
    assert near.compute_command(standing((0.1, 0.0, 0.0), pose), window(occupied)).twist[0] >= 0.1
    exact = DwaPlanner(dataclasses.replace(parameters, xy_goal_tolerance=0.1))
    exact.set_plan(line(1.0, 0.0))
    with pytest.raises(NoCommandError, match="the plan is blocked"):
        exact.compute_command(standing((0.1, 0.0, 0.0), pose), window(occupied))
