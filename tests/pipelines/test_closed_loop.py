# SPDX-License-Identifier: MIT
"""The whole stack in one small house: rhythms, arrivals, people, the same run for the same seed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.errors import UsageError
from slamcli.formats.maps import write_map
from slamcli.grids import OccupancyGrid
from slamcli.pipelines.loop_listener import LoopListener
from slamcli.pipelines.navigate import Navigator, SlamChoice
from slamcli.pipelines.navigation_config import load_navigation


def two_rooms():
    """Two rooms of 3 x 4 m with a door of 0.9 m between them, cells of 5 cm, walls of 10 cm."""
    cells = np.zeros((82, 126), np.int8)
    cells[:2] = cells[-2:] = 100
    cells[:, :2] = cells[:, -2:] = 100
    cells[:, 62:64] = 100
    cells[34:52, 62:64] = 0
    cells[60:66, 20:26] = 100
    return OccupancyGrid(cells, 0.05)


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    path = tmp_path_factory.mktemp("house") / "house.yaml"
    write_map(path, two_rooms())
    return path


class Diary(LoopListener):
    """Writes everything down."""

    def __init__(self):
        self.times, self.truth, self.commands, self.states = {}, [], [], []

    def note(self, what, time_s):
        self.times.setdefault(what, []).append(time_s)

    def on_truth(self, time_s, pose_map, twist):
        self.note("truth", time_s)
        self.truth.append(pose_map.copy())

    def on_scan(self, time_s, scan):
        self.note("scan", time_s)

    def on_odometry(self, time_s, odometry):
        self.note("odometry", time_s)

    def on_command(self, time_s, twist):
        self.note("command", time_s)
        self.commands.append(twist.copy())

    def on_costmap(self, time_s, name, costmap):
        self.note(name, time_s)

    def on_plan(self, time_s, plan):
        self.note("plan", time_s)

    def on_goal(self, time_s, goal):
        self.note("goal", time_s)

    def on_map(self, time_s, grid):
        self.note("map", time_s)

    def on_status(self, time_s, state, message):
        self.states.append(state)


@pytest.fixture(scope="module")
def tour(house):
    diary = Diary()
    robot = Navigator(house, start=(1.0, 1.0, 0.0), seed=4, listeners=[diary])
    return robot, diary, [robot.go_to(5.2, 3.2, math.pi / 2), robot.go_to(1.0, 1.0)]


def test_it_arrives_in_the_other_room_and_back(tour):
    robot, _, arrivals = tour
    for arrival, goal in zip(arrivals, [(5.2, 3.2), (1.0, 1.0)], strict=True):
        drive = arrival.drive
        assert arrival.status == "succeeded"
        assert math.dist(drive.end_pose[:2], goal) < 0.2
        assert not drive.collisions
        assert drive.clearance_m > 0.02
        assert arrival.optimum_m - 0.3 < drive.length_m < 1.15 * arrival.optimum_m
        assert np.sqrt(np.mean(drive.position_error_m**2)) < 0.08
    assert arrivals[0].drive.end_pose[2] == pytest.approx(math.pi / 2, abs=0.25)
    assert robot.time_s == pytest.approx(arrivals[1].drive.end_s)


def test_everything_has_its_rhythm(tour):
    _, diary, arrivals = tour
    seconds = arrivals[-1].drive.end_s
    for what, rate in (("odometry", 20), ("scan", 10), ("command", 20), ("truth", 20), ("local", 2), ("global", 0.5)):
        times = np.array(diary.times[what])
        assert times[0] == 0.0
        np.testing.assert_allclose(np.diff(times), 1.0 / rate, atol=1e-9)
        assert abs(len(times) - seconds * rate) <= 2
    assert len(diary.times["goal"]) == len(arrivals)
    assert diary.times["map"] == [0.0]
    assert diary.states[:2] == ["controlling", "succeeded"]


def test_commands_keep_to_the_planners_limits(tour):
    robot, diary, _ = tour
    p = robot.config.local_parameters
    commands = np.array(diary.commands)
    assert np.isfinite(commands).all()
    assert commands[:, 0].max() <= p.max_vel_x + 1e-9
    assert commands[:, 0].min() >= p.min_vel_x - 1e-9
    assert np.abs(commands[:, 2]).max() <= p.max_vel_theta + 1e-9


def test_the_same_seed_gives_the_same_run_and_another_seed_another(house, tour):
    _, diary, _ = tour
    runs = []
    for seed in (4, 5):
        again = Diary()
        Navigator(house, start=(1.0, 1.0, 0.0), seed=seed, listeners=[again]).go_to(5.2, 3.2, math.pi / 2)
        runs.append(np.array(again.truth))
    np.testing.assert_array_equal(runs[0], np.array(diary.truth)[: len(runs[0])])
    shorter = min(len(run) for run in runs)
    assert np.abs(runs[0][:shorter] - runs[1][:shorter]).max() > 1e-3


def test_people_about_are_not_run_into(house):
    robot = Navigator(house, start=(1.0, 1.0, 0.0), people=2, seed=1)
    arrivals = [robot.go_to(5.2, 3.2), robot.go_to(1.0, 1.0)]
    assert [arrival.status for arrival in arrivals] == ["succeeded"] * 2
    assert not any(contact.by_robot for arrival in arrivals for contact in arrival.drive.collisions)


def test_the_truth_as_localisation_has_no_error(house):
    robot = Navigator(house, start=(1.0, 1.0, 0.0), localization="truth", seed=1)
    assert robot.go_to(2.2, 1.0).drive.position_error_m.max() < 1e-9


@pytest.mark.parametrize("algo", ["gmapping", "cartographer"])
def test_a_house_that_nobody_knows_is_mapped_on_the_way(house, algo):
    diary = Diary()
    slam = SlamChoice(algo=algo)
    robot = Navigator(None, world=str(house), start=(1.0, 1.0, 0.5), slam=slam, seed=2, listeners=[diary])
    arrival = robot.go_to(5.2, 3.2)
    assert arrival.status == "succeeded"
    assert math.dist(arrival.drive.end_pose[:2], (5.2, 3.2)) < 0.25
    assert math.isnan(arrival.optimum_m)
    assert len(diary.times["map"]) > 5


@pytest.mark.parametrize(
    ("goal", "status", "message"),
    [
        ((1.1, 3.15), "unreachable", "is in an obstacle"),
        ((9.0, 1.0), "unreachable", "outside"),
        ((3.0, 3.98), "unreachable", "is within the robot's inscribed radius"),
    ],
)
def test_a_goal_without_a_way_is_told_before_the_robot_sets_out(house, goal, status, message):
    arrival = Navigator(house, start=(1.0, 1.0, 0.0)).go_to(*goal)
    assert (arrival.status, arrival.drive) == (status, None)
    assert message in arrival.message


def test_a_door_that_the_map_does_not_know_to_be_shut_ends_in_recoveries_and_abort(house, tmp_path):
    shut = two_rooms()
    shut.cells[34:52, 62:64] = 100
    write_map(tmp_path / "shut.yaml", shut)
    config = load_navigation(sets=["planner_patience=1", "controller_patience=1"])
    robot = Navigator(house, world=str(tmp_path / "shut.yaml"), start=(1.0, 1.0, 0.0), config=config, seed=1)
    arrival = robot.go_to(5.2, 3.2, timeout_s=150.0)
    assert arrival.status == "aborted"
    assert "failed to find a valid plan even after executing all recovery behaviours" in arrival.message
    recoveries = ["conservative_reset", "rotate_recovery", "aggressive_reset", "rotate_recovery"]
    assert list(arrival.drive.recoveries[-4:]) == recoveries
    assert not arrival.drive.collisions


def test_time_runs_out(house):
    arrival = Navigator(house, start=(1.0, 1.0, 0.0)).go_to(5.2, 3.2, timeout_s=2.0)
    assert arrival.status == "timeout"
    assert arrival.message.startswith("not there after 2 s")
    assert arrival.drive.end_s - arrival.drive.begin_s == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"start": (1.0, math.nan, 0.0)}, "not finite"),
        ({"start": (-3.0, 1.0, 0.0)}, "outside the map"),
        ({"start": (0.15, 1.0, 0.0)}, "does not fit"),
        ({"map_path": None, "start": (1.0, 1.0, 0.0)}, "a map is needed"),
        ({"start": (1.0, 1.0, 0.0), "slam": SlamChoice(algo="gmapping")}, "needs a world"),
    ],
)
def test_a_start_that_cannot_be_is_refused(house, arguments, message):
    with pytest.raises(UsageError, match=message):
        Navigator(**{"map_path": house} | arguments)


def test_goals_and_timeouts_are_numbers(house):
    robot = Navigator(house, start=(1.0, 1.0, 0.0))
    with pytest.raises(UsageError, match="not finite"):
        robot.go_to(math.inf, 1.0)
    with pytest.raises(UsageError, match="timeout"):
        robot.go_to(2.0, 1.0, timeout_s=-1.0)
