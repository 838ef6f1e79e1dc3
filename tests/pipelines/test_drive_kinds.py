# SPDX-License-Identifier: MIT
from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.errors import UsageError
from slamcli.formats.maps import write_map
from slamcli.grids import OccupancyGrid
from slamcli.navigation.endpoints import NoPathError
from slamcli.navigation.layered_costmap import LayeredCostmap
from slamcli.navigation.live_planner import LivePlanner
from slamcli.pipelines.costmap_planner import CostmapPlanner
from slamcli.pipelines.drive_kinds import CAR_RECOVERIES, fit_to_drive
from slamcli.pipelines.navigate import Navigator
from slamcli.pipelines.navigation_config import NavigationConfig, load_navigation
from slamcli.runtime import RunLog
from slamcli.simulation import resolve_settings

TIGHTEST = 0.4 / math.tan(math.radians(35.0))


def fitted(*sets: str, local: str = "teb", planner: str = "hybrid_astar") -> tuple[NavigationConfig, list[str]]:
    log = RunLog()
    config = load_navigation(sets=["robot.drive=car", *sets], local_planner=local, global_planner=planner)
    return fit_to_drive(config, resolve_settings(config.simulation), log), log.notes


def test_turning_radius_comes_from_the_robot_unless_a_planner_says_so():
    config, notes = fitted()
    assert config.planner.hybrid.minimum_turning_radius == pytest.approx(1.1 * TIGHTEST)
    assert config.local_parameters.robot.min_turning_radius == pytest.approx(1.1 * TIGHTEST)
    assert config.local_parameters.robot.wheelbase == 0.4
    assert not config.local_parameters.trajectory.global_plan_overwrite_orientation
    assert "turning radius 0.628 m: 1.1 times what robot.wheelbase and robot.max_steering allow" in notes
    config, notes = fitted("TebLocalPlannerROS/min_turning_radius=0.9")
    assert config.planner.hybrid.minimum_turning_radius == 0.9
    assert any("TebLocalPlannerROS/min_turning_radius" in note for note in notes)
    config, notes = fitted("TebLocalPlannerROS/min_turning_radius=0.9", "NavfnROS/minimum_turning_radius=0.5")
    assert config.planner.hybrid.minimum_turning_radius == 0.5
    assert config.local_parameters.robot.min_turning_radius == 0.9
    assert any("cannot turn within less than 0.571 m" in note for note in notes)


def test_pursuit_of_a_car_drives_in_reverse_and_never_turns_in_place():
    config, _ = fitted(local="pursuit")
    rules = config.local_parameters
    assert rules.allow_reversing
    assert not rules.use_rotate_to_heading
    assert rules.min_turning_radius == pytest.approx(TIGHTEST)
    config, _ = fitted("FollowPath/lookahead_dist=0.7", local="pursuit")
    assert config.local_parameters.lookahead_dist == 0.7


def test_recoveries_of_a_car_do_not_turn_in_place():
    config, notes = fitted()
    assert config.move_base.recovery_behaviors == CAR_RECOVERIES
    assert f"recovery_behaviors of a car: {CAR_RECOVERIES}" in notes
    config, notes = fitted("recovery_behaviors=rotate_recovery back_up")
    assert config.move_base.recovery_behaviors == "rotate_recovery back_up"
    assert not config.move_base.clearing_rotation_allowed
    assert "a car cannot turn in place: rotate_recovery is left out" in notes


def test_what_cannot_drive_a_car_is_refused_or_noted():
    with pytest.raises(UsageError, match="DWA turns in place, which a car cannot: --local-planner teb, or pursuit"):
        fitted(local="dwa")
    _, notes = fitted(planner="navfn")
    assert any("may not be able to follow plans of navfn" in note for note in notes)


def test_omnidirectional_robots_that_are_not_let_drive_sideways_are_told():
    log = RunLog()
    robot = resolve_settings({"robot.drive": "omni"})
    fit_to_drive(load_navigation(), robot, log)
    assert log.notes == ["robot.drive=omni, but DWAPlannerROS never drives sideways: its max_vel_y is 0 or it has none"]
    log = RunLog()
    fit_to_drive(load_navigation(sets=["DWAPlannerROS/max_vel_y=0.3"]), robot, log)
    assert log.notes == []


def corridor() -> OccupancyGrid:
    """A dead end of 0.9 m width, 5 m long, in which no car turns round in one go."""
    cells = np.full((40, 120), 100, dtype=np.int8)
    cells[10:28, 5:105] = 0
    return OccupancyGrid(cells, 0.05, (0.0, 0.0, 0.0))


def test_a_failed_search_is_not_repeated_until_something_changes(monkeypatch):
    costmap = LayeredCostmap(load_navigation().global_costmap, name="global", static=corridor())
    costmap.update(np.zeros(3))
    asked = []

    def fail(self, window, start, goal):
        asked.append(start)
        raise NoPathError("no drivable way", "unreachable", None, math.inf)

    monkeypatch.setattr(LivePlanner, "plan", fail)
    start, goal = np.array([1.0, 0.95, 0.0]), np.array([4.0, 0.95, 0.0])
    for method, count in (("hybrid_astar", 1), ("navfn", 3)):
        asked.clear()
        planner = CostmapPlanner(LivePlanner(method=method), costmap)
        for _ in range(3):
            with pytest.raises(NoPathError, match="no drivable way"):
                planner.make_plan(start, goal)
        assert len(asked) == count
        with pytest.raises(NoPathError):
            planner.make_plan(start + 0.01, goal)
        assert len(asked) == count + 1


@pytest.mark.parametrize("local", ["teb", "pursuit"])
def test_a_car_reverses_into_a_goal_behind_it(tmp_path, local):
    path = tmp_path / "corridor.yaml"
    write_map(path, corridor())
    config = load_navigation(sets=["robot.drive=car"], local_planner=local, global_planner="hybrid_astar")
    robot = Navigator(path, start=(3.0, 0.95, 0.0), config=config, localization="truth", seed=1)
    arrival = robot.go_to(1.5, 0.95, 0.0)
    assert arrival.succeeded, arrival.message
    assert abs(robot.true_pose[2]) < 0.3
    assert not robot.plant.collisions


def test_the_map_tells_a_car_that_may_not_reverse_that_it_cannot_get_there(tmp_path):
    path = tmp_path / "corridor.yaml"
    write_map(path, corridor())
    config = load_navigation(
        sets=["robot.drive=car", "NavfnROS/motion_model_for_search=DUBIN"],
        local_planner="teb",
        global_planner="hybrid_astar",
    )
    robot = Navigator(path, start=(3.0, 0.95, 0.0), config=config, localization="truth")
    arrival = robot.go_to(1.5, 0.95, 0.0)
    assert arrival.status == "unreachable"
    assert "no drivable way" in arrival.message
    assert arrival.drive is None


def test_hybrid_astar_leaves_a_place_where_the_outline_touches_a_wall():
    config, _ = fitted()
    costmap = LayeredCostmap(config.global_costmap, name="global", static=corridor())
    costmap.update(np.zeros(3))
    before = costmap.window().costs.copy()
    start, goal = (
        np.array([1.0, 0.66, 0.3]),
        np.array([4.0, 0.95, 0.0]),
    )  # 0.16 m from the wall, with a radius of 0.18 m
    path = LivePlanner(config.planner, "hybrid_astar").plan(costmap.window(), start.tolist(), goal.tolist())
    assert path.points_m[-1] == pytest.approx(goal[:2])
    assert path.points_m[:, 1].min() > 0.6
    assert np.array_equal(costmap.window().costs, before)
