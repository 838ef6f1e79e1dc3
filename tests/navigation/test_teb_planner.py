# SPDX-License-Identifier: MIT
"""The timed elastic band as a local planner, in a small closed loop."""

from __future__ import annotations

import numpy as np
import pytest
from elastic_loop import Loop, free_poses, room_world, still, window_of

from slamcli.errors import ConfigError
from slamcli.navigation.footprint import padded_polygon
from slamcli.navigation.local_planner import NoCommandError
from slamcli.navigation.teb import TebParameters, TebPlanner
from slamcli.navigation.teb.band import Band
from slamcli.navigation.teb.command import first_twist, saturated, steering
from slamcli.navigation.teb.oscillation import HorizonBackup, OscillationRecovery
from slamcli.parameters import as_dict, resolve

P = TebParameters()
ROUND = padded_polygon((), 0.18, 0.0)


def test_goals_are_reached_without_collision():
    loop = Loop(room_world())
    poses = free_poses(loop, 8, seed=1)
    planner = TebPlanner(P, seed=0)
    for start, goal in zip(poses[::2], poses[1::2], strict=True):
        outcome = loop.drive(planner, start, goal)
        assert outcome.reached
        assert not outcome.collided
        assert outcome.length_m < 1.15 * outcome.plan_m + 0.5


def corridor(door_m):
    """A room of 6 m by 4 m with a wall across at x = 3 m and a door in its middle."""
    occupied = np.zeros((80, 120), bool)
    occupied[:2], occupied[-2:], occupied[:, :2], occupied[:, -2:] = True, True, True, True
    occupied[:, 59:61] = True
    half = round(door_m / 0.1)
    occupied[40 - half : 40 + half, 59:61] = False
    return occupied


@pytest.mark.parametrize("door_m", [0.6, 0.9])
def test_a_narrow_door(door_m):
    outcome = Loop(corridor(door_m)).drive(TebPlanner(P), (1.0, 1.2, 0.0), (5.0, 2.8, 0.0))
    assert outcome.reached
    assert not outcome.collided
    assert outcome.time_s < 35.0


def test_the_same_run_gives_the_same_bytes():
    runs = [Loop(corridor(0.9)).drive(TebPlanner(P, seed=3), (1.0, 1.2, 0.0), (5.0, 2.8, 0.0)) for _ in range(2)]
    assert np.array(runs[0].track).tobytes() == np.array(runs[1].track).tobytes()


def hall():
    occupied = np.zeros((80, 160), bool)
    occupied[:2], occupied[-2:], occupied[:, :2], occupied[:, -2:] = True, True, True, True
    return occupied


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_person_who_comes_along_is_passed(side):
    def people(time_s, _):
        return np.array([[7.0 - 0.5 * time_s, 2.0 + 0.1 * side, 0.25, -0.5, 0.0]])

    outcome = Loop(hall()).drive(
        TebPlanner(P), (1.0, 2.0, 0.0), (7.0, 2.0, 0.0), people=people, share_discs=True, limit_s=60.0
    )
    assert outcome.reached
    assert not outcome.hit_person
    assert not outcome.collided
    track = np.array(outcome.track)
    met = np.abs(track[:, 0] - (7.0 - 0.5 * 0.05 * np.arange(1, len(track) + 1))).argmin()
    assert np.sign(track[met, 1] - 2.0) == -side


def test_a_car_keeps_its_turning_radius():
    rules = {"min_turning_radius": 0.5, "max_vel_theta": 1.0, "footprint_model.type": "auto"}
    loop = Loop(hall())
    outcome = loop.drive(TebPlanner(resolve(TebParameters, rules)), (1.0, 2.0, 0.0), (5.0, 3.0, 1.0), limit_s=60.0)
    assert outcome.reached
    twists = np.array(outcome.twists)
    moving = np.abs(twists[:, 0]) > 1e-6
    assert (np.abs(twists[moving, 0]) >= 0.5 * np.abs(twists[moving, 2]) - 1e-9).all()


def test_a_goal_behind_is_reached_backwards_if_that_is_allowed():
    rules = {"allow_init_with_backwards_motion": True, "weight_kinematics_forward_drive": 0.0}
    outcome = Loop(hall()).drive(
        TebPlanner(resolve(TebParameters, rules)), (4.0, 2.0, 0.0), (3.0, 2.0, 0.0), limit_s=40.0
    )
    assert outcome.reached
    assert np.mean([twist[0] for twist in outcome.twists]) < -0.1


def test_a_holonomic_robot_goes_sideways():
    rules = {"max_vel_y": 0.3, "weight_kinematics_nh": 0.0}
    outcome = Loop(hall()).drive(
        TebPlanner(resolve(TebParameters, rules)), (4.0, 1.5, 0.0), (4.0, 2.7, 0.0), limit_s=40.0
    )
    assert outcome.reached
    twists = np.array(outcome.twists)
    assert twists[:, 1].max() > 0.2
    assert np.abs(twists[:, 1]).max() <= 0.3 + 1e-12


def straight_plan(length=3.0):
    return np.column_stack([np.linspace(0.0, length, 61), np.zeros((61, 2))])


def empty_window(blocked=False):
    costs = np.zeros((80, 80), np.uint8)
    if blocked:
        costs[:, 44:46] = 254
    return window_of(costs, 0.05, ROUND, (-2.0, -2.0))


def test_a_wall_across_the_way_gives_no_command():
    planner = TebPlanner(P)
    planner.set_plan(straight_plan())
    with pytest.raises(NoCommandError, match="free of collisions"):
        planner.compute_command(still((0.01, 0.0, 0.0)), empty_window(blocked=True))


def test_without_a_plan_there_is_no_command():
    with pytest.raises(NoCommandError, match="no global plan"):
        TebPlanner(P).compute_command(still((0.0, 0.0, 0.0)), empty_window())


def test_when_a_goal_is_reached():
    planner = TebPlanner(P)
    assert not planner.is_goal_reached(still((0.0, 0.0, 0.0)))
    planner.set_plan(straight_plan())
    assert planner.is_goal_reached(still((2.9, 0.1, 0.15)))
    assert not planner.is_goal_reached(still((2.7, 0.1, 0.15)))
    assert not planner.is_goal_reached(still((2.9, 0.1, 0.25)))
    assert not planner.is_goal_reached(still((2.9, 0.1, 0.0), (0.3, 0.0, 0.0)))
    free = TebPlanner(resolve(TebParameters, {"free_goal_vel": True}))
    free.set_plan(straight_plan())
    assert free.is_goal_reached(still((2.9, 0.1, 0.0), (0.3, 0.0, 0.0)))
    planner.reset()
    assert not planner.is_goal_reached(still((3.0, 0.0, 0.0)))


def test_first_velocities_by_hand():
    band = Band(
        poses=np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.3, 0.0, 0.2], [0.5, 0.0, 0.2]]),
        dts=np.array([0.2, 0.4, 0.5]),
    )
    assert first_twist(band, P).tolist() == pytest.approx([0.5, 0.0, 0.0])
    two = resolve(TebParameters, {"control_look_ahead_poses": 2, "dt_ref": 0.5})
    assert first_twist(band, two).tolist() == pytest.approx([0.5, 0.0, 1.0 / 3.0])
    back = Band(poses=band.poses * [-1.0, 1.0, 1.0], dts=band.dts)
    assert first_twist(back, P)[0] == pytest.approx(-0.5)


def test_saturation_by_hand():
    assert saturated(np.array([0.8, 0.3, 0.6]), P.robot).tolist() == pytest.approx([0.4, 0.3, 0.3])
    assert saturated(np.array([-0.8, 0.0, -0.1]), P.robot).tolist() == pytest.approx([-0.2, 0.0, -0.1])
    even = resolve(TebParameters, {"use_proportional_saturation": True}).robot
    assert saturated(np.array([0.8, 0.0, 0.3]), even).tolist() == pytest.approx([0.4, 0.0, 0.15])
    car = resolve(TebParameters, {"min_turning_radius": 1.0, "wheelbase": 0.5}).robot
    assert saturated(np.array([0.2, 0.0, 0.3]), car).tolist() == pytest.approx([0.2, 0.0, 0.2])
    assert steering(np.array([0.2, 0.0, 0.1]), car) == pytest.approx(np.arctan(0.25))
    assert steering(np.array([0.2, 0.0, 0.0]), car) == 0.0


def test_oscillation_is_noticed_and_forgotten():
    watch = OscillationRecovery(P, 0.1)
    for k in range(60):
        watch.observe(np.array([0.0, 0.0, 0.2 * (-1) ** (k // 5)]), 0.1 * k)
    assert watch.turning == -1
    for k in range(60, 300):
        watch.observe(np.array([0.3, 0.0, 0.0]), 0.1 * k)
    assert watch.turning == 0


def test_the_horizon_is_halved_after_failures():
    horizon, path = HorizonBackup(P), straight_plan()
    assert len(horizon.shortened(path, reaches_goal=False, time_s=0.0)) == 61
    horizon.observe(feasible=False, time_s=1.0)
    assert len(horizon.shortened(path, reaches_goal=False, time_s=1.1)) == 31
    assert len(horizon.shortened(path, reaches_goal=True, time_s=1.1)) == 61
    horizon.observe(feasible=True, time_s=1.2)
    assert len(horizon.shortened(path, reaches_goal=False, time_s=10.0)) == 31
    assert len(horizon.shortened(path, reaches_goal=False, time_s=11.5)) == 61


def test_parameters_carry_the_original_names():
    from slamcli.native.ros_parameters.planners import TEB

    assert set(as_dict(P)) >= {declaration.name.replace("/", ".") for declaration in TEB}
    with pytest.raises(ConfigError, match="max_vel_x"):
        resolve(TebParameters, {"max_vel_x": "nan"})
    with pytest.raises(ConfigError, match="did you mean min_obstacle_dist"):
        resolve(TebParameters, {"min_obstacle_distance": 0.2})


def test_lists_of_points_are_checked_at_once():
    with pytest.raises(ConfigError, match="no points"):
        resolve(TebParameters, {"footprint_model.type": "polygon"})
    with pytest.raises(ConfigError, match="not a list of points"):
        resolve(TebParameters, {"footprint_model.type": "line", "footprint_model.line_end": "0.3; 0"})


def test_a_band_that_costs_too_much_gives_no_command():
    values = {"divergence_detection_enable": True, "divergence_detection_max_chi_squared": 1e-3}
    planner = TebPlanner(resolve(TebParameters, values))
    planner.set_plan(straight_plan())
    with pytest.raises(NoCommandError, match="diverged"):
        planner.compute_command(still((0.0, 0.0, 0.0)), empty_window())


def test_via_points_are_kept_and_passed():
    loop = Loop(hall())
    values = {"global_plan_viapoint_sep": 0.5, "via_points_ordered": True, "weight_viapoint": 10.0}
    outcome = loop.drive(TebPlanner(resolve(TebParameters, values)), (1.0, 2.0, 0.0), (4.0, 2.0, 0.0), limit_s=60.0)
    assert outcome.reached
    assert np.abs(np.array(outcome.track)[:, 1] - 2.0).max() < 0.05
